"""Which samples of a long curve its picture consists of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array

_PIECES = (
    800  # of a curve: one a pixel of a figure across a page, 7.16 in at 96 dots an inch less its margins
)


def outline(curves: Array) -> NDArray[np.intp] | None:
    """Return rows that show each peak of curves (N, k); None where all N are needed.

    Of each piece these are the first, the last, and those with the least and the largest value of each curve.
    """
    count, width = curves.shape
    step = -(-count // _PIECES)
    if step <= 2 * width + 2:
        return None
    whole = count - count % step
    first = np.arange(0, whole, step)
    pieces = curves[:whole].reshape(-1, step, width)
    found = [first, first + step - 1, np.arange(whole, count)]
    for peaks in (pieces.argmin(axis=1), pieces.argmax(axis=1)):
        found.append((first[:, None] + peaks).ravel())
    return np.unique(np.concatenate(found))


def outlined(points: Array) -> Array:
    """Return those of many points (N, k) that show each of their peaks; see `outline`."""
    kept = outline(points)
    return points if kept is None else points[kept]
