"""Goals of arms on bases that cannot move sideways: the base drives, then the arm goes on by certified edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import PlanError, UnreachableGoalError, as_array
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.plan import EFFORT, as_goal, as_law_keeps, checked_start, plan
from dqcontrol.planning.plan_to import PlanTo, ResumedWay
from dqcontrol.planning.standing_base import driven_coordinates
from dqcontrol.references.drive_to import (
    AROUND_TRIES,
    CLEARANCE,
    DriveTo,
    PlannedWay,
    check_around,
    clear_of_floor,
    goal_configurations,
    instants_of,
    ways_around,
)
from dqcontrol.references.ways_around import folded_posture
from dqcontrol.robots import Robot
from dqcontrol.world import floor_around, stands

_PLACES = 16  # where the base may stand, that are planned from: an arm's plan that fails takes about a second


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
) -> PlannedWay:
    """Return the way of a robot whose base cannot move sideways to a goal of its end effector.

    Where the arm reaches the goal from where the base stands, only the arm goes. Else the base drives as by `DriveTo`,
    with its arm folded, to the nearest place from which a plan of the arm leads on, and rests there. What is driven is
    looked at each 0.1 s, what the arm goes then is proved.

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
    edges = edges.eased_at(first)

    def planned(q: Array) -> PlanTo:
        found = plan(robot, kept, q, target, seed, effort, clearance=clearance)
        return PlanTo(found, speed_fraction, approach)

    try:
        return planned(first)
    except PlanError as error:
        if isinstance(target, np.ndarray) and error.reason != "unreachable":
            raise
        last = error
    for tried, way in enumerate(_drives(edges, first, target, speed_fraction)):
        try:
            return ResumedWay(way, way.duration, planned(way.configurations([way.duration])[0]))
        except PlanError as error:
            last = error
        if tried + 1 == _PLACES:
            break
    raise last


def _drives(
    edges: CertifiedEdges, start: Array, goal: Array | DualQuaternion, speed_fraction: float
) -> Iterator[DriveTo]:
    """Yield ways to where the arm, folded, is near a goal and clear of what is kept."""
    robot, given = edges.robot, edges.kept.given
    found = goal[None] if isinstance(goal, np.ndarray) else _reaching(robot, start, goal)
    driven = driven_coordinates(robot)
    places = np.where(driven, found, folded_posture(robot, start))
    places = places[edges.room_at(places)[0] >= 0]
    limits = (speed_fraction, given.acceleration)
    bodies = given.world.bodies if given.world else {}
    names = [name for name in given.cleared if stands(bodies[name]) and bodies[name].plane is None]
    if names:
        floor = floor_around(given.world, names, "constraints.clear_of")
        check_around(robot, start, floor)
        places = clear_of_floor(floor, robot, places, CLEARANCE)
        ways = ways_around(DriveTo, robot, start, places, limits, floor, CLEARANCE)
    else:
        ways = (DriveTo(robot, start, place, *limits) for place in places)
    for way in ways:
        if (edges.room_at(instants_of(way))[0] >= 0).all():
            yield way


def _reaching(robot: Robot, start: Array, goal: DualQuaternion) -> Array:
    try:
        return goal_configurations(robot, start, goal.vec8, AROUND_TRIES)
    except UnreachableGoalError as error:
        raise PlanError(f"goal: {error}", "unreachable") from None
