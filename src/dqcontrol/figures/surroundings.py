"""Obstacles and zones of constraints in figures, in space and seen along a direction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints.constraint_view import Surroundings
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, InfiniteCylinder, Plane, Shape, Sphere
from dqcontrol.loop.signals import DISTANCE
from dqcontrol.world.body import poses_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist

    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.loop.record import Record

_SOLID, _ZONE = "#8c5aa6", "#2e8b57"
_STRONG, _FAINT = 0.45, 0.15  # opacity where a thing was nearest, and where it was at first
_AROUND = 25  # corners of a circle
_CAP = 7  # circles of half a sphere
_ROOM = 0.25  # of the longest extent of what else is drawn: how far beyond it things are shown
_BELOW = 1e-3  # m: what of a thing is shown below the floor
_STANDS = 1e-9  # m
_PARALLEL = 1e-9  # sine of the angle between an axis and a wall
_ROUNDING = 1e-9  # of a size
_EDGE_ON = 0.02  # sine of the angle below which a plane is seen as a line
_OVER_GRID = 0.6  # Matplotlib draws grids at 0.5, curves at 2
_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


class DrawnFaces(NamedTuple):
    """The faces of a thing that are near a path.

    Attributes
    ----------
    faces
        Polygons, shapes (k, 3), m.
    is_zone
        Whether it bounds a zone.
    strength
        Opacity.
    plane
        Normal of a plane, shape (3,); None of a solid.
    label
        What the legend says of it.
    """

    faces: list[Array]
    is_zone: bool
    strength: float
    plane: Array | None
    label: str


def faces_near(constraints: Constraints | None, points: Array, record: Record) -> list[DrawnFaces]:
    """Return what constraints have near points (N, 3), m, cut off a little beyond them.

    What moves appears twice: faint where it was at first, and strong where it was nearest to the robot in a run.
    """
    if constraints is None or not len(points):
        return []
    around = Surroundings(constraints)
    low, high = points.min(axis=0), points.max(axis=0)
    room = _ROOM * max(float((high - low).max()), 0.1)
    ground = min(float(low[2]), 0.0) - _BELOW
    low, high = low - room, high + room
    low[2] = max(low[2], ground)
    size = float(np.linalg.norm(high - low) + np.linalg.norm(0.5 * (low + high)))
    found = []
    times = record.time[[_nearest_sample(record, thing.name) for thing in around.things]]
    every_shift = around.shifts(np.concatenate([record.time[[0, -1]], times]))
    for k, (thing, time) in enumerate(zip(around.things, times.tolist(), strict=True)):
        first, last, nearest = every_shift[k, [0, 1, 2 + k]]
        plane = thing.shape.normal if isinstance(thing.shape, Plane) else None
        label = "zone" if thing.is_zone else "obstacle"
        shown = [(nearest, _STRONG, label)]
        if max(np.abs(last - first).max(), np.abs(nearest - first).max()) > _STANDS:
            shown = [
                (first, _FAINT, f"{thing.name} at the start"),
                (nearest, _STRONG, f"{thing.name}, nearest at {time:.3g} s"),
            ]
        for shift, strength, words in shown:
            every = faces_of(thing.shape, size)
            if isinstance(thing.shape, Cylinder):
                every = _round(*_inside(thing.shape, low - shift, high - shift), thing.shape.radius, 1)
            if near := _near((face + shift for face in every), low, high):
                found.append(DrawnFaces(near, thing.is_zone, strength, plane, words))
    readings = {name: signal.values[[0, -1]] for name, signal in record.readings.items()}
    for name, body in around.free.items():
        poses = poses_of(name, body, record.time[[0, -1]], readings)
        for pose, strength, when in ((poses[0], _FAINT, "start"), (poses[1], _STRONG, "end")):
            faces = (face for shape in body.own_shapes for face in faces_of(shape.moved(pose), size))
            if near := _near(faces, low, high):
                found.append(DrawnFaces(near, False, strength, None, f"{name} at the {when}"))
    return found


def _near(faces: Iterable[Array], low: Array, high: Array) -> list[Array]:
    """Return what of faces lies inside a box."""
    return [face for face in (_cut(each, low, high) for each in faces) if len(face) > 2]


def _nearest_sample(record: Record, name: str) -> int:
    """Return the sample at which a thing was nearest to what keeps away from it; the last one if that is not known."""
    signal = record.readings.get(DISTANCE)
    if signal is None or name not in signal.parts or not np.isfinite(signal.values).any():
        return len(record) - 1
    return int(np.nanargmin(signal.values[:, signal.parts.index(name)]))


def _inside(cylinder: Cylinder, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the ends of the longest piece of a cylinder that ends in a box with its whole caps, or ends beyond it."""
    axis = cylinder.end - cylinder.start
    length = float(np.linalg.norm(axis))
    along = axis / length
    inset = cylinder.radius * np.sqrt(np.maximum(1 - along**2, 0.0))
    low, high = low + inset, high - inset
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = np.sort(np.stack([low - cylinder.start, high - cylinder.start]) / along, axis=0)
    across = np.abs(along) < _PARALLEL
    first = max(float(np.where(across, 0.0, bounds[0]).max()), 0.0)
    last = min(float(np.where(across, length, bounds[1]).min()), length)
    if first >= last:  # only its rim may be inside
        first, last = 0.0, length
    middle, half = 0.5 * (first + last), 0.5 * (last - first)
    half *= 1 - _ROUNDING  # caps on a wall of the box are kept
    return cylinder.start + (middle - half) * along, cylinder.start + (middle + half) * along


def corners_of(drawn: Sequence[DrawnFaces]) -> Array:
    """Return all corners of faces, shape (N, 3), m."""
    return np.vstack([np.zeros((0, 3)), *(face for each in drawn for face in each.faces)])


def draw_in_space(axes: Any, drawn: Sequence[DrawnFaces]) -> None:
    """Draw faces into axes in space."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    for each in drawn:
        sheet = each.plane is not None or each.is_zone
        faces = Poly3DCollection(
            each.faces,
            facecolors=_colour(each),
            alpha=0.3 * each.strength if sheet else each.strength,
            shade=not sheet,
        )
        axes.add_collection3d(faces, autolim=False)


def draw_flat(axes: Any, drawn: Sequence[DrawnFaces], onto: Array) -> None:
    """Draw faces projected onto two directions, shape (2, 3), behind everything; planes only where they are lines."""
    from matplotlib.collections import PolyCollection

    for each in drawn:
        colour = _colour(each)
        if each.plane is None:
            flat = [face @ onto.T for face in each.faces]
            pale = _pale(colour, each.strength)
            axes.add_collection(PolyCollection(flat, fc=pale, ec=pale, lw=0.4, zorder=_OVER_GRID))
        elif np.linalg.norm(onto @ each.plane) ** 2 > 1 - _EDGE_ON**2:
            at, normal = onto @ each.faces[0].mean(axis=0), onto @ each.plane
            axes.axline(
                at, at + 0.01 * np.array([-normal[1], normal[0]]), color=colour, lw=1.0, zorder=_OVER_GRID
            )


def entries(drawn: Sequence[DrawnFaces]) -> list[Artist]:
    """Return the legend's entries of what is drawn."""
    from matplotlib.patches import Patch

    kinds = {each.label: each for each in reversed(drawn)}
    return [
        Patch(fc=_colour(each), alpha=each.strength, label=label) for label, each in reversed(kinds.items())
    ]


def faces_of(shape: Shape, size: float) -> Iterator[Array]:
    """Yield polygons that show a shape; of one without end as much as ``size``, m, each way."""
    if isinstance(shape, Sphere):
        yield from _round(shape.center, shape.center, shape.radius, _CAP)
    elif isinstance(shape, Capsule):
        yield from _round(shape.start, shape.end, shape.radius, _CAP)
    elif isinstance(shape, Cylinder):
        yield from _round(shape.start, shape.end, shape.radius, 1)
    elif isinstance(shape, InfiniteCylinder):
        along = size * shape.direction
        yield from _round(shape.point - along, shape.point + along, shape.radius, 1)
    elif isinstance(shape, Box):
        half, center, turn = shape.row[1:4], shape.row[4:7], shape.row[7:].reshape(3, 3)
        for axis in range(3):
            for side in (-1.0, 1.0):
                corners = np.insert(_CORNERS.astype(float), axis, side, axis=1)
                yield center + (corners * half) @ turn.T
    elif isinstance(shape, Hull):
        yield from shape.corners[shape.faces]
    elif isinstance(shape, Plane):
        middle = shape.offset * shape.normal
        yield middle + size * _CORNERS @ shape.axes[:, :2].T


def _round(start: Array, end: Array, radius: float, cap: int) -> Iterator[Array]:
    """Yield the faces of a capsule, or of a cylinder if ``cap`` is 1."""
    length = float(np.linalg.norm(end - start))
    along = (end - start) / length if length > 1e-12 else np.array([0.0, 0.0, 1.0])
    across = np.linalg.svd(along[None])[2][1:]
    tilt = np.linspace(0, np.pi / 2, cap)
    heights = np.concatenate([-radius * np.sin(tilt[::-1]), length + radius * np.sin(tilt)])
    radii = radius * np.concatenate([np.cos(tilt[::-1]), np.cos(tilt)])
    angles = np.linspace(0, 2 * np.pi, _AROUND)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across
    rings = start + heights[:, None, None] * along + radii[:, None, None] * circle
    yield rings[0]
    yield rings[-1]
    for below, above in pairwise(rings):
        for i in range(_AROUND - 1):
            yield np.array([below[i], below[i + 1], above[i + 1], above[i]])


def _cut(face: Array, low: Array, high: Array) -> Array:
    """Return what of a convex polygon (k, 3) lies inside a box, by Sutherland and Hodgman's method."""
    for axis in range(3):
        for sign, bound in ((1.0, high[axis]), (-1.0, -low[axis])):
            room = bound - sign * face[:, axis]
            kept: list[Array] = []
            for i in range(len(face)):
                k = i - 1
                if (room[i] < 0) != (room[k] < 0):
                    kept.append(face[k] + room[k] / (room[k] - room[i]) * (face[i] - face[k]))
                if room[i] >= 0:
                    kept.append(face[i])
            if not kept:
                return np.zeros((0, 3))
            face = np.array(kept)
    return face


def _colour(each: DrawnFaces) -> str:
    return _ZONE if each.is_zone else _SOLID


def _pale(colour: str, strength: float) -> tuple[float, ...]:
    """Return how a colour looks through which white shows."""
    from matplotlib.colors import to_rgb

    return tuple(1 - strength * (1 - part) for part in to_rgb(colour))
