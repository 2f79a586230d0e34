"""Meshes of rods, balls and boxes.

`trimesh` makes them, too; but what it imports takes 1.5 s of a processor's time (NetworkX, SciPy), as much as all else
from `dqcontrol play` to a robot that moves. It is imported where files with meshes are read.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array

_SECTIONS = 40  # around an axis
_RINGS = 10  # of half a ball


class Surface(NamedTuple):
    """A closed surface: vertices (V, 3), m, and faces (F, 3) of their indices, anticlockwise from outside.

    Vertices at an edge stand there once for each side, so that edges are drawn as edges and curves are drawn round.
    """

    vertices: Array
    faces: NDArray[np.int64]

    @classmethod
    def joined(cls, solids: Iterable[Surface]) -> Surface:
        """Return several as one: fewer and larger ones are quicker to draw."""
        parts = list(solids)
        firsts = np.cumsum([0, *(len(each.vertices) for each in parts)])
        return cls(
            np.concatenate([each.vertices for each in parts]),
            np.concatenate([each.faces + first for each, first in zip(parts, firsts, strict=False)]),
        )


def rod(start: ArrayLike, end: ArrayLike, radius: float, *, round_ends: bool = False) -> Surface:
    """Return a cylinder between two points, or a capsule about them; a ball where they are the same.

    Examples
    --------
    >>> import numpy as np
    >>> np.ptp(rod([0, 0, 0], [0, 0, 1], 0.25, round_ends=True).vertices, axis=0).tolist()
    [0.5, 0.5, 1.5]
    """
    start, end = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(end - start))
    if round_ends:
        angle = 0.5 * np.pi * np.linspace(0.0, 1.0, _RINGS + 1)
        up, out = radius * np.sin(angle), radius * np.cos(angle)
        out[-1] = 0.0
        first = np.column_stack([-up[::-1], out[::-1]])
        bands = [np.vstack([first, np.column_stack([length + up, out])[0 if length else 1 :]])]
    else:
        ends = [[0.0, 0.0], [0.0, radius], [length, radius], [length, 0.0]]
        bands = [np.array(ends[i : i + 2]) for i in range(3)]
    axis = (end - start) / length if length > 0 else np.array([0.0, 0.0, 1.0])
    solid = Surface.joined(_turned(band, axis) for band in bands)
    return Surface(solid.vertices + start, solid.faces)


def ball(centre: ArrayLike, radius: float) -> Surface:
    """Return a ball."""
    return rod(centre, centre, radius, round_ends=True)


def box(size: ArrayLike, centre: ArrayLike = (0.0, 0.0, 0.0), axes: ArrayLike | None = None) -> Surface:
    """Return a box with edges of these lengths, (3,), m, along the columns of ``axes`` (3, 3).

    Examples
    --------
    >>> len(box([1, 2, 3]).vertices)
    24
    """
    corners, faces = [], []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for sign in (-1.0, 1.0):
            first = len(corners)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[[i, j, k]] = sign, sign * a, b
                corners.append(corner)
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
    turn = np.eye(3) if axes is None else np.asarray(axes, np.float64)
    vertices = (0.5 * np.array(corners) * np.asarray(size, np.float64)) @ turn.T + np.asarray(
        centre, np.float64
    )
    return Surface(vertices, np.array(faces, np.int64))


def _turned(profile: Array, axis: Array) -> Surface:
    """Return what a line of points [along, out], (K, 2), m, passes over as it turns about an axis (3,)."""
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    angle = 2 * np.pi * np.arange(_SECTIONS) / _SECTIONS
    ring = np.outer(np.cos(angle), across) + np.outer(np.sin(angle), np.cross(axis, across))
    along, out = profile.T
    vertices = along[:, None, None] * axis + out[:, None, None] * ring
    k, a = np.meshgrid(np.arange(len(profile) - 1), np.arange(_SECTIONS), indexing="ij")
    b = (a + 1) % _SECTIONS
    near, far = k * _SECTIONS, (k + 1) * _SECTIONS
    below = np.stack([near + a, near + b, far + b], axis=-1)[out[:-1] > 0]
    above = np.stack([near + a, far + b, far + a], axis=-1)[out[1:] > 0]
    return Surface(vertices.reshape(-1, 3), np.concatenate([below.reshape(-1, 3), above.reshape(-1, 3)]))
