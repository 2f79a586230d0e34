"""Plans: ways between two configurations, or to a pose of the hand, that keep constraints all along."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import DualQuaternion
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, kernel, shared
from dqcontrol.constraints import Constraints
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import (
    MissingExtraError,
    PlanError,
    ReachError,
    ShapeError,
    as_array,
    as_count,
    as_positive,
    from_extra,
)
from dqcontrol.planning.base_path import floor_kept, narrow_passes
from dqcontrol.planning.certified_edges import (
    ANSWER,
    CERTIFIED,
    PERIOD,
    CertifiedEdges,
    certify_curve,
    driven_coordinates,
    proof_of,
    standing_at,
)
from dqcontrol.planning.smooth_way import SmoothWay, smooth_way
from dqcontrol.planning.standing_world import standing
from dqcontrol.planning.ways_between import WaySearch, search
from dqcontrol.references.sample import as_pose
from dqcontrol.robots import Robot, nearest_pose, postures

# random shortcuts: of 128 problems of MotionBenchMaker they leave 4.9 of 11.9 rad; 4.2 is straight
_TRIES = 150
_WORTH = 1e-3  # share of a length below which a shortcut is none

# chain, needs, parameters, random numbers (tries, 2), own work, scratch, edge (3 n), way (room, n), count (1)
SHORTEN = STATUS(READ2, READ, READ, READ2, WRITE, WRITE, WRITE, WRITE2, WRITE)


@shared
def _distance(a, b):
    total = 0.0
    for i in range(a.shape[0]):
        total += (b[i] - a[i]) ** 2
    return math.sqrt(total)


@shared
def _is_clear(proof, edge, a, b, answer):
    """Return whether a straight edge is certified."""
    n = a.shape[0]
    for i in range(n):
        edge[i], edge[n + i], edge[2 * n + i] = a[i], 0.5 * (a[i] + b[i]), b[i]
    return certify_curve(proof, edge, -1.0, answer) == OK and answer[CERTIFIED] > 0.0


@shared
def _replace(way, count, first, last, inner):
    """Put as many points as ``inner`` says, which stand behind the way, between two of it; return how many it has."""
    n, end = way.shape[1], way.shape[0] - 2
    move = inner - (last - first - 1)
    if move > 0:
        for k in range(count - 1, last - 1, -1):
            for i in range(n):
                way[k + move, i] = way[k, i]
    elif move < 0:
        for k in range(last, count):
            for i in range(n):
                way[k + move, i] = way[k, i]
    for k in range(inner):
        for i in range(n):
            way[first + 1 + k, i] = way[end + k, i]
    return count + move


@shared
def _leave_out(proof, way, count, edge, answer):
    """Leave out points: from each on the farthest that an edge reaches is the next."""
    first = 0
    while first < count - 2:
        last = count - 1
        while last > first + 1 and not _is_clear(proof, edge, way[first], way[last], answer):
            last -= 1
        count = _replace(way, count, first, last, 0)
        first += 1
    return count


@shared
def _place_at(way, count, share, out):
    """Write the configuration at a share of a way's length, and return the number of the point before it."""
    total = 0.0
    for k in range(count - 1):
        total += _distance(way[k], way[k + 1])
    left = share * total
    for k in range(count - 1):
        length = _distance(way[k], way[k + 1])
        if left <= length or k == count - 2:
            part = min(left / max(length, 1e-12), 1.0)
            for i in range(out.shape[0]):
                out[i] = way[k, i] + part * (way[k + 1, i] - way[k, i])
            return k
        left -= length
    return 0


@kernel(SHORTEN)
def shorten_way(chain, needs, parameters, shares, own, scratch, edge, way, count):
    """Leave points of a way out and join random places of it, where that is certified and shorter."""
    n, end = way.shape[1], way.shape[0] - 2
    proof = proof_of(chain, n, needs, parameters, own, scratch)
    answer = edge[3 * n :]
    points = _leave_out(proof, way, int(count[0]), edge, answer)
    for tried in range(shares.shape[0]):
        if points <= 2:
            break
        low, high = min(shares[tried, 0], shares[tried, 1]), max(shares[tried, 0], shares[tried, 1])
        first = _place_at(way, points, low, way[end])
        last = _place_at(way, points, high, way[end + 1])
        if first == last or points + 2 > end:
            continue
        before, after = _distance(way[first], way[end]), _distance(way[end + 1], way[last + 1])
        old = -before - after
        for k in range(first, last + 1):
            old += _distance(way[k], way[k + 1])
        if _distance(way[end], way[end + 1]) > (1.0 - _WORTH) * old:
            continue
        if _is_clear(proof, edge, way[end], way[end + 1], answer):
            points = _replace(way, points, first, last + 1, 2)
    count[0] = float(_leave_out(proof, way, points, edge, answer))
    return OK


def shortened(edges: CertifiedEdges, way: Array, seed: int) -> Array:
    """Return a way between the same ends, shape (K, n), that is shorter where certified edges allow it."""
    count, n = way.shape
    memory = np.empty((count + 2 * _TRIES + 4, n))
    memory[:count] = way
    points = np.array([float(count)])
    shares = np.random.default_rng(seed).uniform(size=(_TRIES, 2))
    edge = np.empty(3 * n + ANSWER)
    status = shorten_way(*edges.proof, shares, *edges.work, edge, memory, points)
    if status != OK:
        raise ShapeError(f"way: no poses of {edges.robot.name} on it")
    return memory[: int(points[0])].copy()


EFFORT = 20_000  # edges: about a second
_SPARE = 5e-4  # m: more than asked for while planning, so that what is proved does not hang by rounding
_ROUNDING = 1e-9  # rad or m


@dataclass(frozen=True)
class WayCertificate:
    """What is proved of a plan.

    Attributes
    ----------
    room
        The least room beyond what is asked on all of the way as it is gone, m; infinite if nothing stands around.
    label
        The pair that has it, as ``table: panda_link5``.
    edges
        How many edges were looked at.
    seed
        Of the random configurations.
    """

    room: float
    label: str
    edges: int
    seed: int

    def __str__(self) -> str:
        """Return it in a line."""
        least = f"least room {1000 * self.room:.3g} mm beyond what is asked ({self.label})"
        nothing = "nothing stands around"
        counted = "edge" if self.edges == 1 else "edges"
        return f"certified: {least if self.label else nothing}; {self.edges} {counted}, seed {self.seed}"


@dataclass(frozen=True, eq=False)
class ProvedWay:
    """A way that is proved.

    Attributes
    ----------
    robot
        Who goes it.
    kept
        The constraints that it keeps, made ready.
    configurations
        Its points, shape (K, n), rad or m, from start to goal; edges between them are straight.
    way
        The same with blended corners, as it is gone.
    certificate
        What is proved of it; the edges between its points are certified, too.
    took
        What planning took, s; without what the first plan of a process compiles and loads.
    goal, clearance, effort
        As they were asked for: a configuration, shape (n,), or a pose, shape (8,).
    """

    robot: Robot
    kept: PreparedConstraints = field(repr=False)
    configurations: Array
    way: SmoothWay = field(repr=False)
    certificate: WayCertificate
    took: float
    goal: Array | DualQuaternion = field(repr=False)
    clearance: float
    effort: int

    def __str__(self) -> str:
        """Return what is proved of it, and what it took, in a line."""
        points = f"{len(self.configurations)} points, {self.length:.3g} rad"
        return f"{self.certificate}; {points}, {1000 * self.took:.0f} ms"

    @property
    def length(self) -> float:
        """Euclidean length of the way in coordinates, rad or m."""
        return float(self.way.begins[-1])


def plan(
    robot: Robot,
    constraints: Constraints | PreparedConstraints,
    start: ArrayLike,
    goal: ArrayLike | DualQuaternion,
    seed: int = 0,
    effort: int = EFFORT,
    *,
    clearance: float = 0.0,
) -> ProvedWay:
    """Return a way that keeps constraints on all of its length, proved edge by edge; see `CertifiedEdges`.

    The straight edge to the nearest of all goal configurations that it reaches; if it reaches none, RRT-Connect looks
    for a way to any of them, which is then made shorter, and its corners are blended.

    Parameters
    ----------
    robot, constraints
        As of `CertifiedEdges`. What laws with a period of 10 ms keep beyond what is asked, so that it holds between
        their samples too, is kept as well; prepared constraints say for what period and lag.
    start
        Configuration, shape (n,), rad or m. A base that cannot move sideways stays there; see `drive_and_plan`.
    goal
        Configuration, shape (n,), or pose of the hand: a `DualQuaternion`, or shape (8,) if n is not 8. Of a pose all
        configurations count that inverse kinematics finds from 60 seeded starts.
    seed
        Of the random configurations: the same one gives the same way.
    effort
        How many edges it looks at, at most.
    clearance
        Distance beyond what the constraints ask, m.

    Raises
    ------
    PlanError
        If the start violates the constraints (reason ``start``), no configuration has the hand at the goal
        (``unreachable``), those that have it violate the constraints (``goal``), or no way is found (``effort``).
    MissingExtraError
        If OMPL is needed and not installed.
    ShapeError, ValueRangeError
        If a size or number is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, start, goal = dqc.load_robot("panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]
    >>> post = dqc.world.Body(capsule=(0.05, 1.0), position=(0.3, 0.2, 0.5))
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"post": post}), clear_of="all")
    >>> way = dqc.planning.plan(arm, keep, start, goal)
    >>> len(way.configurations) > 2, way.certificate.room >= 0
    (True, True)
    """
    seed, effort = as_count("seed", seed), as_count("effort", effort)
    beyond = as_positive("clearance", clearance, zero_allowed=True)
    given = as_array("start", start, (robot.configuration_size,))
    exact = CertifiedEdges(standing_at(robot, given), as_law_keeps(robot, constraints), beyond)
    first, target = checked_start(exact, given), as_goal(robot, goal)
    if isinstance(target, np.ndarray):
        driven = driven_coordinates(robot)
        if np.abs(target - first)[driven].max(initial=0.0) > _ROUNDING:
            raise PlanError(f"goal: {robot.name} has to drive there; drive_and_plan does that", "unreachable")
    return way_from(exact, first, target, seed, effort, beyond)


def as_law_keeps(robot: Robot, constraints: Constraints | PreparedConstraints) -> PreparedConstraints:
    """Return constraints as laws keep them: by more than is asked, for what happens between samples."""
    if isinstance(constraints, PreparedConstraints):
        return constraints
    return constraints.prepare(robot, PERIOD, "measured")


def as_goal(robot: Robot, goal: ArrayLike | DualQuaternion) -> Array | DualQuaternion:
    """Return a goal as a configuration, (n,), or as a pose, which is never an array."""
    n = robot.configuration_size
    target = goal if isinstance(goal, DualQuaternion) else as_array("goal", goal)
    if isinstance(target, DualQuaternion) or (target.shape == (8,) and n != 8):
        return DualQuaternion(as_pose("goal", target))
    return as_array("goal", target, (n,))


def way_now(
    kept: PreparedConstraints,
    q: Array,
    goal: Array | DualQuaternion,
    when: float,
    seen: Mapping[str, Array],
    seed: int = 0,
    effort: int = EFFORT,
    clearance: float = 0.0,
) -> ProvedWay:
    """Return a way from where a robot is, q (n,), at a time (s), around what its law keeps clear of; see `plan`.

    ``seen`` gives the poses (8,) of bodies that are measured. What is nearer than asked may stay as near.
    """
    robot = kept.robot
    still = kept.of(standing(kept.given, when))
    for name, pose in seen.items():
        still.place(still.parameters, name, pose)
    edges = CertifiedEdges(standing_at(robot, q), still, clearance)
    first = np.clip(q, edges.lower, edges.upper)
    return way_from(edges.eased_at(first), first, goal, seed, effort, clearance)


def way_from(
    exact: CertifiedEdges,
    first: Array,
    goal: Array | DualQuaternion,
    seed: int,
    effort: int,
    clearance: float,
) -> ProvedWay:
    """Return a way from a configuration, (n,), within the limits; see `plan`, which checks all that is given.

    What is nearer there than asked may stay as near.
    """
    _first_use(exact, first)
    begin = time.perf_counter()
    exact = exact.eased_at(first)
    edges = exact.with_more(_SPARE).eased_at(first)
    goals = _goals(edges, first, goal, seed)
    corners, looked = _way(edges, first, goals, seed, effort)
    driven = driven_coordinates(exact.robot)
    corners[:, driven] = first[driven]
    ends = exact.clear(corners[:-1], corners[1:])
    if not ends.certified.all() or np.abs(corners[0] - first).max() > 0:
        raise PlanError("plan: a way was found that is not clear", "effort")
    way = smooth_way(edges, corners)
    if not exact.curves(way.curves).certified.all():
        raise PlanError("plan: a way was found whose blends are not clear", "effort")
    certificate = WayCertificate(*exact.least_room(way.curves), looked, seed)
    took = time.perf_counter() - begin
    return ProvedWay(exact.kept.robot, exact.kept, corners, way, certificate, took, goal, clearance, effort)


def _first_use(edges: CertifiedEdges, q: Array) -> None:
    """Compile and load what plans call, so that the first one of a process takes no longer than others."""
    edges.clear(q, q)
    edges.room_at(q[None])
    edges.robot.manipulability(q)
    edges.robot.solve(edges.robot.fkm(q), q, restarts=0)
    _ = shorten_way.compiled
    with suppress(MissingExtraError):  # the straight way needs none
        from_extra("ompl.geometric", "plan", "ways around")


def checked_start(edges: CertifiedEdges, given: Array) -> Array:
    """Return the start within the limits, or raise with what it violates."""
    q = _within_limits(edges, given, "start", "start")
    kept = edges.kept
    # what is nearer than samples keep, but not than asked, may stay as near: laws start there too
    if kept.labels:
        values = kept.values(q[None], [0.0])[0]
        row = int((values - kept.asked).argmin())
        if values[row] - kept.asked[row] < -_ROUNDING:
            pair = kept.labels[row]
            raise PlanError(f"start: {pair}: {kept.text(row, values[row])}", "start", pair=pair)
    return q


def _within_limits(edges: CertifiedEdges, given: Array, field: str, why: str) -> Array:
    """Return a configuration within the limits, or raise with the joint that is beyond by more than rounding."""
    q = np.clip(given, edges.lower, edges.upper)
    if (off := np.abs(q - given)).max() > _ROUNDING:
        i = int(off.argmax())
        name, limits = edges.robot.joint_names[i], f"{edges.lower[i]:g} … {edges.upper[i]:g}"
        raise PlanError(f"{field}: {name} is {given[i]:g}, outside its limits {limits}", why, pair=name)
    return q


def _goals(edges: CertifiedEdges, start: Array, goal: Array | DualQuaternion, seed: int) -> Array:
    """Return all configurations at the goal that are clear, the nearest to the start first, shape (G, n)."""
    robot = edges.robot
    if isinstance(goal, DualQuaternion):
        try:
            found = np.array([each.q for each in postures(robot, goal.vec8, seed=seed)])
        except ReachError as error:
            nearest = nearest_pose(robot, goal.vec8, start)
            raise PlanError(f"goal: {error}; {nearest}", "unreachable", nearest=nearest) from None
        inside = np.clip(found, edges.lower, edges.upper)
    else:
        inside = _within_limits(edges, goal, "goal", "unreachable")[None]
    rooms, rows = edges.room_at(inside)
    clear = rooms >= 0
    if not clear.any():
        best = int(rooms.argmax())
        row = rows[best]
        pair, count = edges.kept.labels[row], len(inside)
        which = f"the best of {count} configurations there" if count > 1 else "the configuration there"
        raise PlanError(
            f"goal: {which} is not clear: {pair}: {edges.said(inside[best], row)}",
            "goal",
            pair=pair,
            nearest=inside[best],
        )
    kept = inside[clear]
    return kept[np.argsort(np.linalg.norm(kept - start, axis=1), kind="stable")]


def _way(edges: CertifiedEdges, start: Array, goals: Array, seed: int, effort: int) -> tuple[Array, int]:
    """Return the points of a way to one of the goals, and how many edges were looked at."""
    straight = edges.clear(start, goals)
    if straight.certified.any():
        return np.vstack([start, goals[int(straight.certified.argmax())]]), len(goals)
    found = _searched(edges, start, goals, seed, effort)
    looked = len(goals) + found.edges
    if not len(found.way):
        pair = str(straight.label[0])
        raise PlanError(
            f"plan: no way within {looked} edges; {_how_near(edges.robot, found, goals)}; "
            f"the straight way is blocked by {pair}",
            "effort",
            pair=pair,
            nearest=found.nearest,
        )
    return shortened(edges, found.way, seed), looked


def _searched(edges: CertifiedEdges, start: Array, goals: Array, seed: int, effort: int) -> WaySearch:
    """Return what a search finds; of a base that moves sideways then one from narrow pass to narrow pass, and on."""
    if not edges.robot.bases or len(edges.robot.drives):
        return search(edges, start, goals, seed, effort)
    found = search(edges, start, goals, seed, effort // 10)
    if len(found.way):
        return found
    looked, passes = found.edges, narrow_passes(edges, floor_kept(edges.kept), start, goals[0])
    way, each = start[None], effort // (2 * len(passes) + 2)
    for begin, end in passes:
        part = search(edges, way[-1], begin[None], seed, each)
        looked += part.edges
        if not len(part.way):
            break
        way = np.vstack([way, part.way[1:], end])
    else:
        part = search(edges, way[-1], goals, seed, each)
        looked += part.edges
        if len(part.way):
            return WaySearch(np.vstack([way, part.way[1:]]), looked, part.nearest)
    found = search(edges, start, goals, seed, max(effort - looked, 0))
    return found._replace(edges=looked + found.edges)


def _how_near(robot: Robot, found: WaySearch, goals: Array) -> str:
    """Say how near a search came to its goals."""
    away = np.linalg.norm(goals - found.nearest, axis=1)
    here = DualQuaternion(robot.fkm(found.nearest)).translation
    there = DualQuaternion(robot.fkm(goals[int(away.argmin())])).translation
    apart = math.dist(here, there)
    return f"it came within {away.min():.3g} rad of a goal, its hand within {1000 * apart:.3g} mm"
