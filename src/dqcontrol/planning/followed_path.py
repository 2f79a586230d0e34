"""Paths of the end effector between plans: from which posture one can be followed, and the configurations that do."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import NoteWarning, PlanError, ReachError, ShapeError, ValueRangeError, as_array
from dqcontrol.planning.certified_edges import CertifiedEdges, standing_at
from dqcontrol.references import POSE, Reference
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.set_points import GripperStep
from dqcontrol.robots import Robot, postures
from dqcontrol.robots.poses import unit_poses

# least singular value of the hand's Jacobian: 1 mm/s of the hand then takes at most 50 mrad/s
SINGULAR = 0.02
_JUMP = 0.5  # rad or m between two samples: more is another branch, which no law follows
_ASIDE = (0.05, 0.1, 0.2, 0.4)  # rad or m: how far joints to spare are moved aside between two samples


class Continued(NamedTuple):
    """How far a path can be followed from a posture.

    Attributes
    ----------
    configurations
        As far as it can, shape (K, n); none if the posture itself may not be.
    why
        What stops it there; empty if nothing does.
    pair
        What is in the way, if that stops it.
    """

    configurations: Array
    why: str
    pair: str


class _Stop(NamedTuple):
    """Why a configuration is no next one, and which pair is in the way; empty if it is one."""

    why: str
    pair: str = ""


def continued(edges: CertifiedEdges, start: Array, poses: Array, *, aside: bool = True) -> Continued:
    """Return how far poses of the hand, shape (N, 8), can be followed from a configuration at the first, shape (n,).

    Each configuration is the nearest to the one before it. Where that may not be, joints to spare are moved aside, as
    laws with constraints move them.
    """
    q, found = start, list[Array]()
    stop = _at(edges, start)
    for pose in poses[1:]:
        if stop.why:
            break
        found.append(q)
        q, stop = _next(edges, q, pose, aside)
    if not stop.why:
        found.append(q)
    return Continued(np.array(found).reshape(-1, len(start)), *stop)


def _at(edges: CertifiedEdges, q: Array) -> _Stop:
    """Return why nobody starts at a configuration."""
    rooms, rows = edges.room_at(q[None])
    if rooms[0] < 0:
        pair = edges.kept.labels[rows[0]]
        return _Stop(f"{pair}: {edges.said(q, rows[0])}", pair)
    return _singular(edges.robot, q)


def _singular(robot: Robot, q: Array) -> _Stop:
    smallest = float(np.linalg.svd(robot.hand_jacobian(q), compute_uv=False)[-1])
    return _Stop(f"a singularity (σ = {smallest:.2g})" if smallest < SINGULAR else "")


def _next(edges: CertifiedEdges, q: Array, pose: Array, aside: bool) -> tuple[Array, _Stop]:
    """Return the next configuration, or why there is none."""
    after, stop = _towards(edges, q, q, pose)
    if stop.why and aside:
        jacobian = edges.robot.hand_jacobian(q)
        spare = np.linalg.svd(jacobian)[2][np.linalg.matrix_rank(jacobian) :]
        for size in _ASIDE:
            for along in (*spare, *-spare):
                other, why = _towards(edges, q, q + size * along, pose)
                if not why.why:
                    return other, why
    return after, stop


def _towards(edges: CertifiedEdges, q: Array, guess: Array, pose: Array) -> tuple[Array, _Stop]:
    """Return the configuration at a pose that is found from a guess, and why it is not the next one."""
    solution = edges.robot.solve(pose, guess, restarts=0)
    after = solution.q
    if not solution.success:
        return after, _Stop(solution.reason)
    if np.abs(after - q).max() > _JUMP:
        return after, _Stop(f"no posture within {_JUMP:g} rad of the one before")
    if (singular := _singular(edges.robot, after)).why:
        return after, singular
    edge = edges.clear(q, after)
    if edge.certified:
        return after, _Stop("")
    away = f"{-1000 * edge.room:.3g} mm too near" if edge.room < 0 else "too near to be proved"
    return after, _Stop(f"{edge.label}: {away}", edge.label)


def branch_along(
    robot: Robot, constraints: Constraints | PreparedConstraints, poses: ArrayLike, seed: int = 0
) -> Array:
    """Return configurations that have the hand at poses one after the other, from a start from which all of it goes.

    All postures at the first pose are continued, the best first (`robots.postures`); the first that goes through
    limits, singularities and constraints is taken, each edge of it certified. If none does, joints to spare are moved
    aside where that helps, as laws with constraints move them.

    Parameters
    ----------
    robot, constraints
        As of `CertifiedEdges`.
    poses
        Unit dual quaternions, shape (N, 8), so near to each other that joints turn less than 0.5 rad between them.
    seed
        Of the starts of inverse kinematics.

    Returns
    -------
    Array
        Shape (N, n), rad or m.

    Raises
    ------
    PlanError
        If none goes through: the sample that the farthest stops at, why, and how many postures there are clear there
        (reason ``path``).
    ShapeError, ValueRangeError
        If the poses are none.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, q = dqc.load_robot("ur5"), [0.3, -1.2, 1.4, 0.3, 1.0, 0.0]
    >>> circle = dqc.references.Circle(arm.fkm(q), radius=0.1, duration=10.0)
    >>> poses = circle.samples([0.1 * k for k in range(101)])[:, :8]
    >>> dqc.planning.branch_along(arm, dqc.constraints.Constraints(), poses).shape
    (101, 6)
    """
    path = unit_poses("poses", poses)
    if path.ndim != 2:
        raise ShapeError(f"poses: expected shape (N, 8), got {path.shape}")
    edges = CertifiedEdges(robot, constraints)
    try:
        starts = [each.q for each in postures(robot, path[0], seed=seed)]
    except ReachError as error:
        raise PlanError(f"poses[0]: {error}", "unreachable", sample=0) from None
    return first_through([(start, path) for start in starts], edges, aside=True)


def first_through(starts: list[tuple[Array, Array]], edges: CertifiedEdges, *, aside: bool) -> Array:
    """Return the configurations of the first start, (n,), from which its poses, (N, 8), can be followed to their end.

    If there is none, of the first from which joints to spare have to be moved aside, if they may be.

    Raises
    ------
    PlanError
        If there is none: how far the best goes, why no farther, and whether anything may be there.
    """
    found: list[Continued] = []
    for moved in (False, True) if aside else (False,):
        found = [continued(edges, start, poses, aside=moved) for start, poses in starts]
        if through := [each for each in found if not each.why]:
            return through[0].configurations
    reached = [len(each.configurations) for each in found]
    farthest = int(np.argmax(reached))
    at, (_, path) = reached[farthest], starts[farthest]
    many = f"of {len(starts)} postures none goes" if len(starts) > 1 else "the posture does not go"
    if at == 0:  # nobody may be at the start: the posture there that lacks the least
        farthest = int(edges.room_at(np.array([start for start, _ in starts]))[0].argmax())
        text = f"{many} through; the best at sample 0 of {len(path)}: {found[farthest].why}"
    else:
        text = (
            f"{many} through; the farthest stops at sample {at} of {len(path)}: {found[farthest].why}; "
            f"{_postures_at(edges, path[at])}"
        )
    best = found[farthest]
    nearest = best.configurations[-1] if at else starts[farthest][0]
    raise PlanError(f"path: {text}", "path", pair=best.pair, nearest=nearest, sample=at)


def start_through(starts: list[tuple[Array, Array]], edges: CertifiedEdges, *, aside: bool) -> Array:
    """Return the start of those, (n,), from which its poses can be followed; see `first_through`.

    Where there is none it is the first, and a note says the sample that stops the farthest.
    """
    try:
        return first_through(starts, edges, aside=aside)[0]
    except PlanError as error:
        warnings.warn(f"start: {error}", NoteWarning, stacklevel=3)
        return starts[0][0]


def _postures_at(edges: CertifiedEdges, pose: Array) -> str:
    """Say how many postures there are at a pose that stops a path, and how many of them nothing speaks against."""
    try:
        there = postures(edges.robot, pose)
    except ReachError:
        return "no posture is there"
    may = sum(not _at(edges, each.q).why for each in there)
    return (
        f"of {len(there)} postures there {may or 'none'} {'are' if may > 1 else 'is'} clear and not singular"
    )


_SAME_POSE = 1e-6  # as in a sequence


@dataclass(frozen=True, eq=False, repr=False)
class FollowedPath(PlannedWay):
    """A motion of the end effector, and the configurations that follow it; see `followed`.

    Parameters
    ----------
    reference, robot
        What is followed, and by whom.
    knots
        Configurations at multiples of a period, shape (K, n), rad or m; edges between them are straight.
    period
        s.
    """

    reference: Reference
    robot: Robot
    knots: Array
    period: float

    def __post_init__(self) -> None:
        vars(self).update(duration=self.reference.duration, corners=self.reference.corners)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """Those of the reference."""
        return self.reference.gripper_steps

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        at, numbers = as_array("times", times) / self.period, np.arange(len(self.knots))
        return np.column_stack([np.interp(at, numbers, column) for column in self.knots.T])

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return self.reference.samples(times)


def followed(reference: Reference, kept: PreparedConstraints, q: Array, where: str) -> FollowedPath:
    """Return how a robot follows a motion from a configuration, (n,): each edge proved to keep the constraints.

    Raises
    ------
    PlanError
        If the motion stops somewhere (reason ``path``): at which sample, why.
    ValueRangeError
        If it never ends, starts elsewhere, or ends where something is touched.
    """
    if not math.isfinite(reference.duration):
        raise ValueRangeError(f"{where}: never ends; give its duration")
    if reference.guards.moves:
        raise ValueRangeError(
            f"{where}: 'until' and 'touch' are in no sequence that is planned: nobody knows its end"
        )
    robot, period = kept.robot, kept.period
    times = period * np.arange(math.ceil(reference.duration / period - 1e-9) + 1)
    poses, hand = reference.samples(times)[:, POSE], robot.fkm(q)
    if min(np.abs(poses[0] - hand).max(), np.abs(poses[0] + hand).max()) > _SAME_POSE:
        raise ValueRangeError(f"{where}: must start where the step before it ends")
    if np.abs(poses - poses[0]).max() == 0.0:
        return FollowedPath(reference, robot, np.array([q, q]), period)
    edges = CertifiedEdges(standing_at(robot, q), kept).eased_at(q)
    found = continued(edges, q, poses)
    if found.why:
        at = len(found.configurations)
        raise PlanError(
            f"{where}: stops at sample {at} of {len(poses)}: {found.why}", "path", pair=found.pair, sample=at
        )
    return FollowedPath(reference, robot, found.configurations, period)
