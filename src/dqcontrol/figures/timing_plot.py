"""How a loop kept time: its periods, computations and idle times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import COLOURS, DESIRED, DOUBLE, new_figure, panels_across, styled
from dqcontrol.loop.clock import Timing
from dqcontrol.tables.tables import Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BINS = 60


@styled
def timing_histogram(timing: Timing) -> Figure:
    """Plot how often periods, computation and idle times of a loop occur; counts are logarithmic.

    Raises
    ------
    ShapeError
        If the loop had fewer than two steps.

    Examples
    --------
    >>> timing_histogram(clock.timing)  # doctest: +SKIP
    """
    if len(timing.begin) < 2:
        raise ShapeError(f"timing: needs at least two steps, got {len(timing.begin)}")
    rows = (
        ("period", timing.periods),
        ("computation", timing.computation),
        ("idle", timing.idle[1:]),
    )
    across = panels_across(len(rows))
    figure = new_figure(DOUBLE, 0.6 + 2.0 * len(rows) / across)
    panels = figure.subplots(len(rows) // across, across, sharey=True, squeeze=False).ravel()
    for axes, (name, seconds) in zip(panels, rows, strict=True):
        values = 1e3 * seconds
        axes.hist(values, _BINS, color=COLOURS[0], edgecolor="white", linewidth=0.2)
        axes.set_yscale("log")
        axes.set_xlabel(f"{name} [ms]")
        axes.set_title(
            f"median {np.median(values):.4g}\n99 % below {np.quantile(values, 0.99):.4g}", loc="left"
        )
    panels[0].axvline(1e3 * timing.period, color=DESIRED, ls="--", lw=1.0)
    panels[0].set_ylabel("steps")
    figure.suptitle(
        f"T = {1e3 * timing.period:.4g} ms, {len(timing.begin)} steps, {timing.overruns} overruns"
    )
    return figure


def timing_table(timing: Timing) -> Table:
    """Return median, 99 % and longest of periods, computation and idle times, and how many periods were missed.

    Examples
    --------
    >>> print(timing_table(clock.timing).markdown())  # doctest: +SKIP
    """
    columns = [Column("timing"), *(Column(name, "ms", ".4g") for name in ("median", "99 % below", "longest"))]
    rows = [
        [name, *(1e3 * float(np.quantile(seconds, share)) for share in (0.5, 0.99, 1.0))]
        for name, seconds in (
            ("period", timing.periods),
            ("computation", timing.computation),
            ("idle", timing.idle[1:]),
        )
        if len(seconds)
    ]
    steps = f"{len(timing.begin)} steps of {1e3 * timing.period:.4g} ms"
    return Table(columns, rows, f"{steps}: {timing.overruns} began late, {timing.missed} periods missed")
