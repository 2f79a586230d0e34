"""Footprints of bodies on the floor: discs and polygons, for bases that drive around them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.geometry import Box, Capsule, Cylinder, FloorMap, Hull, Shape, Sphere, load_map
from dqcontrol.world.body import Body
from dqcontrol.world.world import World

_CORNERS = 32  # of the polygon around a disc

_UPRIGHT = 1e-9  # sine of the angle to the vertical


class Footprint(NamedTuple):
    """What a body takes of the floor, whatever its height.

    Attributes
    ----------
    discs
        Centre x, y and radius, shape (K, 3), m.
    floor
        Its polygons.
    """

    discs: Array
    floor: FloorMap

    def clearance(self, points: Array) -> Array:
        """Return how far points (N, 2), m, are from it, shape (N,); negative inside."""
        apart = np.linalg.norm(points[:, None] - self.discs[:, :2], axis=2) - self.discs[:, 2]
        return np.minimum(self.floor.clearance(points), apart.min(axis=1, initial=np.inf))


def footprint(body: Body) -> Footprint:
    """Return what a body takes of the floor where it stands at the start.

    Upright round shapes are discs, boxes and lying round shapes the hulls of their shadows, maps their own polygons.

    Raises
    ------
    Error
        If a file cannot be read.
    """
    if (as_it_is := _map_as_it_is(body)) is not None:
        return Footprint(np.zeros((0, 3)), as_it_is)
    discs, polygons = [], []
    for shape in body.shapes:
        found = _shadow(shape)
        if found.shape == (3,):
            discs.append(found)
        elif len(found):
            polygons.append(found)
    return Footprint(np.array(discs).reshape(-1, 3), FloorMap(tuple(polygons)))


def floor_around(world: World | None, names: Literal["all"] | Sequence[str], field: str) -> FloorMap:
    """Return what bodies take of the floor as one map, as high as the highest of them.

    Parameters
    ----------
    world
        Which they are in.
    names
        Theirs, or ``all``: those that stand still or give way, planes left out.
    field
        For messages.

    Raises
    ------
    Error
        If there is no world, or no such body, or one that does not stand still, or a file cannot be read.
    """
    bodies = {} if world is None else world.bodies
    if names == "all":
        names = [name for name, body in bodies.items() if stands(body) and body.plane is None]
    for name in names:
        if name not in bodies:
            raise unknown_name(field, name, tuple(bodies))
        if not stands(bodies[name]):
            raise ValueRangeError(f"{field}: '{name}' does not stand still; plans keep clear of what does")
    if not names:
        raise ShapeError(f"{field}: there is nothing in the world that stands on the floor; give 'world'")
    if len(names) == 1 and (found := _map_as_it_is(bodies[names[0]])) is not None:
        return found
    places = [footprint(bodies[name]) for name in names]
    polygons = [polygon for place in places for polygon in place.floor.polygons]
    polygons += [disc[:2] + _rim(float(disc[2])) for place in places for disc in place.discs]
    tops = [_top(shape) for name in names for shape in bodies[name].shapes]
    return FloorMap(tuple(polygons), max(tops))


def stands(body: Body) -> bool:
    """Return whether a body stays where it is, or gives way and comes back."""
    return body.role in ("fixed", "springy") and body.moves is None


def _map_as_it_is(body: Body) -> FloorMap | None:
    moved = any((*body.position, *body.rpy)) or body.parts
    return None if body.map is None or moved else load_map(body.map, body.height)


def _top(shape: Shape) -> float:
    """Return how high a shape reaches, m."""
    if isinstance(shape, Sphere):
        return float(shape.center[2]) + shape.radius
    if isinstance(shape, Capsule | Cylinder):
        along = shape.end - shape.start
        level = np.linalg.norm(along[:2]) / np.linalg.norm(along) if isinstance(shape, Cylinder) else 1.0
        return float(max(shape.start[2], shape.end[2]) + level * shape.radius)
    if isinstance(shape, Hull):
        return float(shape.corners[:, 2].max())
    assert isinstance(shape, Box)
    return float(shape.row[6] + np.abs(shape.row[7:].reshape(3, 3)[2]) @ shape.row[1:4])


def _rim(radius: float) -> Array:
    """Return the corners of a polygon around a disc, a little outside of it, shape (32, 2), m."""
    turn = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    return radius / np.cos(np.pi / _CORNERS) * np.column_stack([np.cos(turn), np.sin(turn)])


def _shadow(shape: Shape) -> Array:
    """Return a disc, shape (3,), or the corners of a polygon, shape (k, 2); none of a plane."""
    if isinstance(shape, Sphere):
        return np.array([*shape.center[:2], shape.radius])
    if isinstance(shape, Capsule | Cylinder):
        along = shape.end - shape.start
        if np.linalg.norm(along[:2]) <= _UPRIGHT * np.linalg.norm(along):
            return np.array([*shape.start[:2], shape.radius])
        rim = _rim(shape.radius)
        return _hull(np.vstack([shape.start[:2] + rim, shape.end[:2] + rim]))
    if isinstance(shape, Hull):
        return _hull(shape.corners[:, :2])
    if isinstance(shape, Box):
        signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)
        corners = shape.row[4:7] + (signs * shape.row[1:4]) @ shape.row[7:].reshape(3, 3).T
        return _hull(corners[:, :2])
    return np.zeros((0, 2))


def _hull(points: Array) -> Array:
    """Return the corners of the convex hull of points (N, 2) in order (Andrew 1979)."""
    ordered = np.unique(points.round(12), axis=0)
    chains = []
    for way in (ordered, ordered[::-1]):
        chain: list[Array] = []
        for point in way:
            while len(chain) > 1 and _turns(chain[-2], chain[-1], point) <= 1e-15:
                chain.pop()
            chain.append(point)
        chains += chain[:-1]
    return np.array(chains)


def _turns(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
