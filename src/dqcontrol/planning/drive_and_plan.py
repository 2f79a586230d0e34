"""Goals of arms on bases that cannot move sideways: the base drives, and the arm sets off before that arrives."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple, TypeAlias

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import NoteWarning, PlanError, UnreachableGoalError, as_array
from dqcontrol.geometry import FloorMap
from dqcontrol.planning.base_path import MARK, BasePath, SteeredPaths, floor_kept, narrow_passes, proved
from dqcontrol.planning.certified_edges import CertifiedEdges, driven_coordinates
from dqcontrol.planning.constraint_timing import WayTiming, constraint_timing, is_braked
from dqcontrol.planning.plan import EFFORT, as_goal, as_law_keeps, checked_start, plan
from dqcontrol.planning.plan_to import PlanTo, limits_of_ways, samples_of
from dqcontrol.planning.smooth_way import SmoothWay
from dqcontrol.planning.standing_world import standing
from dqcontrol.references import drive_to
from dqcontrol.references.drive_through import DriveThrough
from dqcontrol.references.reference import NO_CORNERS
from dqcontrol.references.set_points import GripperStep, held_by_steps
from dqcontrol.references.ways_around import WaysAround, across, folded_posture
from dqcontrol.robots import Robot, postures
from dqcontrol.robots.kinematics.driving import TURNING_RADIUS
from dqcontrol.world import World

_PLACES = 16  # where the base may stand, that are planned from: an arm's plan that fails takes about a second
_NARROW_PLACES = 4  # of these, through passes that are narrow
_WORD = 20  # edges: what it takes to look at arcs and lines of a base that steers
_BEGINS = 9  # instants at which base and arm may set off, that are looked at: an eighth of what may be gained
_STANDS = 1e-9  # rad or m: a fold that is none


class _Leg(NamedTuple):
    """A part of the way: of the base or of the arm alone, from a time on."""

    way: SmoothWay | BasePath
    timing: WayTiming
    begin: float

    @property
    def end(self) -> float:
        return self.begin + float(self.timing.times[-1])

    def lengths(self, times: Array) -> Array:
        return self.timing.at(np.maximum(times - self.begin, 0.0))[0]

    def at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return configurations, rates of the coordinates that inputs move, and their rates, (N, n) each."""
        length, speed, rate = self.timing.at(np.maximum(times - self.begin, 0.0))
        moves = ((times >= self.begin) & (times <= self.end))[:, None]
        q, along, bend = self.way.at(length)
        u, change = along * speed[:, None], bend * speed[:, None] ** 2 + along * rate[:, None]
        return q, np.where(moves, u, 0.0), np.where(moves, change, 0.0)


@dataclass(frozen=True, eq=False, repr=False)
class DriveAndPlan(drive_to.PlannedWay):
    """The motion of a robot whose base drives and whose arm sets off before that arrives; from `drive_and_plan`.

    Parameters
    ----------
    legs
        What base and arm go, each with its own timing.
    arm
        The last of these, with what is proved of all of the way as its certificate.

    Attributes
    ----------
    driven, begins
        How long it takes until the base rests at its goal, and until the arm sets off to its goal, s.
    """

    plans_around = True

    legs: tuple[_Leg, ...]
    arm: PlanTo
    robot: Robot = field(init=False)
    driven: float = field(init=False)
    begins: float = field(init=False)

    def __post_init__(self) -> None:
        vars(self).update(
            robot=self.arm.robot,
            duration=max(leg.end for leg in self.legs),
            corners=NO_CORNERS,
            driven=max(leg.end for leg in self.legs if isinstance(leg.way, BasePath)),
            begins=self.legs[-1].begin,
        )

    def __str__(self) -> str:
        """Return what becomes of it, in a line."""
        goes_on = f"the arm sets off after {self.begins:.3g} s"
        return f"{self.driven:.3g} s of driving, {goes_on}, {self.duration:.3g} s in all; {self.arm.plan}"

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        return self._at(as_array("times", times))[0]

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        moved = sum(
            leg.way.driven(leg.lengths(begins + period)) - leg.way.driven(leg.lengths(begins))
            for leg in self.legs
        )
        return np.asarray(moved)[:, self.robot.input_coordinates] / period

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        q, u, change = self._at(times)
        return samples_of(self.robot, q, u, change)

    def gone(self, times: Array) -> tuple[Array, Array]:
        """Return configurations (N, n), and how far each input has gone back and forth, (N, m)."""
        gone = sum(leg.way.travelled(leg.lengths(times)) for leg in self.legs)
        return self._at(times)[0], np.asarray(gone)[:, self.robot.input_coordinates]

    def _at(self, times: Array) -> tuple[Array, Array, Array]:
        """Return configurations (N, n), inputs and their rates (N, m): each leg moves what no other moves meanwhile."""
        found = [leg.at(times) for leg in self.legs]
        starts = [leg.way.at(np.zeros(1))[0] for leg in self.legs]
        q = starts[0] + sum(each[0] - start for each, start in zip(found, starts, strict=True))
        u, change = (sum(each[k] for each in found) for k in (1, 2))
        inputs = self.robot.input_coordinates
        return q, np.asarray(u)[:, inputs], np.asarray(change)[:, inputs]


def drive_and_plan(
    robot: Robot,
    constraints: Constraints | PreparedConstraints,
    start: ArrayLike,
    goal: ArrayLike | DualQuaternion,
    seed: int = 0,
    effort: int = EFFORT,
    *,
    clearance: float = 0.0,
    speed_fraction: float = 0.9,
    approach: float = 0.9,
) -> PlanTo | DriveAndPlan:
    """Return the way of a robot whose base cannot move sideways to a goal of its end effector.

    Where the arm reaches the goal from where the base stands, only the arm goes. Else the base drives as by `DriveTo`,
    with its arm folded, to the nearest place from which a plan of the arm leads on; one that steers, where these ways
    are blocked, on others of such arcs and lines. Base and arm are timed as `PlanTo`
    times, each on its own path; the base sets off while the arm still folds, and the arm to its goal while the base
    still drives, as early as all of the way is proved to keep the constraints and the law lets all of it pass.

    Parameters
    ----------
    robot
        With one base that cannot move sideways.
    constraints, start, goal, seed, effort, clearance
        As of `plan`.
    speed_fraction, approach
        As of `PlanTo`; of the driving, too.

    Raises
    ------
    PlanError
        If there is no way: why not from the last place that was tried.
    Error
        If the robot has several bases, or nothing says how wide it is.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    >>> board = dqc.world.Body(box=(0.25, 0.8, 0.02), position=(2.0, 0.6, 0.45))
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"board": board}), clear_of="all", acceleration=5)
    >>> below = robot.fkm([1.52, 0.6, 0, 0, -0.49, 1.04, 0, 0])
    >>> way = dqc.planning.drive_and_plan(robot, keep, start, dqc.DualQuaternion(below))
    >>> bool((robot.fkm(way.configurations([way.duration])[0]) @ below) ** 2 > 0.999)
    True
    """
    kept, target = as_law_keeps(robot, constraints), as_goal(robot, goal)
    edges = CertifiedEdges(robot, kept, clearance)
    first = checked_start(edges, as_array("start", start, (robot.configuration_size,)))
    edges, kept = edges.eased_at(first), edges.kept

    def planned(q: Array, to: Array | DualQuaternion) -> PlanTo:
        found = plan(robot, kept, q, to, seed, effort, clearance=clearance)
        return PlanTo(found, speed_fraction, approach)

    try:
        return planned(first, target)
    except PlanError as error:
        if isinstance(target, np.ndarray) and error.reason != "unreachable":
            raise
        last = error
        if error.reason == "unreachable":  # from where the base stands, which says nothing of others
            last = PlanError("plan: no way of the base was found to where the arm reaches the goal", "effort")
    driven = driven_coordinates(robot)
    folded = np.where(driven, first, folded_posture(robot, first))
    folds = [] if np.abs(folded - first).max() < _STANDS else [planned(first, folded)]
    limits = limits_of_ways(robot, kept, speed_fraction)
    for tried, path in enumerate(_paths(edges, first, folded, target, speed_fraction, seed, effort)):
        try:
            arm = planned(path.at(path.begins[-1:])[0][0], target)
        except PlanError as error:
            last = error
        else:
            timing = constraint_timing(path, kept, *limits, approach)
            way = _without_pauses(edges, folds, path, timing, arm)
            if way is not None:
                return way
        if tried + 1 == _PLACES:
            break
    raise last


def _without_pauses(
    edges: CertifiedEdges, folds: list[PlanTo], path: BasePath, timing: WayTiming, arm: PlanTo
) -> DriveAndPlan | None:
    """Return the way on which base and arm set off as early as it keeps everything; None if none does."""
    before = [_Leg(each.plan.way, each.timing, 0.0) for each in folds]
    folding = before[0].end if before else 0.0
    base = _Leg(path, timing, folding)
    if before:
        for begin in np.linspace(0.0, folding, _BEGINS)[:-1]:
            sooner = base._replace(begin=float(begin))
            if _proved(edges, (*before, sooner), arm) is not None:
                base = sooner
                break
    earliest = min(max(folding, base.end - arm.duration), base.end)
    for begin in np.linspace(earliest, max(base.end, folding), _BEGINS):
        legs = (*before, base, _Leg(arm.plan.way, arm.timing, float(begin)))
        if (way := _proved(edges, legs, arm)) is not None:
            return way
    return None


def _proved(edges: CertifiedEdges, legs: tuple[_Leg, ...], arm: PlanTo) -> DriveAndPlan | None:
    """Return the way of some legs if it keeps what is asked, all of it, and the law lets it pass."""
    way = DriveAndPlan(legs, arm)
    count = max(2, int(way.duration / MARK) + 1)
    room = edges.least_room_on(way.gone, np.linspace(0.0, way.duration, count))
    if room.least < 0:
        return None
    kept = edges.kept
    _, _, brake = limits_of_ways(edges.robot, kept, 1.0)
    samples = np.arange(0.0, way.duration, kept.period)
    u = way.mean_inputs(samples, kept.period)
    if is_braked(kept, way.configurations(samples), u, brake[edges.robot.input_coordinates]).any():
        return None
    proved = replace(arm.plan.certificate, room=room.least, label=room.label)
    return replace(way, arm=replace(arm, plan=replace(arm.plan, certificate=proved)))


def _paths(
    edges: CertifiedEdges,
    start: Array,
    folded: Array,
    goal: Array | DualQuaternion,
    speed_fraction: float,
    seed: int,
    effort: int,
) -> Iterator[BasePath]:
    """Yield paths of the base to where the arm, folded, is near a goal, proved to keep all that is kept."""
    robot, given = edges.robot, edges.kept.given
    found = goal[None] if isinstance(goal, np.ndarray) else _reaching(robot, start, goal)
    clear = edges.room_at(found)[0] >= 0
    driven = driven_coordinates(robot)
    places = np.where(driven, found[clear] if clear.any() else found, folded)
    places = places[edges.room_at(places)[0] >= 0]
    reachable, limits = places, (speed_fraction, given.acceleration)
    floor = floor_kept(edges.kept)
    if floor is not None:
        drive_to.check_around(robot, start, floor)
        places = drive_to.clear_of_floor(floor, robot, places, drive_to.CLEARANCE)
        ways = chain(
            drive_to.ways_around(drive_to.DriveTo, robot, start, places, limits, floor, drive_to.CLEARANCE),
            _narrow_ways(edges, folded, reachable, limits, floor),
        )
    else:
        ways = (drive_to.DriveTo(robot, start, place, *limits) for place in places)
    first = int(robot.drives[0, 0])
    for way in ways:
        path = BasePath(folded, first, way.base_pieces)
        if len(path.pieces) and proved(edges, path):
            yield path
    if floor is not None:
        yield from _steered_ways(edges, folded, reachable, floor, seed, effort)


def _steered_ways(
    edges: CertifiedEdges, start: Array, places: Array, floor: FloorMap, seed: int, effort: int
) -> Iterator[BasePath]:
    """Yield paths of a base that steers to the nearest places, straight on through narrow passes."""
    robot, first = edges.robot, int(edges.robot.drives[0, 0])
    if len(robot.bases) != 1 or robot.drives[0, TURNING_RADIUS] == 0:
        return
    steered = SteeredPaths(edges, start, drive_to.WIDER * robot.drives[0, TURNING_RADIUS])
    for place in _nearest(places, start, first):
        passes = narrow_passes(edges, floor, start, place)
        poses = [each[first : first + 3] for each in chain([start], *passes, [place])]
        path = steered.to(poses, seed, effort // _WORD)
        if path is not None and len(path.pieces):
            yield path


def _nearest(places: Array, start: Array, first: int) -> Array:
    """Return the places, as many as are tried through narrow passes, that are nearest to where the base starts."""
    near = np.linalg.norm(places[:, first : first + 2] - start[first : first + 2], axis=1)
    return places[np.argsort(near, kind="stable")[:_NARROW_PLACES]]


def _narrow_ways(
    edges: CertifiedEdges,
    start: Array,
    places: Array,
    limits: tuple[float, ArrayLike | None],
    floor: FloorMap,
) -> Iterator[drive_to.DriveTo]:
    """Yield ways to the nearest places through what is so narrow that a base has to be led straight on."""
    robot, first = edges.robot, int(edges.robot.drives[0, 0])
    if (robot.drives[:, TURNING_RADIUS] > 0).any():
        return
    radius, here = across(robot, start) + edges.kept.given.margin, start[first : first + 2]
    for place in _nearest(places, start, first):
        via: list[Array] = []
        at = here
        passes = [
            (a[first : first + 2], b[first : first + 2]) for a, b in narrow_passes(edges, floor, start, place)
        ]
        for begin, end in [*passes, (place[first : first + 2], None)] if passes else []:
            corners = np.vstack([at, begin, *floor.polygons])
            within = np.array([corners.min(axis=0) - 1.0, corners.max(axis=0) + 1.0])
            between = WaysAround(floor, at, radius, within).to(begin)
            if between is None:
                break
            via += between if end is None else [*between, begin, end]
            at = begin if end is None else end
        else:
            if via:
                yield drive_to.DriveTo(robot, start, place, *limits, via=via)


def _reaching(robot: Robot, start: Array, goal: DualQuaternion) -> Array:
    try:
        return drive_to.goal_configurations(robot, start, goal.vec8, drive_to.AROUND_TRIES)
    except UnreachableGoalError as error:
        raise PlanError(f"goal: {error}", "unreachable") from None


# A step from a configuration, (n,), in a world, with what is kept then.
Step: TypeAlias = Callable[[Robot, Array, World | None, PreparedConstraints], drive_to.PlannedWay]


class _Gone(NamedTuple):
    """Steps so far: their ways and the pauses behind them, where they end and when, and what the gripper did."""

    ways: tuple[drive_to.PlannedWay, ...]
    pauses: tuple[float, ...]
    q: Array
    time: float
    gripper: tuple[GripperStep, ...]


class StepsInTurn:
    """Plans steps from a start configuration, (n,), on; each lasts whole periods, the end of it at rest."""

    def __init__(self, robot: Robot, kept: PreparedConstraints, world: World | None, start: Array) -> None:
        self._robot, self._kept, self._world = robot, kept, world
        self._gone = _Gone((), (), start, 0.0, ())

    @property
    def way(self) -> DriveThrough:
        """All of them, as one; what is proved of its plans is told."""
        for way in self._gone.ways:
            if isinstance(way, PlanTo | DriveAndPlan):
                warnings.warn(
                    f"plan: {way.plan if isinstance(way, PlanTo) else way}", NoteWarning, stacklevel=2
                )
        return DriveThrough(self._gone.ways, self._gone.pauses)

    def go(self, steps: Sequence[Step]) -> None:
        """Go on by steps, of which only the first may be a plan.

        If it leads to a pose, from where the others do not go, to the nearest configuration there from which they do.

        Raises
        ------
        PlanError
            If there is no way.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NoteWarning)  # of plans that lead nowhere
            first = self._then(self._gone, steps[0])
            try:
                self._gone = self._all(first, steps[1:])
            except PlanError as error:
                way = first.ways[-1]
                if not isinstance(way, PlanTo) or not isinstance(way.plan.goal, DualQuaternion):
                    raise
                self._gone = self._elsewhere(way, way.plan.goal, steps[1:], error)

    def _elsewhere(self, way: PlanTo, goal: DualQuaternion, steps: Sequence[Step], error: PlanError) -> _Gone:
        """Return steps by another configuration at the goal of the first of them, or raise the error."""
        old = way.plan
        found = [each.q for each in postures(self._robot, goal.vec8, seed=old.certificate.seed)]
        for q in sorted(found, key=lambda q: float(np.linalg.norm(q - self._gone.q))):
            try:
                self._all(self._gone._replace(q=q), steps)  # which is quick, and mostly says no
                options = (old.certificate.seed, old.effort)
                other = plan(self._robot, old.kept, self._gone.q, q, *options, clearance=old.clearance)
                first = self._after(self._gone, PlanTo(other, way.speed_fraction, way.approach))
                return self._all(first, steps)
            except PlanError:
                continue
        raise error

    def _all(self, gone: _Gone, steps: Sequence[Step]) -> _Gone:
        for step in steps:
            gone = self._then(gone, step)
        return gone

    def _then(self, gone: _Gone, step: Step) -> _Gone:
        world, kept = self._world, self._kept
        if kept.given.world is not None and gone.time > 0:
            bodies = held_by_steps(kept.given.world.bodies, gone.gripper)
            still = standing(msgspec.structs.replace(kept.given, world=World(bodies=bodies)), gone.time)
            kept = kept.of(still)
            world = World(bodies={**bodies, **(still.world.bodies if still.world else {})})
        return self._after(gone, step(self._robot, gone.q, world, kept))

    def _after(self, gone: _Gone, way: drive_to.PlannedWay) -> _Gone:
        period = self._kept.period
        whole = period * math.ceil(way.duration / period - 1e-9)
        gripper = tuple(each.later(gone.time) for each in way.gripper_steps)
        return _Gone(
            (*gone.ways, way),
            (*gone.pauses, max(whole - way.duration, 0.0)),
            way.configurations([way.duration])[0],
            gone.time + whole,
            (*gone.gripper, *gripper),
        )
