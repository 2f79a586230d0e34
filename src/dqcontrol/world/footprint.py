"""What bodies take of the floor: discs and polygons, for bases that drive around them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.geometry import Box, Capsule, Cylinder, FloorMap, Shape, Sphere, load_map
from dqcontrol.world.body import Body

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
    if body.map is not None and not any((*body.position, *body.rpy)) and not body.parts:
        return Footprint(np.zeros((0, 3)), load_map(body.map))
    discs, polygons = [], []
    for shape in body.shapes:
        found = _shadow(shape)
        if found.shape == (3,):
            discs.append(found)
        elif len(found):
            polygons.append(found)
    return Footprint(np.array(discs).reshape(-1, 3), FloorMap(tuple(polygons)))


def _shadow(shape: Shape) -> Array:
    """Return a disc, shape (3,), or the corners of a polygon, shape (k, 2); none of a plane."""
    if isinstance(shape, Sphere):
        return np.array([*shape.center[:2], shape.radius])
    if isinstance(shape, Capsule | Cylinder):
        along = shape.end - shape.start
        if np.linalg.norm(along[:2]) <= _UPRIGHT * np.linalg.norm(along):
            return np.array([*shape.start[:2], shape.radius])
        turn = 2 * np.pi * np.arange(32) / 32  # around it: a little outside of round ends
        rim = shape.radius / np.cos(np.pi / 32) * np.column_stack([np.cos(turn), np.sin(turn)])
        return _hull(np.vstack([shape.start[:2] + rim, shape.end[:2] + rim]))
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
