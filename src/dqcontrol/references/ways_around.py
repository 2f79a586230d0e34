"""Ways of bases around what stands on a floor, and the posture in which an arm takes least room on the way."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.geometry import Box, Capsule, FloorMap, Sphere
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.bases import RollerBase
from dqcontrol.robots.collision_shapes import known_shapes
from dqcontrol.robots.robot import base_coordinates

_CELL = 0.05  # m
_MOST_CELLS = 100_000  # larger rooms have larger cells
_CLOSER = 9  # points across a cell, 6 mm apart
_POSTURES, _LOOKED_AT = 2000, 100  # that are tried, and of these looked at closely
_WORTH = 0.01  # m; of room, to move the arm for
_LINK = 0.04  # m; half the width of links whose shapes are not known
_SPACED = 0.02  # m; between points of such links
_BALL = 0.06  # m; edge of the cubes in which a box is cut, which stand out of it by 22 mm
_ABOVE = 0.03  # m; of a folded arm above its base
# m; of shapes from each other: twice what constraints keep, which keep more the longer a period is
_APART = 0.02
_STEPS = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j]


class BodyPoints(NamedTuple):
    """Points of a robot and how far its material is from them at most, as planning sees it."""

    points: Array  # (N, 3), m
    radius: Array  # (N,), m
    carried: NDArray[np.bool_]  # (N,), whether the arm moves them


class WaysAround:
    """Short ways of a disc from one place to any other, that keep out of everything.

    Found on a grid of 5 cm [Dijkstra 1959], then straightened: from each point to the farthest one that it sees. Cells
    whose middle is too near to something are looked at more closely: a passage may be narrower than they are.

    Parameters
    ----------
    floor
        What to keep out of.
    start
        (x, y), m.
    radius
        Of the disc, m.
    within
        Two corners (2, 2) of the area that ways may lead through, m.
    """

    def __init__(self, floor: FloorMap, start: Array, radius: float, within: Array) -> None:
        self.floor = floor
        self.start = start
        self.radius = radius
        extent = within[1] - within[0]
        self._low, self._cell = within[0], max(_CELL, math.sqrt(float(np.prod(extent)) / _MOST_CELLS))
        shape = np.ceil(extent / self._cell).astype(int) + 1
        xs, ys = (within[0][i] + self._cell * np.arange(shape[i]) for i in range(2))
        grid = np.stack(np.meshgrid(xs, ys, indexing="ij"), axis=-1).reshape(-1, 2)
        clear = np.concatenate(
            [floor.clearance(part) for part in np.array_split(grid, 1 + len(grid) // 4096)]
        )
        begin = self._cell_of(start)
        near = np.flatnonzero((clear < radius) & (clear >= radius - self._cell / math.sqrt(2)))
        grid[near], clear[near] = self._roomiest(grid[near], clear[near])
        self._places = grid.reshape(*shape, 2)
        free = (clear >= radius).reshape(shape)
        free[begin] = True
        self._lengths = _lengths_from(free, begin)

    def to(self, goal: Array) -> list[Array] | None:
        """Return the points between start and goal, each (2,), m; None if there is no way on the grid."""
        if self.floor.line_clearance(self.start, goal[None])[0] >= self.radius:
            return []
        if self.floor.clearance(goal[None])[0] < self.radius:
            return None
        here = min(
            (each for each in self._around(goal) if self._is_reached(each)),
            key=lambda each: self._off(each, goal),
            default=None,
        )
        if here is None:
            return None
        cells = [here]
        while self._lengths[here] > 0.0:
            here = self._before(here)
            cells.append(here)
        inner = np.array([self._places[each] for each in cells[-2::-1]]).reshape(-1, 2)
        return self._straightened(np.vstack([self.start, inner, goal]))

    def _roomiest(self, places: Array, clear: Array) -> tuple[Array, Array]:
        """Return of each of some cells the point that is farthest from everything, and how far."""
        places, clear = places.copy(), clear.copy()
        middles, steps = places.copy(), self._cell * (np.arange(_CLOSER) / (_CLOSER - 1) - 0.5)
        for dx in steps:
            for dy in steps:
                tried = middles + np.array([dx, dy])
                found = np.concatenate(
                    [self.floor.clearance(part) for part in np.array_split(tried, 1 + len(tried) // 4096)]
                )
                better = found > clear
                places[better], clear[better] = tried[better], found[better]
        return places, clear

    def _cell_of(self, point: Array) -> tuple[int, int]:
        i, j = np.round((point - self._low) / self._cell).astype(int).tolist()
        return i, j

    def _is_reached(self, cell: tuple[int, int]) -> bool:
        i, j = cell
        rows, columns = self._lengths.shape
        return 0 <= i < rows and 0 <= j < columns and math.isfinite(self._lengths[cell])

    def _before(self, cell: tuple[int, int]) -> tuple[int, int]:
        """Return the cell before another on a shortest way; of several the one nearest to the start."""
        i, j = cell
        beside = {(i + k, j + m): math.hypot(k, m) for k, m in _STEPS if self._is_reached((i + k, j + m))}
        return min(beside, key=lambda each: (self._lengths[each] + beside[each], self._lengths[each], each))

    def _around(self, point: Array) -> list[tuple[int, int]]:
        i, j = self._cell_of(point)
        return [(i, j), *((i + k, j + m) for k, m in _STEPS)]

    def _off(self, cell: tuple[int, int], point: Array) -> float:
        return float(np.linalg.norm(self._low + self._cell * np.array(cell) - point))

    def _straightened(self, points: Array) -> list[Array] | None:
        """Return the inner points of a way from each point to the farthest that it sees."""
        kept, at = [], 0
        while at < len(points) - 1:
            # between two free cells a corner may come nearer than at them, by a tenth of a cell
            seen = self.floor.line_clearance(points[at], points[at + 1 :]) >= self.radius - 0.1 * self._cell
            if not seen.any():
                return None
            at += 1 + int(np.flatnonzero(seen)[-1])
            kept.append(points[at])
        return kept[:-1]


def _lengths_from(free: NDArray[np.bool_], start: tuple[int, int]) -> Array:
    """Return the length of a shortest way to each cell over eight neighbours each, in cells; infinite without one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    number = np.arange(free.size).reshape(free.shape)
    links = []
    for i, j in _STEPS:
        here, there = _overlap(i, j), _overlap(-i, -j)
        both = free[here] & free[there]
        ends = number[here][both], number[there][both]
        links.append((*ends, np.full(len(ends[0]), math.hypot(i, j))))
    rows, columns, lengths = map(np.concatenate, zip(*links, strict=True))
    graph = coo_array((lengths, (rows, columns)), shape=(free.size, free.size)).tocsr()
    return np.asarray(dijkstra(graph, indices=number[start])).reshape(free.shape)


def _overlap(i: int, j: int) -> tuple[slice, slice]:
    """Return the part of a grid whose cells have a neighbour (i, j) cells farther."""
    along, across = (slice(max(0, -k), -k if k > 0 else None) for k in (i, j))
    return along, across


def body_points(robot: Robot, q: Array) -> BodyPoints:
    """Return points of a robot at a configuration (n,): of its shapes, else of straight links between its joints."""
    frames = robot.frames(q)
    last = int(np.flatnonzero(base_coordinates(robot))[-1]) + 1  # frame of the base
    points: list[Array] = []
    radii: list[float] = []
    carried: list[bool] = []

    def add(places: Array, radius: float, moves: bool) -> None:
        points.extend(places)
        radii.extend([radius] * len(places))
        carried.extend([moves] * len(places))

    known = known_shapes(robot)
    for each in known:
        if not each.frame:
            continue
        shape = each.shape.moved(frames[each.frame - 1])
        if isinstance(shape, Capsule):
            add(_between(shape.start, shape.end), shape.radius, each.frame > last)
        elif isinstance(shape, Sphere):
            add(shape.center[None], shape.radius, each.frame > last)
        elif isinstance(shape, Box):
            add(*_balls(shape), each.frame > last)
    base = robot.parts[0] if isinstance(robot, WholeBody) else None
    if isinstance(base, RollerBase) and all(carried):
        add(*_balls(base.around_wheels.moved(frames[last - 1])), False)
    if known and not all(carried):  # a body on wheels: they may stand out of it
        for _, _, radius, half_track, *_ in robot.drives[:1]:
            hubs = np.array(
                [[end, side * half_track, radius] for side in (-1, 1) for end in (-radius, radius)]
            )
            hubs = _moved(frames[last - 1], hubs)
            add(np.vstack([_between(*hubs[:2]), _between(*hubs[2:])]), 0.0, False)
    if not any(carried):
        places = algebra.translation(frames[last:])
        for a, b in pairwise(places):
            add(_between(a, b), _LINK, True)
    return BodyPoints(np.array(points).reshape(-1, 3), np.array(radii), np.array(carried, dtype=bool))


def _balls(box: Box) -> tuple[Array, float]:
    """Return the middles of balls that cover a box, (N, 3), and their radius, m."""
    size = np.asarray(box.size)
    counts = np.ceil(size / _BALL).astype(int)
    axes = [edge * ((np.arange(count) + 0.5) / count - 0.5) for edge, count in zip(size, counts, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return _moved(np.asarray(box.pose), grid), 0.5 * float(np.linalg.norm(size / counts))


def _moved(pose: Array, points: Array) -> Array:
    matrix = algebra.matrix_from_pose(pose)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def _between(a: Array, b: Array) -> Array:
    count = max(2, math.ceil(float(np.linalg.norm(b - a)) / _SPACED) + 1)
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def room_of(floor: FloorMap, robot: Robot, configurations: Array) -> float:
    """Return the least distance of a robot from what stands on the floor, at configurations (N, n), m."""
    least = math.inf
    for q in configurations:
        body = body_points(robot, q)
        low = body.points[:, 2] - body.radius < floor.height
        if low.any():
            least = min(least, float((floor.clearance(body.points[low, :2]) - body.radius[low]).min()))
    return least


def itself_apart(robot: Robot, configurations: Array) -> NDArray[np.bool_]:
    """Return at which configurations (N, n) a robot's shapes stay apart from each other, shape (N,)."""
    if robot.shapes is None:
        return np.ones(len(configurations), dtype=bool)
    return robot.shapes.apart(robot, configurations) >= _APART


def across(robot: Robot, q: Array) -> float:
    """Return the radius of the least disc about the middle of a robot's base that holds all of it, m."""
    body = body_points(robot, q)
    first = int(np.flatnonzero(base_coordinates(robot))[0])
    away = np.linalg.norm(body.points[:, :2] - q[first : first + 2], axis=1)
    return float((away + body.radius).max())


def folded_posture(robot: Robot, start: Array) -> Array:
    """Return a configuration (n,) with the base where it is and the arm in little room: of random ones, the least disc.

    Joints keep 5 % of their range from their limits, and the arm stays above the base and off itself.
    """
    lower, upper = robot.limits.lower, robot.limits.upper
    fixed = base_coordinates(robot) | ~np.isfinite(upper - lower)
    low, high = np.where(fixed, start, lower), np.where(fixed, start, upper)
    tried = np.random.default_rng(0).uniform(
        low + 0.05 * (high - low), high - 0.05 * (high - low), (_POSTURES, len(start))
    )
    tried[0] = start
    tried = tried[itself_apart(robot, tried)]
    standing = body_points(robot, start)
    tops = standing.points[~standing.carried, 2]
    top = float(tops.max()) + _ABOVE if len(tops) else _ABOVE
    places = algebra.translation(robot.frames(tried))[:, np.flatnonzero(base_coordinates(robot))[-1] + 1 :]
    first = int(np.flatnonzero(base_coordinates(robot))[0])
    away = np.linalg.norm(places[..., :2] - start[first : first + 2], axis=-1).max(axis=-1)
    best, least = start, across(robot, start)
    for q in tried[np.argsort(away)[:_LOOKED_AT]]:
        body = body_points(robot, q)
        if (body.points[body.carried, 2] - body.radius[body.carried]).min(initial=math.inf) < top:
            continue
        if (room := across(robot, q)) < least - _WORTH:
            best, least = q, room
    return np.array(best)
