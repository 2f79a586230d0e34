"""The way of a mobile manipulator to a goal metres away: its base turns, drives or steers there, its arm unfolds."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import (
    ShapeError,
    UnreachableGoalError,
    ValueRangeError,
    as_array,
    as_positive,
)
from dqcontrol.geometry import FloorMap
from dqcontrol.references.base_ways import Piece, arcs_and_lines, rolled, turns_and_lines
from dqcontrol.references.reference import NO_CORNERS, Metres, Reference, SpecStart
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE, as_pose
from dqcontrol.references.set_points import SetPoint
from dqcontrol.references.straight import PEAK_SPEED, progress
from dqcontrol.references.ways_around import (
    WaysAround,
    across,
    body_points,
    folded_posture,
    itself_apart,
    room_of,
)
from dqcontrol.robots import Robot, WholeBody, nearest_pose
from dqcontrol.robots.kinematics.driving import RIM_LEVER, TURNING_RADIUS
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.world import World, floor_around

if TYPE_CHECKING:
    from dqcontrol.constraints.prepared_constraints import PreparedConstraints

_LONGEST = 1e6  # s, twelve days: looked at each `_LOOK`, a longer way takes gigabytes
_RAMP = 1.0  # s; no motion reaches its full speed sooner
WIDER = 1.25  # arcs of bases that steer, against their least radius: the rest is for corrections
_PEAK_ACCELERATION = 10 / math.sqrt(3)  # of minimum jerk, over a unit way in a unit time
_SpeedFraction = Annotated[float, Meta(gt=0, le=1, description="of the limits")]
_Acceleration = (
    Annotated[float, Meta(gt=0, description="m/s² or rad/s²")]
    | list[Annotated[float, Meta(gt=0, description="m/s² or rad/s²")]]
    | None
)
ClearOf = Literal["all"] | list[str] | None  # bodies of the world
_TURN_DRIVE_TURN = 3  # motions
# starts of the search for a goal configuration, and where there are obstacles
_TRIES, AROUND_TRIES = 64, 256
_ABOUT = 0.8  # m; how far from the goal those of the base are then
CLEARANCE = 0.05  # m
_LOOK = 0.1  # s; between the instants of a way that are looked at
_LEAST_SHARE = 0.5  # of the clearance: grids and straight links are coarse


class PlannedWay(Reference):
    """The end effector's motion while its robot goes a way of configurations that it can go.

    Attributes
    ----------
    robot
        Whose way it is.
    """

    robot: Robot

    @abstractmethod
    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        moved = self.configurations(begins + period) - self.configurations(begins)
        return moved[:, self.robot.input_coordinates] / period

    def rested(self, times: Array) -> Array:
        """Return for how long the robot has been where it was to go, s, shape (N,); not positive on the way."""
        return times - self.duration


@dataclass(frozen=True, eq=False, repr=False)
class DriveTo(PlannedWay):
    """The end effector's motion while its robot goes from one configuration to another, as it can.

    Each differential drive turns towards its goal, forwards or backwards, whichever turns less, drives there straight,
    and turns to its heading there; a base that steers takes the shortest way of three arcs and lines, forwards and
    backwards [Reeds and Shepp 1990]; one that moves sideways goes straight. Meanwhile all other joints go straight to
    theirs. Each motion is of minimum jerk, from rest to rest. So the twist is J u with the robot's own inputs u: it
    lies in the range of J everywhere, also in singularities; and joints that start and end within their limits stay
    within them.

    Parameters
    ----------
    robot
        An arm or a whole body, with velocity limits for all that has to move.
    start, goal
        Configurations, shape (n,), rad or m. Headings of drives count modulo a turn.
    speed_fraction
        The most that is used of the limits of velocities, rims and accelerations, 0 … 1.
    acceleration
        Limit of each joint's acceleration, or of each input's, shape (m,), rad/s² or m/s²; none if omitted. Those that
        the robot's file gives its bases are kept too.
    via
        Points of the floor, (x, y), m, that the robot's only base passes on its way, from one straight to the next.
    folded
        A configuration, shape (n,), whose joints the robot takes before it drives and keeps until its base has arrived.
    while_driving
        Whether it takes them while its base sets off already, and leaves them so that it is done when that arrives.

    Attributes
    ----------
    duration
        s.

    Raises
    ------
    ShapeError, ValueRangeError
        If a size or number is wrong, an input has no velocity limit, or the base cannot pass points.

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
    acceleration: ArrayLike | None = None
    via: Sequence[ArrayLike] = ()
    folded: ArrayLike | None = None
    while_driving: tuple[bool, bool] = (False, False)
    _moves: Array = field(init=False, repr=False)  # (K, n), what each motion changes of the configuration
    _inputs: Array = field(init=False, repr=False)  # (K, m), the integrals of the inputs that make it
    _begins: Array = field(init=False, repr=False)  # (K,), s
    _lasts: Array = field(init=False, repr=False)  # (K,), s

    def __post_init__(self) -> None:
        n = self.robot.configuration_size
        start, goal = as_array("start", self.start, (n,)), as_array("goal", self.goal, (n,))
        fraction = as_positive("speed_fraction", self.speed_fraction)
        via = [as_array(f"via[{i}]", point, (2,)) for i, point in enumerate(self.via)]
        moves, inputs = _base_motions(self.robot, start, goal, via)
        fastest = self.robot.acceleration_limits("acceleration", self.acceleration)
        others = goal - start
        for first in self.robot.bases[0][:1] if via else self.robot.drives[:, 0].astype(int):
            others[first : first + 3] = 0.0
        if self.folded is None:
            joints = others[None]
        else:
            fold = as_array("folded", self.folded, (n,)) - start
            fold[base_coordinates(self.robot)] = 0.0
            joints = np.array([fold, others - fold])
        joint_inputs = joints[:, self.robot.input_coordinates]
        with np.errstate(all="ignore"):  # what is not finite is said below
            lasts = _least_durations(self.robot, inputs, fraction, fastest)
            joint_lasts = _least_durations(self.robot, joint_inputs, fraction, fastest)
        driving = lasts.sum()
        if self.folded is None:
            if 0 < driving < joint_lasts[0]:
                lasts *= joint_lasts[0] / driving
            joint_lasts[0] = max(driving, joint_lasts[0])
            first, joint_begins, duration = 0.0, [0.0], float(joint_lasts[0])
        else:
            folds, unfolds = joint_lasts
            first = 0.0 if self.while_driving[0] else folds
            last = max(folds, first + driving - (unfolds if self.while_driving[1] else 0.0))
            joint_begins, duration = [0.0, last], float(max(first + driving, last + unfolds))
        if not math.isfinite(duration):
            farthest = max(float(np.abs(start).max()), float(np.abs(goal).max()))
            raise ValueRangeError(
                f"goal: takes no finite time from start, with coordinates up to {farthest:.3g}"
            )
        if duration > _LONGEST:
            raise ValueRangeError(
                f"goal: takes {duration:.3g} s, more than {_LONGEST:g}; give more speed_fraction or acceleration"
            )
        begins = np.r_[first + np.r_[0.0, np.cumsum(lasts[:-1])], joint_begins]
        vars(self).update(start=start, goal=goal, via=via, duration=duration, corners=NO_CORNERS)
        vars(self).update(_moves=np.vstack([moves, joints]), _inputs=np.vstack([inputs, joint_inputs]))
        vars(self).update(_begins=begins, _lasts=np.r_[lasts, joint_lasts])

    @classmethod
    def from_spec(
        cls,
        start: SpecStart,
        *,
        speed_fraction: _SpeedFraction = 0.5,
        acceleration: _Acceleration = None,
        clear_of: ClearOf = None,
        clearance: Metres = CLEARANCE,
    ) -> Reference:
        """Go with the whole robot to the pose that ``start`` and ``offset`` say; see `dqcontrol.references.DriveTo`."""
        if start.place != "reference":
            raise ValueRangeError(
                f"{start.place}: drive-to starts where the robot does, so it is no part of a sequence"
            )
        return SetPoint(start.pose)

    @classmethod
    def of_robot(
        cls,
        reference: Reference,
        robot: Robot,
        start: Array,
        world: World | None = None,
        kept: PreparedConstraints | None = None,
        *,
        speed_fraction: float = 0.5,
        acceleration: ArrayLike | None = None,
        clear_of: ClearOf = None,
        clearance: float = CLEARANCE,
    ) -> DriveTo:
        """Return the way from the start configuration to the reference's pose; see `Reference.of_robot`."""
        floor = None if clear_of is None else floor_around(world, clear_of, "reference.clear_of")
        return cls.pose(robot, start, reference.at(0.0).pose, speed_fraction, acceleration, floor, clearance)

    @classmethod
    def pose(
        cls,
        robot: Robot,
        start: ArrayLike,
        pose: ArrayLike,
        speed_fraction: float = 0.5,
        acceleration: ArrayLike | None = None,
        floor: FloorMap | None = None,
        clearance: float = CLEARANCE,
    ) -> DriveTo:
        """Return the way to a pose of the end effector.

        Of the configurations that reach it (64 starts of inverse kinematics), those count whose smallest singular value
        is at least half of the largest found; the one that is reached soonest is taken. Ways on which the robot's
        shapes stay 20 mm apart from each other go first; only where there is none is another one taken. The end
        effector of a robot with a base never goes through the floor, z = 0.

        On a floor with obstacles the base drives from straight to straight around them. Where its room is needed, the
        arm folds itself before and unfolds at the goal, while the base drives if there is room for that. The whole way
        is looked at before it is given. A robot from a file of a mobile robot has the shapes that `robots shapes` fits
        to it. Links of a robot without shapes count as straight, 8 cm thick; a base on mecanum or omni wheels without
        takes the box around its wheels, and any other is refused. A base that steers finds a way only where nothing is
        in that of its arcs.

        Parameters
        ----------
        robot, start, speed_fraction, acceleration
            As above.
        pose
            Unit dual quaternion, shape (8,), inertial frame.
        floor
            What to keep out of.
        clearance
            By that distance, m.

        Raises
        ------
        UnreachableGoalError
            If no configuration within the limits has the end effector there: which limits hold it back, and how near it
            comes; or if something stands in its place, or in the way.
        ShapeError, ValueRangeError
            As above, or if the pose is none.
        """
        target = as_pose("pose", pose)
        q = as_array("start", start, (robot.configuration_size,))
        if floor is not None:
            kept = as_positive("clearance", clearance)
            return _way_around(cls, robot, q, target, (speed_fraction, acceleration), floor, kept)
        ways = [
            cls(robot, q, each, speed_fraction, acceleration)
            for each in goal_configurations(robot, q, target)
        ]
        ways = [way for way in ways if _above_floor(way)]
        if not ways:
            raise UnreachableGoalError(
                f"pose: every way of {robot.name} there takes its end effector through the floor"
            )
        ways.sort(key=lambda way: way.duration)
        return next((way for way in ways if _itself_apart(way)), ways[0])

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        progress = self._progress(as_array("times", times))[0]
        q = np.asarray(self.start) + progress @ self._moves
        if _steers(self.robot):
            for k, first in enumerate(self.robot.drives[:, 0].astype(int)):
                q[:, first : first + 3] = np.asarray(self.start)[first : first + 3]
                for gained, inputs in zip(progress.T, self._inputs, strict=True):
                    length, angle = inputs[first - k : first - k + 2]
                    q[:, first : first + 3] = rolled(q[:, first : first + 3], gained * length, gained * angle)
        return q

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        gained = self._progress(begins + period)[0] - self._progress(begins)[0]
        return gained @ self._inputs / period

    @property
    def base_pieces(self) -> Array:
        """Lengths and angles of what its only base drives, one turn, line or arc a row, shape (K, 2), m and rad."""
        first = int(self.robot.drives[0, 0])
        count = len(self._inputs) - (1 if self.folded is None else 2)  # the rest is what joints go
        pieces = self._inputs[:count, first : first + 2]
        return pieces[np.abs(pieces).max(axis=1) > 0]

    @property
    def detour(self) -> tuple[float, float]:
        """How far the base drives around obstacles, and how far its goal is, m; both 0 if it drives straight there."""
        if not self.via:
            return 0.0, 0.0
        first = self.robot.bases[0][0]
        start, goal = (np.asarray(each)[first : first + 2] for each in (self.start, self.goal))
        points = np.vstack([start, *self.via, goal])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()), math.dist(start, goal)

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
        """Return progress 0 … 1 of the K motions, its rate and acceleration, each (N, K)."""
        lasts = np.maximum(self._lasts, 1e-9)
        t = np.clip((times[:, None] - self._begins) / lasts, 0.0, 1.0)
        rest = 1.0 - t
        return progress(t), 30 * (t * rest) ** 2 / lasts, 60 * t * rest * (1 - 2 * t) / lasts**2


def _way_around(
    kind: type[DriveTo],
    robot: Robot,
    start: Array,
    pose: Array,
    limits: tuple[float, ArrayLike | None],
    floor: FloorMap,
    clearance: float,
) -> DriveTo:
    """Return the first way to a pose that keeps out of everything; see `ways_around`."""
    check_around(robot, start, floor)
    x, y, z = algebra.translation(pose)
    if z < floor.height and floor.holds([[x, y]])[0]:
        raise UnreachableGoalError(
            f"pose: the goal ({x:.3g}, {y:.3g}, {z:.3g}) m is inside what stands there"
        )
    goals = goal_configurations(robot, start, pose, AROUND_TRIES)
    free = clear_of_floor(floor, robot, goals, clearance)
    if not len(free):
        raise UnreachableGoalError(
            f"pose: of {len(goals)} configurations that {robot.name} reaches it with, none is {1e3 * clearance:g} mm "
            "clear of what stands there"
        )
    for way in ways_around(kind, robot, start, free, limits, floor, clearance):
        return way
    width = across(robot, folded_posture(robot, start))
    raise UnreachableGoalError(
        f"pose: {robot.name} finds no way to any of {len(free)} configurations that reach it and are clear of the "
        f"what stands there by {1e3 * clearance:g} mm; folded it takes {2e3 * width:.0f} mm"
    )


def check_around(robot: Robot, start: Array, floor: FloorMap) -> None:
    """Raise if a robot cannot go around things, or starts in them."""
    if not isinstance(robot, WholeBody) or len(robot.bases) != 1:
        raise ShapeError(f"floor: expected a robot with one base, got {robot.name}")
    if body_points(robot, start).carried.all():
        raise ShapeError(
            f"clear_of: nothing says how wide the base of {robot.name} is: wheels alone do not; give its drive a "
            "chassis or a holonomic base a size, in a robot file with parts; or plant.base of its physics a radius; or "
            "the links of a mobile robot's own file collision shapes"
        )
    if (room := room_of(floor, robot, start[None])) < 0:
        raise ValueRangeError(f"start: {robot.name} is {-1e3 * room:.3g} mm inside what stands there")


def clear_of_floor(floor: FloorMap, robot: Robot, found: Array, clearance: float) -> Array:
    """Return the configurations, of (N, n), that are clear of what stands on a floor."""
    clear = [q for q in found if room_of(floor, robot, q[None]) >= clearance]
    return np.array(clear).reshape(-1, robot.configuration_size)


def ways_around(
    kind: type[DriveTo],
    robot: Robot,
    start: Array,
    goals: Array,
    limits: tuple[float, ArrayLike | None],
    floor: FloorMap,
    clearance: float,
) -> Iterator[DriveTo]:
    """Yield ways to configurations, (G, n), that keep out of everything, nearest places of the base first.

    Those on which the robot's shapes stay apart from each other go first.
    """
    first = robot.bases[0][0]
    here = start[first : first + 2]
    free = goals[np.argsort(np.linalg.norm(goals[:, first : first + 2] - here, axis=1), kind="stable")]
    folded = folded_posture(robot, start)
    width = across(robot, folded)

    def ways_to(goals: Array) -> Iterator[DriveTo]:
        places = goals[:, first : first + 2]
        seen = floor.line_clearance(here, places) >= clearance + across(robot, start)
        for goal in goals[seen]:
            yield kind(robot, start, goal, *limits)
        corners = np.vstack([here, places, *floor.polygons])
        within = np.array([corners.min(axis=0) - 4 * width, corners.max(axis=0) + 4 * width])
        ways = WaysAround(floor, here, width + clearance, within)
        for goal, place in zip(goals, places, strict=True):
            via = ways.to(place)
            if via is not None and not (via and _steers(robot)):
                yield kind(robot, start, goal, *limits, via=via, folded=folded)

    def without_rests(way: DriveTo, *, apart: bool) -> DriveTo:
        """Return the same with the arm folding and unfolding while the base drives, where there is room for that."""
        if way.folded is None:
            return way
        sooner = (replace(way, while_driving=each) for each in ((True, True), (False, True), (True, False)))
        return next((each for each in sooner if keeps_out(each) and (_itself_apart(each) or not apart)), way)

    def keeps_out(way: DriveTo) -> bool:
        return _above_floor(way) and room_of(floor, robot, instants_of(way)) >= _LEAST_SHARE * clearance

    for apart, goals in ((True, free[itself_apart(robot, free)]), (False, free)):
        for way in ways_to(goals):
            if (not apart or _itself_apart(way)) and keeps_out(way):
                yield without_rests(way, apart=apart)


def instants_of(way: DriveTo) -> Array:
    """Return the configurations of a way that are looked at."""
    return way.configurations(np.linspace(0, way.duration, max(2, math.ceil(way.duration / _LOOK))))


def _above_floor(way: DriveTo) -> bool:
    """Return whether a hand on a mobile base stays above the floor, or goes no deeper than where it starts and ends."""
    if not len(way.robot.bases):
        return True
    heights = algebra.translation(way.robot.fkm(instants_of(way)))[:, 2]
    return bool(heights.min() >= min(0.0, heights[0], heights[-1]))


def _itself_apart(way: DriveTo) -> bool:
    """Return whether a robot's shapes stay apart from each other on a way."""
    return bool(itself_apart(way.robot, instants_of(way)).all())


def goal_configurations(robot: Robot, start: Array, pose: Array, tries: int = _TRIES) -> Array:
    """Return configurations within limits with the end effector at a pose (8,), not near singularities, shape (N, n).

    They are found from the start and from random configurations near it; with more than 64 tries near the goal.

    Raises
    ------
    UnreachableGoalError
        If there are none.
    """
    lower = np.where(np.isfinite(robot.limits.lower), robot.limits.lower, -math.pi)
    upper = np.where(np.isfinite(robot.limits.upper), robot.limits.upper, math.pi)
    starts = np.random.default_rng(0).uniform(lower, upper, (tries, len(start)))
    starts[0] = start
    for first in np.flatnonzero(base_coordinates(robot))[::3]:
        if tries > _TRIES:
            starts[1:, first : first + 2] *= _ABOUT / math.pi
            starts[1:, first : first + 2] += algebra.translation(pose)[:2]
        else:
            starts[1:, first : first + 2] = start[first : first + 2]
    solved = robot.solve(np.tile(pose, (tries, 1)), starts, restarts=0)
    found = solved.q[solved.success.astype(bool)]
    if not len(found):
        reason, nearest = robot.solve(pose, start).reason, nearest_pose(robot, pose, start)
        raise UnreachableGoalError(f"pose: {robot.name} does not get there: {reason}; {nearest}", nearest)
    smallest = np.linalg.svd(robot.hand_jacobian(found), compute_uv=False)[:, -1]
    return found[smallest >= 0.5 * smallest.max()]


def _steers(robot: Robot) -> bool:
    """Return whether a base of a robot cannot turn on the spot."""
    return bool((robot.drives[:, TURNING_RADIUS] > 0).any())


def _base_motions(robot: Robot, start: Array, goal: Array, via: Sequence[Array]) -> tuple[Array, Array]:
    """Return what the motions of the bases change of the configuration, (K, n), and the inputs of these, (K, m).

    Arcs change x, y and φ together, which only the inputs say.
    """
    firsts, steers = robot.drives[:, 0].astype(int), _steers(robot)
    if via and (len(robot.bases) != 1 or steers):
        raise ShapeError(
            f"via: expected a robot with one base, which turns on the spot or moves sideways, got {robot.name}"
        )
    if steers and robot.input_size == robot.configuration_size:
        raise ValueRangeError(f"robot: {robot.name} steers; plan with its form 'constrained'")
    if via and not len(firsts):
        return _sideways(robot, start, goal, via)
    ways = [
        _pieces(robot.drives[k], start[at : at + 3], goal[at : at + 3], via) for k, at in enumerate(firsts)
    ]
    moves = np.zeros((max(map(len, ways), default=_TURN_DRIVE_TURN), len(start)))
    for first, pieces in zip(firsts, ways, strict=True):
        for row, piece in enumerate(pieces):
            moves[row, first : first + 3] = *piece.shift, 0.0 if steers else piece.angle
    inputs = moves[:, robot.input_coordinates]
    if robot.input_size < robot.configuration_size:
        for k, (first, pieces) in enumerate(zip(firsts, ways, strict=True)):
            for row, piece in enumerate(pieces):
                inputs[row, first - k : first - k + 2] = piece.length, piece.angle
    return moves, inputs


def _sideways(robot: Robot, start: Array, goal: Array, via: Sequence[Array]) -> tuple[Array, Array]:
    """Return the motions of a base that moves sideways, straight from point to point, turning as it goes."""
    first = robot.bases[0][0]
    points = np.array([start[first : first + 2], *via, goal[first : first + 2]])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    moves = np.zeros((len(lengths), len(start)))
    moves[:, first : first + 2] = np.diff(points, axis=0)
    moves[:, first + 2] = (goal - start)[first + 2] * lengths / max(lengths.sum(), 1e-9)
    return moves, moves[:, robot.input_coordinates]


def _pieces(drive: Array, start: Array, goal: Array, via: Sequence[Array]) -> list[Piece]:
    """Return the pieces of the way of one drive."""
    if drive[TURNING_RADIUS] > 0:
        return arcs_and_lines(start, goal, WIDER * drive[TURNING_RADIUS])
    return turns_and_lines(start, goal, via)


def _wheels_of_bases(rollers: Array) -> list[Array]:
    """Return the rows of a table of wheels with rollers base by base."""
    return [rollers[rollers[:, 0] == first] for first in np.unique(rollers[:, 0])]


def _least_durations(robot: Robot, inputs: Array, fraction: float, acceleration: Array) -> Array:
    """Return how long motions of minimum jerk take at least, with their share of speeds, rims and accelerations."""
    ways, limits = np.abs(inputs), fraction * robot.limits.velocity
    unlimited = (ways.max(axis=0, initial=0.0) > 0) & np.isinf(limits)
    if unlimited.any():
        name = robot.input_names[int(unlimited.argmax())]
        raise ValueRangeError(f"robot: {name} of {robot.name} has no velocity limit to plan with")
    share = ways / limits
    if robot.input_size < robot.configuration_size:
        for k, drive in enumerate(robot.drives):
            v = int(drive[0]) - k
            both = (ways[:, v] > 0) & (ways[:, v + 1] > 0)
            rim = ways[:, v] + drive[RIM_LEVER] * ways[:, v + 1]
            share[both, v] = rim[both] / limits[v]
    for rows in _wheels_of_bases(robot.rollers):
        j = int(rows[0, 0])
        straight = np.hypot(rows[:, 2], rows[:, 3]).max() * np.hypot(ways[:, j], ways[:, j + 1])
        rims = (straight + np.abs(rows[:, 4]).max() * ways[:, j + 2]) / fraction
        share[:, j] = np.maximum(share[:, j], rims)  # whichever way the base faces
    lasts = np.maximum(PEAK_SPEED * share, np.sqrt(_PEAK_ACCELERATION * _RAMP * share))
    lasts = np.maximum(lasts, np.sqrt(_PEAK_ACCELERATION * ways / (fraction * acceleration)))
    return lasts.max(axis=1, initial=0.0)
