"""Ways between configurations whose straight edge is blocked: RRT-Connect [Kuffner and LaValle 2000] of OMPL."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, from_extra
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.robots.robot import base_coordinates

WHAT = "ways around what blocks the straight one"
# rad or m: longest edge of the trees. Of 131 problems of MotionBenchMaker 128 are solved with it, 127 with OMPL's own
# choice, a fifth of the space's extent.
_RANGE = 1.5
_AROUND = 3.0  # m: so far beyond start and goals a base without limits looks for ways
_TURN = math.pi  # rad: the same of joints without limits


class WaySearch(NamedTuple):
    """What a search found.

    Attributes
    ----------
    way
        Configurations, shape (K, n); empty if it found none.
    edges
        How many it looked at.
    nearest
        The configuration nearest to a goal that it came to, shape (n,).
    """

    way: Array
    edges: int
    nearest: Array


def search(edges: CertifiedEdges, start: Array, goals: Array, seed: int, effort: int) -> WaySearch:
    """Return a way from a configuration (n,) to one of several, (G, n), all of them clear, by its certified edges.

    Parameters
    ----------
    edges
        What an edge is asked for.
    start, goals
        Within the limits.
    seed
        Of the random configurations: the same one gives the same way.
    effort
        How many edges it looks at, at most.

    Raises
    ------
    MissingExtraError
        If OMPL is not installed.
    ValueRangeError
        If a joint that slides has no limits.
    """
    ob = from_extra("ompl.base", "plan", WHAT)
    n, looked = len(start), 0
    a, b = np.empty(n), np.empty(n)

    def is_clear(first: Any, second: Any) -> bool:
        nonlocal looked
        looked += 1
        a[:], b[:] = first[0:n], second[0:n]
        return edges.is_clear(a, b)

    space = bounded(ob.RealVectorStateSpace(n), *_bounds(edges, np.vstack([start, goals])))
    states = [_state(space, q) for q in (start, *goals)]
    problem = connected(space, is_clear, states[0], states[1:], seed, lambda: looked >= effort)
    found = problem.getSolutionPath()
    if found is None:
        return WaySearch(np.empty((0, n)), looked, start)
    way = np.array([state[0:n] for state in found.getStates()])
    if problem.hasExactSolution():
        return WaySearch(way, looked, way[-1])
    return WaySearch(np.empty((0, n)), looked, way[-1])


def bounded(space: Any, lower: Array, upper: Array) -> Any:
    """Return a space of OMPL's with bounds of its numbers, shape (n,)."""
    bounds = from_extra("ompl.base", "plan", WHAT).RealVectorBounds(len(lower))
    for i, (low, high) in enumerate(zip(lower.tolist(), upper.tolist(), strict=True)):
        bounds.setLow(i, low)
        bounds.setHigh(i, high)
    space.setBounds(bounds)
    return space


def connected(
    space: Any,
    is_clear: Callable[[Any, Any], bool],
    start: Any,
    goals: list[Any],
    seed: int,
    is_over: Callable[[], bool],
) -> Any:
    """Return OMPL's problem of states of a space as RRT-Connect, by motions that are clear, leaves it."""
    ob, og, ou = (from_extra(f"ompl.{part}", "plan", WHAT) for part in ("base", "geometric", "util"))
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)  # 0 is none to it

    class Motions(ob.MotionValidator):
        def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802 — as OMPL calls it
            return is_clear(first, second)

    information = ob.SpaceInformation(space)
    information.setMotionValidator(Motions(information))
    information.setStateValidityChecker(_every_state)  # motions are looked at with their ends
    information.setup()
    problem = ob.ProblemDefinition(information)
    problem.addStartState(start)
    targets = ob.GoalStates(information)
    for goal in goals:
        targets.addState(goal)
    problem.setGoal(targets)
    planner = og.RRTConnect(information)
    planner.setRange(_RANGE)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(ob.PlannerTerminationCondition(is_over))
    return problem


def _every_state(_: object) -> bool:
    return True


def _state(space: Any, q: Array) -> Any:
    state = space.allocState()
    for i, value in enumerate(q):
        state[i] = float(value)
    return state


def _bounds(edges: CertifiedEdges, ends: Array) -> tuple[Array, Array]:
    """Return within which bounds configurations are drawn, shapes (n,): the limits, or what is around the ends."""
    robot = edges.robot
    low, high = ends.min(axis=0), ends.max(axis=0)
    carried = base_coordinates(robot)
    around = np.array([_TURN if kind == "revolute" else _AROUND for kind in robot.joint_types])
    for i, kind in enumerate(robot.joint_types):
        unlimited = not (math.isfinite(edges.lower[i]) and math.isfinite(edges.upper[i]))
        if unlimited and kind == "prismatic" and not carried[i]:
            raise ValueRangeError(
                f"plan: {robot.joint_names[i]} of {robot.name} has no limits to plan within"
            )
    lower = np.where(np.isfinite(edges.lower), edges.lower, low - around)
    upper = np.where(np.isfinite(edges.upper), edges.upper, high + around)
    return np.minimum(lower, low), np.maximum(upper, high)
