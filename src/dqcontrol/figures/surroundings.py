"""Obstacles and zones of constraints in figures, in space and seen along a direction."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.geometry import Box, Capsule, Cylinder, InfiniteCylinder, Plane, Shape, Sphere
from dqcontrol.laws.constrained.kept_scene import Surroundings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist

    from dqcontrol.laws.constrained.constraints import Constraints

_SOLID, _ZONE = "#8c5aa6", "#2e8b57"
_STRONG, _FAINT = 0.45, 0.15  # opacity where a thing is at last, and where it was at first
_AROUND = 25  # corners of a circle
_CAP = 7  # circles of half a sphere
_ROOM = 0.5  # of the longest extent of what else is drawn: how far beyond it things are shown
_BELOW = 1e-3  # m: what of a thing is shown below the floor
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
    """

    faces: list[Array]
    is_zone: bool
    strength: float
    plane: Array | None


def faces_near(constraints: Constraints | None, points: Array, times: Array) -> list[DrawnFaces]:
    """Return what constraints have near points (N, 3), m, cut off a little beyond them.

    What moves appears twice: faint at the first time, s, and strong at the last.
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
    for thing, shifts in zip(around.things, around.shifts(times[[0, -1]]), strict=True):
        moves = bool(np.abs(np.diff(shifts, axis=0)).max() > 1e-9)
        for shift, strength in zip(shifts[0 if moves else 1 :], (_FAINT, _STRONG)[not moves :], strict=True):
            cut = [_cut(face + shift, low, high) for face in faces_of(thing.shape, size)]
            plane = thing.shape.normal if isinstance(thing.shape, Plane) else None
            near = [face for face in cut if len(face) > 2]
            if near:
                found.append(DrawnFaces(near, thing.is_zone, strength, plane))
    return found


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

    moves = " (faint: at the start)" if any(each.strength == _FAINT for each in drawn) else ""
    kinds = {each.is_zone for each in drawn}
    found: list[Artist] = []
    if False in kinds:
        found.append(Patch(fc=_SOLID, alpha=_STRONG, label=f"obstacle{moves}"))
    if True in kinds:
        found.append(Patch(fc=_ZONE, alpha=_STRONG, label="zone"))
    return found


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
