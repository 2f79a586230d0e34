"""The way of a mobile manipulator to a goal metres away: turn, drive, turn, while the arm unfolds."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.moved import renamed_parameters
from dqcontrol.references.reference import NO_CORNERS, Reference
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE, as_pose
from dqcontrol.references.set_point import SetPoint
from dqcontrol.references.yaml_form import SpecStart
from dqcontrol.robots import Robot
from dqcontrol.robots.driving import TURNING_RADIUS
from dqcontrol.robots.whole_body import base_coordinates

_RAMP = 1.0  # s; no motion reaches its full speed sooner
_SpeedFraction = Annotated[float, Meta(gt=0, le=1, description="of the velocity limits")]
_TRIES = 64  # starts of the search for a goal configuration


@renamed_parameters(share="speed_fraction")
@dataclass(frozen=True, eq=False, repr=False)
class DriveTo(Reference):
    """The hand's motion while its robot goes from one configuration to another, as it can.

    Each differential drive turns towards its goal, forwards or backwards, whichever turns less, drives there straight,
    and turns to its heading there. Meanwhile all other joints go straight to theirs. Each motion is of minimum jerk,
    from rest to rest. So the twist is J u with the robot's own inputs u: it lies in the range of J everywhere, also in
    singularities; and joints that start and end within their limits stay within them.

    Parameters
    ----------
    robot
        An arm or a whole body, with velocity limits for all that has to move.
    start, goal
        Configurations, shape (n,), rad or m. Headings of drives count modulo a turn.
    speed_fraction
        The most of the robot's velocity limits that is used, 0 … 1.

    Attributes
    ----------
    duration
        s.

    Raises
    ------
    ShapeError, ValueRangeError
        If a size or number is wrong, or an input has no velocity limit.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    >>> way = dqc.references.DriveTo(robot, start, [-1, 2, 3, 0.5, -0.5, 0.5, 0.5, 0])
    >>> round(way.duration, 2), way.configurations([way.duration])[0].round(9).tolist()
    (20.94, [-1.0, 2.0, 3.0, 0.5, -0.5, 0.5, 0.5, 0.0])
    """

    kind = "drive-to"

    robot: Robot
    start: ArrayLike
    goal: ArrayLike
    speed_fraction: float = 0.5
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    _moves: Array = field(
        init=False, repr=False
    )  # (4, n), change of the configuration: turn, drive, turn, others
    _inputs: Array = field(init=False, repr=False)  # (4, m), the integrals of the inputs that make it
    _begins: Array = field(init=False, repr=False)  # (4,), s
    _lasts: Array = field(init=False, repr=False)  # (4,), s

    def __post_init__(self) -> None:
        n = self.robot.configuration_size
        start, goal = as_array("start", self.start, (n,)), as_array("goal", self.goal, (n,))
        fraction = as_positive("speed_fraction", self.speed_fraction)
        moves, inputs = _moves(self.robot, start, goal)
        lasts = _least_durations(self.robot, inputs, fraction)
        driving = lasts[:3].sum()
        if 0 < driving < lasts[3]:
            lasts[:3] *= lasts[3] / driving
        lasts[3] = max(driving, lasts[3])
        begins = np.array([0, lasts[0], lasts[:2].sum(), 0])
        values = {"start": start, "goal": goal, "duration": float(lasts[3]), "corners": NO_CORNERS}
        plan = {"_moves": moves, "_inputs": inputs, "_begins": begins, "_lasts": lasts}
        for name, value in {**values, **plan}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_spec(cls, start: SpecStart, *, speed_fraction: _SpeedFraction = 0.5) -> Reference:
        """Go with the whole robot to the pose that ``start`` and ``offset`` say; see `dqcontrol.references.DriveTo`."""
        if start.place != "reference":
            raise ValueRangeError(
                f"{start.place}: drive-to starts where the robot does, so it is no part of a sequence"
            )
        return SetPoint(start.pose)

    @classmethod
    def of_robot(
        cls, reference: Reference, robot: Robot, start: Array, *, speed_fraction: float = 0.5
    ) -> DriveTo:
        """Return the way from the start configuration to the reference's pose; see `Reference.of_robot`."""
        return cls.pose(robot, start, reference.at(0.0).pose, speed_fraction)

    @classmethod
    @renamed_parameters(share="speed_fraction")
    def pose(cls, robot: Robot, start: ArrayLike, pose: ArrayLike, speed_fraction: float = 0.5) -> DriveTo:
        """Return the way to a pose of the hand.

        Of the configurations that reach it (64 starts of inverse kinematics), those count whose smallest singular value
        is at least half of the largest found; the one that is reached soonest is taken.

        Raises
        ------
        ShapeError, ValueRangeError
            As above, or if the pose is none, or out of reach.
        """
        target = as_pose("pose", pose)
        q = as_array("start", start, (robot.configuration_size,))
        found = _solutions(robot, q, target)
        smallest = np.linalg.svd(robot.hand_jacobian(found), compute_uv=False)[:, -1]
        ways = [cls(robot, q, each, speed_fraction) for each in found[smallest >= 0.5 * smallest.max()]]
        return min(ways, key=lambda way: way.duration)

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        return np.asarray(self.start) + self._progress(as_array("times", times))[0] @ self._moves

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        gained = self._progress(begins + period)[0] - self._progress(begins)[0]
        return gained @ self._inputs / period

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        _, rates, accelerations = self._progress(times)
        q, u = self.configurations(times), rates @ self._inputs
        jacobian, change = self.robot.twist_jacobian(q), self.robot.twist_jacobian_derivative(q, u)
        out = np.zeros((len(times), SAMPLE_SIZE))
        out[:, POSE] = self.robot.fkm(q)
        out[:, TWIST] = np.einsum("kij,kj->ki", jacobian, u)
        out[:, TWIST_RATE] = np.einsum("kij,kj->ki", jacobian, accelerations @ self._inputs)
        out[:, TWIST_RATE] += np.einsum("kij,kj->ki", change, u)
        return out

    def _progress(self, times: Array) -> tuple[Array, Array, Array]:
        """Return progress 0 … 1 of the four motions, its rate and acceleration, each (N, 4)."""
        lasts = np.maximum(self._lasts, 1e-9)
        t = np.clip((times[:, None] - self._begins) / lasts, 0.0, 1.0)
        rest = 1.0 - t
        progress = t**3 * (10 - 15 * t + 6 * t**2)
        return progress, 30 * (t * rest) ** 2 / lasts, 60 * t * rest * (1 - 2 * t) / lasts**2


def _moves(robot: Robot, start: Array, goal: Array) -> tuple[Array, Array]:
    """Return what turn, drive, turn and the rest change of the configuration (4, n), and their inputs (4, m)."""
    moves = np.zeros((4, len(start)))
    moves[3] = goal - start
    firsts = robot.drives[:, 0].astype(int)
    if (robot.drives[:, TURNING_RADIUS] > 0).any():
        raise ValueRangeError(
            f"robot: {robot.name} cannot turn on the spot as drive-to plans "
            f"(least radius {robot.drives[:, TURNING_RADIUS].max():.3g} m); take a motion that its wheels can follow"
        )
    lengths = []
    for first in firsts:
        turn, length, again = _turn_drive_turn(start[first : first + 3], goal[first : first + 3])
        moves[0, first + 2], moves[2, first + 2] = turn, again
        moves[1, first : first + 2] = moves[3, first : first + 2]
        moves[3, first : first + 3] = 0.0
        lengths.append(length)
    inputs = moves[:, robot.input_coordinates]
    if robot.input_size < robot.configuration_size:
        inputs[1, np.isin(robot.input_coordinates, firsts)] = lengths
    return moves, inputs


def _turn_drive_turn(start: Array, goal: Array) -> tuple[float, float, float]:
    """Return the angles and the signed length between two (x, y, φ)."""
    away = goal[:2] - start[:2]
    length = math.hypot(*away)
    bearing = math.atan2(away[1], away[0]) if length > 0 else start[2]
    ways = []
    for direction, sign in ((bearing, 1.0), (bearing + math.pi, -1.0)):
        turns = (math.remainder(angle, math.tau) for angle in (direction - start[2], goal[2] - direction))
        turn, again = turns
        ways.append((turn, sign * length, again))
    return min(ways, key=lambda way: abs(way[0]) + abs(way[2]))


def _least_durations(robot: Robot, inputs: Array, speed_fraction: float) -> Array:
    """Return how long motions of minimum jerk take: 15/8 of the mean speed at their peak, 10/√3 of the acceleration."""
    ways, limits = np.abs(inputs), speed_fraction * robot.limits.velocity
    unlimited = (ways.max(axis=0) > 0) & np.isinf(limits)
    if unlimited.any():
        name = robot.input_names[int(unlimited.argmax())]
        raise ValueRangeError(f"robot: {name} of {robot.name} has no velocity limit to plan with")
    fraction = ways / limits
    return np.maximum(1.875 * fraction, np.sqrt(10 / math.sqrt(3) * _RAMP * fraction)).max(axis=1)


def _solutions(robot: Robot, start: Array, pose: Array) -> Array:
    """Return configurations that reach a pose, found from the start and from random ones near the goal."""
    bases = np.flatnonzero(base_coordinates(robot))
    lower = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -math.pi)
    upper = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, math.pi)
    starts = np.random.default_rng(0).uniform(lower, upper, (_TRIES, len(start)))
    starts[0] = start
    for first in bases[::3]:
        starts[1:, first : first + 2] = start[first : first + 2]
    found = robot.solve(np.tile(pose, (_TRIES, 1)), starts, restarts=0)
    if not found.success.any():
        reason = robot.solve(pose, start).reason
        raise ValueRangeError(f"pose: {robot.name} does not get there: {reason}")
    return found.q[found.success.astype(bool)]
