"""Contacts with what has no body in physics: floor, tables, walls, obstacles, and the robot itself."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints.constraint_view import Surroundings
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.errors import CollisionWarning
from dqcontrol.experiments.contact_kernels import pair_distances
from dqcontrol.geometry import Capsule, Plane, Shape, Sphere, distance_kernels as kernels
from dqcontrol.loop.record import Record
from dqcontrol.plants import MobilePlant, Plant
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import Robot, SerialArm, TwoArms, WholeBody
from dqcontrol.robots.bases import CLEARANCE, Chassis, DifferentialDrive, RollerBase
from dqcontrol.robots.collision_shapes import known_shapes
from dqcontrol.robots.files.urdf import UrdfTree
from dqcontrol.robots.files.urdf_xml import CheckedXml
from dqcontrol.robots.link_shapes import LinkShape, moved_rows
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.world import World

HAND = "end effector"
_UPRIGHT = math.cos(math.radians(10))  # of a first axis: bases that people put up are not level to a degree
_SHOULDER = 0.03  # m above the base frame; of an arm whose base frame lies in its shoulder it is 0
# m: links of the file so far below the base frame say that it does not stand on anything there
_BELOW = -0.01
_TOUCH = 1e-6  # m: what stands on the floor or rests against a wall is that near by rounding, and goes through nothing
_FIRST_LOOK = 17  # samples; between them only what may have touched is looked at
_MOST_KEPT = 1_000_000  # numbers of a run, 8 MB
_FEW = 30_000  # distances, which take a second in Python: less than their kernel takes to compile


class Contact(NamedTuple):
    """Where two shapes went deepest into each other.

    Attributes
    ----------
    words
        As ``"in the table: panda_link6"``.
    depth
        m, positive.
    time
        s.
    """

    words: str
    depth: float
    time: float


class _Watched(NamedTuple):
    """Two shapes that are to stay apart.

    Attributes
    ----------
    first, second
        The shapes; what stands still has frame 0.
    words
        As of `Contact`.
    shifts
        Of the second one at times (K,), s: (K, 3), m, NaN while it is not there; None if it does not move by itself.
    """

    first: LinkShape
    second: LinkShape
    words: str
    shifts: Callable[[Array], Array] | None = None


class Contacts:
    """What a robot is not to go through, though nothing stops it there.

    A robot's links are the shapes that it has; of one without, the origins of its joints and the end effector. On a
    mobile base it stands on the floor z = 0. An arm does so if it stands upright: its first axis is vertical, its
    shoulder lies above z = 0, and no link of its file that stands still lies below. So what is mounted at a ceiling or
    a wall, or begins at a torso or in a shoulder, has no floor, and one whose ``base`` lifts it has the floor below.
    Where constraints of an arm have a plane with the free side above, that is its floor or table.

    Parameters
    ----------
    robot
        What moves.
    constraints
        Of its law: links that an obstacle does not name are watched here, as are the shapes that are not kept apart
        by it.
    plant
        What moves it.
    world
        What stands around it; of plants that let links touch it, their readings say what they touched.
    fitted
        Whether the shapes that are fitted to a mobile robot's file count, as its way was planned with them.
    """

    def __init__(
        self,
        robot: Robot,
        constraints: Constraints | None = None,
        plant: Plant | None = None,
        world: World | None = None,
        *,
        fitted: bool = False,
    ) -> None:
        robot = robot if plant is None else plant.body_of(robot)
        self._robot = robot
        base = np.flatnonzero(base_coordinates(robot))
        # The frame that something on the base has.
        self._first = int(base[-1]) + 2 if len(base) and base[0] == 0 else 1
        self._bodies = _bodies(robot, self._first, fitted=fitted)
        self._moving = [each for each in self._bodies if each.frame > 0]
        carried = [each for each in self._moving if each.frame >= self._first]
        self._carried = [each for each in carried if self._first > 1 or robot.parents[each.frame - 1] >= 0]
        self._levers = _levers(robot, self._bodies)
        in_physics = world is not None and plant is not None and plant.touches_world
        self._watched = [] if in_physics else [*self._floor(constraints, world), *self._itself(constraints)]
        if not in_physics:
            self._watched += [*self._obstacles(constraints), *self._bodies_of(world, constraints)]
        shapes = list({id(each): each for pair in self._watched for each in pair[:2]}.values())
        number = {id(each): k for k, each in enumerate(shapes)}
        wide = max((len(each.shape.row) for each in shapes), default=kernels.SHAPE)
        self._shapes: Array = np.zeros((len(shapes), 1 + wide))
        for row, each in zip(self._shapes, shapes, strict=True):
            row[0], row[1 : 1 + len(each.shape.row)] = each.frame, each.shape.row
        self._pairs: Array = np.array(
            [[number[id(a)], number[id(b)]] for a, b, *_ in self._watched], np.float64
        )
        self._moved = {number[id(b)]: shifts for _, b, _, shifts in self._watched if shifts is not None}
        self._work = np.empty((len(shapes), wide)), np.empty(kernels.FOUND)
        self._free: tuple[Array, float] | None = None  # configurations of a run, and its room all the way, m

    def of_run(self, record: Record) -> list[Contact]:
        """Return where a run went through something, the deepest first."""
        if not np.isfinite(record.q).all():
            return []
        found: list[Contact] = []
        if self._watched and not self._has_room(record.q):
            for i, depth, k in self._deepest(record):
                found.append(Contact(self._watched[i].words, depth, float(record.time[k])))
        if (chassis := _chassis(self._robot)) is not None:
            inside = _inside(chassis, record.q, record.position)
            if inside[k := int(inside.argmax())] > _TOUCH:
                found.append(Contact(f"in its own base: {HAND}", float(inside[k]), float(record.time[k])))
        # Of a link's shapes the deepest stands for it.
        deepest = {each.words: each for each in sorted(found, key=lambda contact: contact.depth)}
        return list(reversed(deepest.values()))

    def _has_room(self, q: Array) -> bool:
        """Return whether a run is nearer to one that touched nothing than that was to anything: studies have many."""
        if self._free is None or self._free[0].shape != q.shape:
            return False
        other, room = self._free
        return float(np.abs(q - other).max(axis=0) @ self._levers) < room

    def _deepest(self, record: Record) -> Iterator[tuple[int, float, int]]:
        """Yield of the pairs that touched each other number and depth, m, and at which sample.

        Two shapes come nearer by no more than the sum of the ways of what the joints carry. Where that may have closed
        the gap between two samples that were looked at, the one in the middle is looked at, too, and so on.
        """
        q, time = record.q, record.time
        look = len(q) if self._moved else min(_FIRST_LOOK, len(q))
        at = (np.arange(look) * (len(q) - 1) / max(look - 1, 1)).astype(np.intp)
        way, steps = np.zeros(len(q)), q[1:] - q[:-1]
        np.cumsum(np.abs(steps, out=steps) @ self._levers, out=way[1:])
        values = self._distances(q[at], time[at])
        while True:
            nearest = 0.5 * (values[:-1] + values[1:] - np.diff(way[at])[:, None])
            least = np.minimum(values.min(axis=0), 0.0)
            unsure = (nearest < least).any(axis=1)
            if not unsure.any() or not (unsure := unsure & (np.diff(at) > 1)).any():
                break
            new = (at[:-1][unsure] + at[1:][unsure]) // 2
            at = np.concatenate([at, new])
            values = np.vstack([values, self._distances(q[new], time[new])])
            order = np.argsort(at, kind="stable")
            at, values = at[order], values[order]
        room = float(nearest.min(initial=values.min()))
        if room > 0.0 and not self._moved and q.size <= _MOST_KEPT:
            self._free = q, room
        for i in np.flatnonzero(least < -_TOUCH):
            k = int(values[:, i].argmin())
            yield int(i), -float(values[k, i]), int(at[k])

    def _distances(self, q: Array, time: Array) -> Array:
        """Return the distance of each pair at configurations (K, n), shape (K, P), m."""
        frames = np.ascontiguousarray(self._robot.frames(q)).reshape(len(q), -1)
        out = np.empty((len(q), len(self._watched)))
        find = pair_distances.worth_compiling(out.size, _FEW)
        find(frames, self._shapes, self._pairs, self._shifts(time), *self._work, out)
        return out

    def _shifts(self, time: Array) -> Array:
        """Return how far each shape has moved by itself, shape (K, 3 S), m; empty if none does."""
        found = np.zeros((len(time) if self._moved else 0, 3 * len(self._shapes)))
        for k, shifts in self._moved.items():
            found[:, 3 * k : 3 * k + 3] = shifts(time)
        return found

    def _floor(self, constraints: Constraints | None, world: World | None) -> Iterator[_Watched]:
        world = world or (constraints.world if constraints else None)
        planes = (shape for _, shape in world.shapes if isinstance(shape, Plane)) if world else ()
        tops = [plane for plane in planes if plane.normal[2] > 0]
        if self._first > 1 or (_stands(self._robot) and not tops):
            floor = _still("floor", Plane(np.array([0.0, 0.0, 1.0]), 0.0))
            for each in self._carried:
                yield _Watched(each, floor, f"through the floor: {each.link}")

    def _itself(self, constraints: Constraints | None) -> Iterator[_Watched]:
        """Yield the pairs that the robot's file keeps apart, but those of a chassis whose capsule is round on top."""
        shapes = self._robot.shapes
        if shapes is None or (constraints is not None and constraints.self_collision is not False):
            return
        for a, b in shapes.pairs:
            first, second = shapes.shapes[a], shapes.shapes[b]
            chassis = [each for each in (first, second) if 0 < each.frame < self._first]
            if not any(isinstance(each.shape, Capsule) for each in chassis):
                yield _Watched(first, second, f"in itself: {first.link} and {second.link}")

    def _obstacles(self, constraints: Constraints | None) -> Iterator[_Watched]:
        """Yield the links that obstacles of constraints do not name, but those that ``hand`` stands for."""
        if constraints is None:
            return
        around, k = Surroundings(constraints), 0
        wrist = self._around_the_hand()
        for name, obstacle in constraints.obstacles.items():
            if name in constraints.held:
                continue
            for shape in obstacle.shapes:
                moves = obstacle.moves.velocity is not None or obstacle.moves.path is not None
                shifts = (lambda times, k=k: around.shifts(times)[k]) if moves else None
                still, k = _still(name, shape), k + 1
                others = self._carried if isinstance(shape, Plane) else self._moving
                named = {*wrist, *(obstacle.clear.links or ())}
                for each in others if obstacle.clear.links is not None else []:
                    if named.isdisjoint((each.name, each.link)):
                        yield _Watched(each, still, f"in {name}: {each.link}", shifts)

    def _bodies_of(self, world: World | None, constraints: Constraints | None) -> Iterator[_Watched]:
        """Yield all links and the bodies that constraints do not keep clear of, but those that physics alone moves."""
        kept = constraints.cleared if constraints is not None and constraints.world is not None else ()
        for name, body in () if world is None else world.bodies.items():
            if name in kept or body.is_recorded or body.role == "springy":
                continue
            shifts = None if body.moves is None else body.moves.shifts
            for shape in body.shapes:
                still = _still(name, shape)
                for each in self._carried if isinstance(shape, Plane) else self._moving:
                    words = "through the" if isinstance(shape, Plane) else "in"
                    yield _Watched(each, still, f"{words} {name}: {each.link}", shifts)

    def _around_the_hand(self) -> set[str]:
        """Return the names of the end effectors and of the links that they lie in."""
        ends = [each for each in self._bodies if each.name.startswith(HAND)]
        q = np.zeros((1, self._robot.configuration_size))
        points, rows = moved_rows(self._robot, q, ends), moved_rows(self._robot, q, self._moving)
        found, names = np.empty((1, kernels.FOUND)), {each.name for each in ends}
        for each, row in zip(self._moving, rows, strict=True):
            for point in points:
                kernels.distances(point, row, found)
                if found[0, kernels.DISTANCE] <= 0:
                    names.add(each.name)
        return names


def check_floor(robot: Robot, start: Array, samples: Array) -> None:
    """Warn if a hand on a mobile base starts inside the base or below the floor, or is to go below it.

    Parameters
    ----------
    robot, start
        Where it starts, shape (n,).
    samples
        Desired motion, shape (N, 21), inertial frame.
    """
    if not isinstance(robot, WholeBody) or not base_coordinates(robot)[0]:
        return
    hand = algebra.translation(robot.fkm(start))
    chassis = _chassis(robot)
    inside = max(-hand[2], -np.inf if chassis is None else _inside(chassis, start[None], hand[None])[0])
    if inside > 0:
        warnings.warn(
            f"start: the hand of {robot.name} is {1e3 * inside:.0f} mm inside its chassis or the floor",
            CollisionWarning,
            stacklevel=4,
        )
    height = algebra.translation(samples[:, POSE])[:, 2]
    lowest = int(height.argmin())
    if height[lowest] < 0:
        warnings.warn(
            f"reference: at t = {samples[lowest, TIME]:.3g} s the hand shall be {-1e3 * height[lowest]:.0f} mm below "
            "the floor (z = 0)",
            CollisionWarning,
            stacklevel=4,
        )


def _chassis(robot: Robot) -> Chassis | None:
    """Return what a robot stands on and its hand must stay out of, if it has that."""
    found = getattr(robot.parts[0], "chassis", None) if isinstance(robot, WholeBody) else None
    return found if isinstance(found, Chassis) else None


def _inside(chassis: Chassis, q: Array, position: Array) -> Array:
    """Return how deep points (N, 3) are in a chassis, an upright cylinder, m; negative beside and above it."""
    beside = chassis.radius - np.linalg.norm(position[:, :2] - q[:, :2], axis=1)
    over = 0.5 * chassis.height - np.abs(position[:, 2] - CLEARANCE - 0.5 * chassis.height)
    return np.minimum(beside, over)


def contacts_of(
    robot: Robot,
    constraints: Constraints | None,
    plant: Plant | None,
    world: World | None = None,
    *,
    fitted: bool = False,
) -> Contacts:
    """Return `Contacts`; those of a robot with nothing around it, which the runs of a study share, are made once."""
    if constraints is not None or world is not None or isinstance(plant, MobilePlant):
        return Contacts(robot, constraints, plant, world, fitted=fitted)
    return _alone(robot if plant is None else plant.body_of(robot))


@lru_cache(maxsize=8)
def _alone(robot: Robot) -> Contacts:
    return Contacts(robot)


def _still(name: str, shape: Shape) -> LinkShape:
    return LinkShape(name, 0, shape)  # type: ignore[arg-type]  # also a plane or an endless cylinder, as none is a link


def _bodies(robot: Robot, first: int, *, fitted: bool) -> list[LinkShape]:
    """Return the shapes of a robot's links, those that are not known as points, and its end effectors as points.

    Shapes are fitted to a mobile robot's file, which takes seconds, only where a map was planned with them.
    """
    own = () if robot.shapes is None else robot.shapes.shapes
    known = list(known_shapes(robot) if fitted else own)
    if not any(each.frame >= first for each in known):
        rows = range(first - 1, len(robot.row_names))
        known += [LinkShape(robot.row_names[k], k + 1, Sphere(np.zeros(3), 0.0)) for k in rows]
    drive = robot.parts[0] if isinstance(robot, WholeBody) else None
    if isinstance(drive, DifferentialDrive) and not any(0 < each.frame < first for each in known):
        axle = np.array([[0.0, side * drive.half_track, drive.wheel_radius] for side in (-1.0, 1.0)])
        known.append(LinkShape("wheels", first - 1, Capsule(axle[0], axle[1], drive.wheel_radius)))
    if isinstance(drive, RollerBase) and not any(0 < each.frame < first for each in known):
        known.append(LinkShape("wheels", first - 1, drive.around_wheels))
    ends = [end for end in robot.ends if end + 1 > 0]
    names = [HAND] if len(ends) == 1 else [f"{HAND} {k + 1}" for k in range(len(ends))]
    return known + [
        LinkShape(name, end + 1, Sphere(np.zeros(3), 0.0)) for name, end in zip(names, ends, strict=True)
    ]


def _levers(robot: Robot, bodies: Sequence[LinkShape]) -> Array:
    """Return how far a point of a robot moves at most per rad or m of each coordinate, shape (n,)."""
    lengths = np.linalg.norm(robot.chain[:, 4:7], axis=1)
    reach = max(each.extent for each in bodies) + np.concatenate([np.cumsum(lengths[::-1])[::-1][1:], [0.0]])
    count, rows = robot.configuration_size, robot.row_coordinates
    turning = np.array([kind == "revolute" for kind in robot.joint_types])
    each = np.where(turning[rows], reach[: len(rows)], 1.0) * np.abs(robot.joint_factors)
    return np.bincount(rows, weights=each, minlength=count).astype(np.float64)


def _stands(robot: Robot) -> bool:
    """Return whether an arm, or each of two, stands upright on z = 0 or above it; see `Contacts`."""
    if isinstance(robot, TwoArms):
        return robot.base is None and all(_stands(arm) for arm in (robot.left, robot.right))
    if not isinstance(robot, SerialArm) or robot.configuration_size < 2:
        return False
    first, second = robot.frames(np.zeros(robot.configuration_size))[:2]
    axis = algebra.matrix_from_pose(first)[2, 2]
    if axis < _UPRIGHT or algebra.translation(second)[2] < _SHOULDER:
        return False
    if robot.urdf is not None:
        return _lowest_link(*robot.urdf, robot.joint_names) >= _BELOW
    placed = {} if robot.placed_links is None else robot.placed_links.frames
    return all(frame.pose[6] >= _BELOW for frame in placed.values() if frame.joint < 0)


@lru_cache
def _lowest_link(path: Path, base_link: str, joints: tuple[str, ...]) -> float:
    """Return the least height of a link that stands still in a URDF file above its base link, m."""
    places = {link: (place, carrier) for link, place, carrier in UrdfTree(CheckedXml(path)).places(joints)}
    to_base = np.linalg.inv(places[base_link][0])
    return min(float((to_base @ place)[2, 3]) for place, carrier in places.values() if carrier == 0)
