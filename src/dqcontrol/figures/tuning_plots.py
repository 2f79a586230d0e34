"""Figures of searches: how every law came to its best, and the best compromises of two objectives."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    COLOURS,
    DOUBLE,
    MARKERS,
    legend_below,
    line_style,
    line_widths,
    logarithmic,
    new_figure,
    styled,
)
from dqcontrol.measures.run_numbers import NUMBER_COLUMNS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.tuning import Tuning

_DECADE = 10.0  # from such a ratio on an axis is logarithmic


@styled
def search_figure(tuning: Tuning) -> Figure:
    """Plot the best total so far of each law against the evaluations, and its total on what was not seen.

    Examples
    --------
    >>> search_figure(tuning).savefig("search.pdf")  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 2.8)
    axes = figure.subplots()
    widths = line_widths(len(tuning.laws))
    for i, each in enumerate(tuning.laws):
        rows = each.result.rows[: each.result.evaluations]
        totals = [math.inf if row["total"] is None or row["violation"] else row["total"] for row in rows]
        best = np.minimum.accumulate(totals)
        seen = np.isfinite(best)
        count = np.arange(1, len(best) + 1)
        axes.step(count[seen], best[seen], where="post", lw=widths[i], label=each.label, **line_style(i))
        if math.isfinite(each.result.held_out_total):
            axes.plot(
                len(best) + 1,
                each.result.held_out_total,
                MARKERS[i % len(MARKERS)],
                color=COLOURS[i % len(COLOURS)],
                mfc="none",
            )
    axes.plot([], [], "o", color="0.4", mfc="none", label="held out")
    axes.set_xlabel("evaluations")
    axes.set_ylabel("weighted objectives")
    low, high = axes.dataLim.ymin, axes.dataLim.ymax
    if low > 0 and high > _DECADE * low:
        logarithmic(axes)
    legend_below(figure, axes)
    return figure


@styled
def front_figure(tuning: Tuning) -> Figure:
    """Plot the best compromises of two objectives, one line a law.

    Raises
    ------
    ShapeError
        If none were searched for.

    Examples
    --------
    >>> front_figure(tuning).savefig("front.pdf")  # doctest: +SKIP
    """
    front = tuning.problem.block.front
    if front is None:
        raise ShapeError("tuning: has no fronts; give tune.front")
    figure = new_figure(DOUBLE, 3.2)
    axes = figure.subplots()
    for i, each in enumerate(tuning.laws):
        if each.result.front:
            first = [a for _, a, _ in each.result.front]
            second = [b for _, _, b in each.result.front]
            axes.plot(
                first,
                second,
                marker=MARKERS[i % len(MARKERS)],
                ms=3,
                lw=0.8,
                color=COLOURS[i % len(COLOURS)],
                label=each.label,
            )
    for low, high, scale in (
        (*axes.dataLim.intervalx, axes.set_xscale),
        (*axes.dataLim.intervaly, axes.set_yscale),
    ):
        if low > 0 and high > _DECADE * low:
            scale("log")
    first, second = front.objectives
    axes.set_xlabel(NUMBER_COLUMNS[first].heading)
    axes.set_ylabel(NUMBER_COLUMNS[second].heading)
    legend_below(figure, axes)
    return figure
