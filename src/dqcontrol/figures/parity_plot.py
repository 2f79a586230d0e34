"""Numbers held against those of others: each pair as a point, the diagonal where they agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    DESIRED,
    DOUBLE,
    legend_below,
    mark_style,
    new_figure,
    panels_across,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Pairs = Sequence[tuple[float, float]]

_ACROSS = 3


@styled
def parity(
    panels: Mapping[str, Mapping[str, Pairs]], labels: tuple[str, str] = ("published", "ours")
) -> Figure:
    """Plot pairs of positive numbers on logarithmic axes, one panel a title, one mark a label.

    Parameters
    ----------
    panels
        By title, then by label: pairs of a published number and ours.
    labels
        Of the axes.

    Raises
    ------
    ShapeError
        If a panel has no pairs.

    Examples
    --------
    >>> parity({"error": {"K": [(1.23, 1.23), (1.68, 1.74)]}})  # doctest: +SKIP
    """
    from matplotlib.ticker import LogLocator, NullLocator

    across = panels_across(min(len(panels), _ACROSS))
    rows = -(-len(panels) // across)
    figure = new_figure(DOUBLE, 0.4 + 2.8 * rows)
    everywhere = figure.subplots(rows, across, squeeze=False).ravel()
    grid = everywhere[: len(panels)]
    for axes in everywhere[len(panels) :]:
        axes.remove()
    known = list(dict.fromkeys(label for groups in panels.values() for label in groups))
    for axes, (title, groups) in zip(grid, panels.items(), strict=True):
        points = np.array([pair for pairs in groups.values() for pair in pairs], dtype=np.float64)
        if not len(points):
            raise ShapeError(f"panels: '{title}' has no pairs")
        low, high = points.min() / 1.3, points.max() * 1.3
        axes.plot([low, high], [low, high], color=DESIRED, lw=0.8, zorder=1)
        for label, pairs in groups.items():
            axes.plot(*np.array(pairs).T, label=label, **mark_style(known.index(label)))
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), title=title, aspect="equal")
        axes.set_xlabel(labels[0])
        for axis in (axes.xaxis, axes.yaxis):
            subs = (1.0, 2.0, 5.0) if high / low > 6 else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_locator(NullLocator())
    for axes in grid[::across]:
        axes.set_ylabel(labels[1])
    legend_below(figure, max(grid, key=lambda axes: len(axes.get_legend_handles_labels()[0])))
    return figure
