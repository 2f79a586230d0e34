"""Branches: from which posture a path of the hand can be followed to its end, all that has to be kept kept."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import PlanError, ReachError, ShapeError
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.robots import Robot, postures
from dqcontrol.robots.poses import unit_poses

SINGULAR = (
    0.02  # least singular value of the hand's Jacobian: 1 mm/s of the hand then takes at most 50 mrad/s
)
_JUMP = 0.5  # rad or m between two samples: more is another branch, which no law follows


class Continued(NamedTuple):
    """How far a path can be followed from a posture.

    Attributes
    ----------
    configurations
        As far as it can, shape (K, n).
    why
        What stops it there; empty if nothing does.
    pair
        What is in the way, if that stops it.
    """

    configurations: Array
    why: str
    pair: str


def continued(edges: CertifiedEdges, start: Array, poses: Array) -> Continued:
    """Return how far poses of the hand, shape (N, 8), can be followed from a configuration at the first, shape (n,)."""
    robot, q, found = edges.robot, start, [start]
    rooms, rows = edges.room_at(start[None])
    if rooms[0] < 0:
        pair = edges.kept.labels[rows[0]]
        return Continued(start[None], f"{pair}: {edges.said(start, rows[0])}", pair)
    for pose in poses[1:]:
        solution = robot.solve(pose, q, restarts=0)
        if not solution.success:
            return Continued(np.array(found), solution.reason, "")
        if np.abs(solution.q - q).max() > _JUMP:
            return Continued(np.array(found), f"no posture within {_JUMP:g} rad of the one before", "")
        smallest = float(np.linalg.svd(robot.hand_jacobian(solution.q), compute_uv=False)[-1])
        if smallest < SINGULAR:
            return Continued(np.array(found), f"a singularity (σ = {smallest:.2g})", "")
        edge = edges.clear(q, solution.q)
        if not edge.certified:
            away = f"{-1000 * edge.room:.3g} mm too near" if edge.room < 0 else "too near to be proved"
            return Continued(np.array(found), f"{edge.label}: {away}", edge.label)
        q = solution.q
        found.append(q)
    return Continued(np.array(found), "", "")


def branch_along(
    robot: Robot, constraints: Constraints | PreparedConstraints, poses: ArrayLike, seed: int = 0
) -> Array:
    """Return configurations that have the hand at poses one after the other, from a start from which all of it goes.

    All postures at the first pose that keep the constraints are continued, the best first (`robots.postures`); the
    first that goes through limits, singularities and constraints is taken, each edge of it certified.

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
        If none goes through: the sample that the last of them stops at, and why (reason ``path``).
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
    return first_through([(start, path) for start in starts], edges)


def first_through(starts: list[tuple[Array, Array]], edges: CertifiedEdges) -> Array:
    """Return the configurations of the first start, (n,), from which its poses, (N, 8), can be followed to their end.

    Raises
    ------
    PlanError
        If there is none: how far the best goes, and why no farther.
    """
    best = Continued(np.empty((0, 0)), "", "")
    for start, poses in starts:
        found = continued(edges, start, poses)
        if not found.why:
            return found.configurations
        if len(found.configurations) > len(best.configurations):
            best = found
    at, count = len(best.configurations), len(starts[0][1])
    many = f"of {len(starts)} postures none" if len(starts) > 1 else "the posture does not"
    raise PlanError(
        f"path: {many} {'goes' if len(starts) > 1 else 'go'} through; the farthest stops at sample {at} of {count}: "
        f"{best.why}",
        "path",
        pair=best.pair,
        nearest=best.configurations[-1],
        sample=at,
    )
