"""The hand's path as a long exposure shows a lamp that it holds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.loop.record import Record
from dqcontrol.view.paths import path_plane
from dqcontrol.view.style import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GLOW = ((11.0, 0.035), (7.0, 0.06), (4.0, 0.16), (1.6, 0.9))  # width in points, opacity
_LIGHT, _CORE = "#5fb4ff", "#f4fbff"
_FRONT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def light_painting(record: Record) -> Figure:
    """Draw the hand's path as a long exposure: seen along the plane of the desired path, or along y.

    A lamp that moves slowly leaves more light: the exposure of each stretch is the time spent on it.

    Parameters
    ----------
    record
        The run; samples that are not finite are left out.

    Raises
    ------
    ShapeError
        If fewer than two samples are finite.

    Examples
    --------
    >>> light_painting(run.record).savefig("painting.png")  # doctest: +SKIP
    """
    from matplotlib.collections import LineCollection

    points = record.position[np.isfinite(record.position).all(axis=1)]
    if len(points) < 2:
        raise ShapeError(f"record: needs at least two finite samples, got {len(points)}")
    plane = path_plane(record.desired_position)
    flat = points @ (plane[0] if plane else _FRONT).T
    strokes = np.stack([flat[:-1], flat[1:]], axis=1)
    length = np.linalg.norm(strokes[:, 1] - strokes[:, 0], axis=1)
    moving = length > 0
    exposure = np.full(len(length), 1.0)
    exposure[moving] = np.clip(np.sqrt(np.median(length[moving]) / length[moving]), 0.35, 1.0)
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = np.maximum(high - low, 1e-3)
    longest = 5.6 / size.max()
    figure = new_figure(*(size * longest + 1.0))
    figure.set_facecolor("black")
    axes = figure.add_subplot()
    for width, opacity in _GLOW:
        colour = _CORE if opacity > 0.5 else _LIGHT
        axes.add_collection(
            LineCollection(
                list(strokes), colors=colour, linewidths=width, alpha=opacity * exposure, capstyle="round"
            )
        )
    axes.set_xlim(low[0] - 0.08 * size.max(), high[0] + 0.08 * size.max())
    axes.set_ylim(low[1] - 0.08 * size.max(), high[1] + 0.08 * size.max())
    axes.set_aspect("equal")
    axes.axis("off")
    return figure
