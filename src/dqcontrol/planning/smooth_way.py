"""Smooth ways through configurations: edges, and quadratic curves that blend the corners between them, all proved."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.planning.certified_edges import CertifiedEdges

_HALVINGS = 6  # of a blend that is not certified; one 64 times smaller is a corner, where the way rests
_MOST = 0.5  # share of an edge that a blend takes


class SmoothWay(NamedTuple):
    """Pieces one after the other, each a quadratic curve over the length of the way.

    Lengths are Euclidean ones of coordinates, rad and m alike. The direction is continuous where pieces meet, but at
    corners.

    Attributes
    ----------
    points
        Three of each piece, shape (M, 3, n): begin, what bends it, end.
    lengths
        Of the pieces, shape (M,).
    corners
        Numbers of the pieces that begin at a corner, where the way has to rest.
    """

    points: Array
    lengths: Array
    corners: tuple[int, ...]

    @property
    def begins(self) -> Array:
        """Length of the way where each piece begins, and its end, shape (M + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.lengths)])

    @property
    def curves(self) -> Array:
        """The three points of each piece in a row, shape (M, 3 n)."""
        return self.points.reshape(len(self.points), -1)

    def at(self, lengths: Array) -> tuple[Array, Array, Array]:
        """Return configurations at lengths (N,) of the way, and their first and second derivatives, (N, n) each."""
        begins = self.begins
        piece = np.clip(np.searchsorted(begins, lengths, side="right") - 1, 0, len(self.lengths) - 1)
        size = self.lengths[piece][:, None]
        t = np.clip((lengths - begins[piece])[:, None] / size, 0.0, 1.0)
        a, c, b = (self.points[piece, k] for k in range(3))
        q = (1 - t) ** 2 * a + 2 * t * (1 - t) * c + t**2 * b
        return q, 2 * ((1 - t) * (c - a) + t * (b - c)) / size, 2 * (a - 2 * c + b) / size**2

    def driven(self, lengths: Array) -> Array:
        """Return where coordinates are at lengths (N,) of the way, (N, n)."""
        return self.at(lengths)[0]

    def travelled(self, lengths: Array) -> Array:
        """Return how far each coordinate has gone back and forth at lengths (N,) of the way, (N, n)."""
        begins = self.begins
        piece = np.clip(np.searchsorted(begins, lengths, side="right") - 1, 0, len(self.lengths) - 1)
        t = np.clip((lengths - begins[piece]) / self.lengths[piece], 0.0, 1.0)
        whole = _gone(self.points, np.ones(len(self.points)))
        before = np.vstack([np.zeros_like(whole[:1]), np.cumsum(whole, axis=0)])
        return before[piece] + _gone(self.points[piece], t)

    def parts(self) -> list[SmoothWay]:
        """Return it taken apart at its corners."""
        ends = [0, *self.corners, len(self.lengths)]
        return [SmoothWay(self.points[i:j], self.lengths[i:j], ()) for i, j in pairwise(ends)]


def smooth_way(edges: CertifiedEdges, corners: Array) -> SmoothWay:
    """Return a way along certified edges, from point to point of (K, n), with the largest blends that are certified.

    A blend goes from r before a point to r behind it; r is at most half of the shorter edge there.
    """
    steps = np.diff(corners, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    along = steps / np.maximum(sizes, 1e-12)[:, None]
    radii = np.zeros(len(corners))
    for k in range(1, len(corners) - 1):
        radius = _MOST * min(sizes[k - 1], sizes[k])
        for _ in range(_HALVINGS):
            blend = _blend(corners[k], along[k - 1], along[k], radius)
            if edges.curves(blend.reshape(1, -1)).certified[0]:
                radii[k] = radius
                break
            radius *= 0.5
    points, lengths, stops = [], [], []
    for k, size in enumerate(sizes):
        a, b = corners[k] + radii[k] * along[k], corners[k + 1] - radii[k + 1] * along[k]
        left = size - radii[k] - radii[k + 1]
        if k > 0 and radii[k] == 0.0:
            stops.append(len(points))
        if left > 1e-9 * size or len(sizes) == 1:
            points.append(np.array([a, 0.5 * (a + b), b]))
            lengths.append(max(left, 1e-12))
        if radii[k + 1] > 0.0:
            points.append(_blend(corners[k + 1], along[k], along[k + 1], radii[k + 1]))
            lengths.append(2.0 * radii[k + 1])
    return SmoothWay(np.array(points), np.array(lengths), tuple(stops))


def _blend(corner: Array, before: Array, after: Array, radius: float) -> Array:
    return np.array([corner - radius * before, corner, corner + radius * after])


def _gone(points: Array, t: Array) -> Array:
    """Return how far coordinates go back and forth on pieces (N, 3, n) up to shares t (N,): each turns once at most."""
    a, c, b = (points[:, k] for k in range(3))
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.nan_to_num((a - c) / (a - 2.0 * c + b), nan=0.0, posinf=0.0, neginf=0.0)
    turn = np.clip(turn, 0.0, t[:, None])

    def moved(at: Array) -> Array:
        return 2.0 * at * (1.0 - at) * (c - a) + at**2 * (b - a)

    return np.abs(moved(turn)) + np.abs(moved(np.broadcast_to(t[:, None], a.shape)) - moved(turn))
