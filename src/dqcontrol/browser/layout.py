"""The viewer's place, and the places of runs side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dqcontrol.arrays import Array

if TYPE_CHECKING:
    from dqcontrol.browser.run_view_model import Track

_MOMENTS = 12  # of a run that are looked at
_BESIDE = 0.6  # rad; the viewer stands so far beside the line from the robot to the path
_UP = 0.42
FIELD = 0.7  # rad; of view, from bottom to top
ASPECT = 0.95  # of the scene beside the controls in a window of 1000 × 640, width by height


class Extent(NamedTuple):
    """Box around all robots and paths, m."""

    lower: Array
    upper: Array

    @property
    def size(self) -> float:
        """Its diagonal."""
        return float(np.linalg.norm(self.upper - self.lower)) or 1.0


def extent(tracks: Sequence[Track]) -> Extent:
    """Return the box around some runs, at rest in one place."""
    points = [np.zeros((1, 3))]
    for track in tracks:
        for k in np.linspace(0, len(track.record) - 1, _MOMENTS).astype(int):
            points.append(track.frames(k)[:, 4:])
        points += [track.hand_path().reshape(-1, 3), track.target]
    cloud = np.vstack(points)
    cloud = cloud[np.isfinite(cloud).all(axis=1)]
    return Extent(cloud.min(axis=0), cloud.max(axis=0))


def viewpoint(foot: Array, hands: Sequence[Array], box: Extent) -> tuple[Array, Array]:
    """Return where the viewer stands and looks, m: the paths of hands (N, 3) from the front, robots behind them."""
    middle = (box.lower + box.upper) / 2
    ahead = np.nanmean(np.vstack(hands), axis=0) - foot
    azimuth = np.arctan2(ahead[1], ahead[0]) + _BESIDE if np.linalg.norm(ahead[:2]) > 1e-6 else _BESIDE
    towards = np.array([np.cos(azimuth), np.sin(azimuth), _UP])
    return middle + 1.3 * (box.size + 0.2) * towards / np.linalg.norm(towards), middle


def places(count: int, box: Extent, towards: Array) -> Array:
    """Return the displacement of each of several runs, shape (count, 3), m: from left to right for a viewer.

    Parameters
    ----------
    count
        Number of runs.
    box
        Around them all in one place.
    towards
        Direction from what is looked at to the viewer, shape (3,), not vertical.
    """
    right = _right(towards)
    width = float(np.abs(right) @ (box.upper - box.lower))
    out: Array = np.outer(np.arange(count) - (count - 1) / 2, (width + 0.1 * box.size) * right)
    return out


def step_back(apart: Array, box: Extent, towards: Array) -> float:
    """Return how many times as far off the viewer must stand to see all runs side by side; at least 1.

    Parameters
    ----------
    apart
        Displacements of the runs, as `places` gives them.
    box, towards
        As for `places`; ``towards`` as long as the viewer is off.
    """
    half = (box.upper - box.lower) / 2
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners = (apart[:, None] + signs * half).reshape(-1, 3)
    distance = float(np.linalg.norm(towards))
    across = np.abs(corners @ _right(towards)) / (ASPECT * np.tan(FIELD / 2))
    return max(1.0, float((across + corners @ towards / distance).max()) / distance)


def _right(towards: Array) -> Array:
    """Return the viewer's direction to the right, horizontal, of length 1."""
    right = np.array([-towards[1], towards[0], 0.0])
    return right / np.linalg.norm(right)
