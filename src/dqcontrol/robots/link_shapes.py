"""The shapes of a robot's links, and which of them are kept apart."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.geometry import Box, Capsule, Shape, Sphere, distance_kernels as kernels
from dqcontrol.robots.poses import compose, inverse7, pose8

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


@dataclass(frozen=True)
class LinkShape:
    """A shape that a link carries.

    Attributes
    ----------
    name
        Of the shape; several of one link are LINK.1, LINK.2, ….
    frame
        0 for what stands still, k for what moves with joint k, counted from 1: row k − 1 of `Robot.frames`.
    shape
        In that frame.
    """

    name: str
    frame: int
    shape: Sphere | Capsule | Box

    @property
    def link(self) -> str:
        """Name of the link that carries it, which people know."""
        link, _, part = self.name.rpartition(".")
        return link if link and part.isdecimal() else self.name

    @cached_property
    def extent(self) -> float:
        """Largest distance of a point of it from the origin of its frame, m."""
        shape = self.shape
        if isinstance(shape, Sphere):
            return float(np.linalg.norm(shape.center)) + shape.radius
        if isinstance(shape, Capsule):
            return float(max(np.linalg.norm(shape.start), np.linalg.norm(shape.end))) + shape.radius
        center, half = shape.row[4:7], shape.row[1:4]
        return float(np.linalg.norm(center) + np.linalg.norm(half))


@dataclass(frozen=True)
class LinkShapes:
    """All shapes of a robot, and the pairs of them that are kept apart.

    Attributes
    ----------
    shapes
        In any order.
    pairs
        Indices of two shapes each.

    Raises
    ------
    ShapeError, ValueRangeError
        If two shapes have one name, or a pair names none.
    """

    shapes: tuple[LinkShape, ...]
    pairs: tuple[tuple[int, int], ...] = ()

    def __post_init__(self) -> None:
        names = [each.name for each in self.shapes]
        for name in names:
            if names.count(name) > 1:
                raise ValueRangeError(f"shapes: two of them have the name '{name}'")
        for a, b in self.pairs:
            if not (0 <= a < len(names) and 0 <= b < len(names) and a != b):
                raise ShapeError(
                    f"pairs: expected two different shapes of 0 … {len(names) - 1}, got {a}, {b}"
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the shapes."""
        return tuple(each.name for each in self.shapes)

    @property
    def links(self) -> tuple[str, ...]:
        """Of each shape the link that carries it."""
        return tuple(each.link for each in self.shapes)

    def index(self, field: str, name: str) -> int:
        """Return the number of a shape by its name, or say that there is none such."""
        if name not in self.names:
            raise unknown_name(field, name, self.names)
        return self.names.index(name)

    def moved(self, robot: Robot, q: Array) -> list[Shape]:
        """Return all shapes where a configuration takes them, shape (n,), rad or m."""
        frames = robot.frames(q)
        return [
            each.shape if each.frame == 0 else each.shape.moved(frames[each.frame - 1])
            for each in self.shapes
        ]

    def apart(self, robot: Robot, configurations: Array) -> Array:
        """Return the least distance of all pairs at configurations (N, n), m, shape (N,); ∞ without pairs."""
        rows = moved_rows(robot, configurations, self.shapes)
        least = np.full(len(configurations), np.inf)
        found = np.empty((len(configurations), kernels.FOUND))
        for a, b in self.pairs:
            kernels.distances(rows[a], rows[b], found)
            np.minimum(least, found[:, kernels.DISTANCE], out=least)
        return least


def moved_rows(robot: Robot, configurations: Array, shapes: Sequence[LinkShape]) -> list[Array]:
    """Return the numbers of each shape at configurations (N, n), shape (N, 16)."""
    frames = algebra.matrix_from_pose(robot.frames(configurations))
    return [_moved_row(each, frames) for each in shapes]


def _moved_row(shape: LinkShape, frames: Array) -> Array:
    row = shape.shape.row
    rows = np.tile(row, (len(frames), 1))
    if shape.frame == 0:
        return rows
    turn, shift = frames[:, shape.frame - 1, :3, :3], frames[:, shape.frame - 1, :3, 3]
    if row[0] == kernels.ROUND:
        rows[:, 2:5] = turn @ row[2:5] + shift
        rows[:, 5:8] = turn @ row[5:8]
    else:
        rows[:, 4:7] = turn @ row[4:7] + shift
        rows[:, 7:] = (turn @ row[7:].reshape(3, 3)).reshape(-1, 9)
    return rows


def shapes_in_a_row(parts: Iterable[tuple[int, LinkShapes | None]]) -> LinkShapes | None:
    """Return the shapes of parts that stand on each other, each with the number of its first coordinate.

    Those of different parts are kept apart unless they are neighbours: what stands on a part, and that.
    """
    found = LinkShapes(())
    for first, own in parts:
        if own is not None:
            prefix = "" if set(own.names).isdisjoint(found.names) else f"{first}."
            count = len(found.shapes)
            later = [LinkShape(prefix + each.name, each.frame + first, each.shape) for each in own.shapes]
            pairs = [
                (a, count + b)
                for a, before in enumerate(found.shapes)
                for b, after in enumerate(own.shapes)
                if before.frame > 0 and after.frame > 1
            ]
            moved = [(a + count, b + count) for a, b in own.pairs]
            found = LinkShapes((*found.shapes, *later), (*found.pairs, *moved, *pairs))
    return found if found.shapes else None


def carried_shapes(shapes: LinkShapes | None, before: Array, after: Array) -> LinkShapes | None:
    """Return an arm's shapes where the pose (7,) of its first joint became another, as something carries its base."""
    if shapes is None or np.array_equal(before, after):
        return shapes
    move = pose8(compose(after, inverse7(before)))
    moved = tuple(
        each if each.frame else LinkShape(each.name, 0, each.shape.moved(move)) for each in shapes.shapes
    )
    return LinkShapes(moved, shapes.pairs)


def mirrored_shapes(shapes: LinkShapes | None, flips: Array) -> LinkShapes | None:
    """Return shapes in frames whose axes are reflected: a sign of each axis of each frame (0: the base's)."""
    if shapes is None:
        return None
    return LinkShapes(
        tuple(
            LinkShape(each.name, each.frame, _flipped(each.shape, flips[each.frame]))
            for each in shapes.shapes
        ),
        shapes.pairs,
    )


def _flipped(shape: Sphere | Capsule | Box, flip: Array) -> Sphere | Capsule | Box:
    if isinstance(shape, Sphere):
        return Sphere(shape.center * flip, shape.radius)
    if isinstance(shape, Capsule):
        return Capsule(shape.start * flip, shape.end * flip, shape.radius)
    center, rotation = shape.row[4:7], shape.row[7:].reshape(3, 3)
    turned = algebra.rotation_from_matrix(flip[:, None] * rotation * flip)
    return Box(algebra.pose(turned, center * flip), shape.size)
