"""Figures of distributions, of quantities against others, and of a loop's times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.figures import style as styles
from dqcontrol.loop.clock import Timing
from dqcontrol.measures.repeats import mean_of
from dqcontrol.tables.tables import Column, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_BINS = 40  # free: fine enough for the shape


@styles.styled
def histogram(values: Mapping[str, ArrayLike]) -> Figure:
    """Plot how often sampling periods (ms) occur, one panel a label, below mean and deviation [P16 Figures 5.5–5.6].

    Parameters
    ----------
    values
        By label, each of shape (N,), ms, as of a run: ``1e3 * np.diff(record.time)``.

    Raises
    ------
    ShapeError, ValueRangeError
        If there are no values, or they are not finite numbers.

    Examples
    --------
    >>> histogram({"K": 1e3 * np.diff(run.time)})  # doctest: +SKIP
    """
    samples = {name: as_array(f"values of {name}", numbers, (None,)) for name, numbers in values.items()}
    if not samples or not all(map(len, samples.values())):
        raise ShapeError("values: expected at least one for each label, got none")
    everything = np.concatenate(list(samples.values()))
    low, high = _most(everything)
    margin = max(0.02 * (high - low), 1e-3 * abs(high), 1e-9)
    edges = np.linspace(low - margin, high + margin, _BINS + 1)
    most = 2 if len(samples) in (2, 4) else min(3, len(samples))
    figure, panels = styles.panel_grid(len(samples), most, 2.1, 0.5, sharex=True, sharey=True)
    for axes, (name, numbers) in zip(panels.flat, samples.items(), strict=False):
        axes.hist(numbers, edges, color=styles.COLOURS[0], edgecolor="white", linewidth=0.3)
        mean = mean_of(numbers)
        axes.axvline(mean.mean, color=styles.DESIRED, ls="--", lw=1.0)
        title = f"{name}\nmean {mean.mean:.4g}, std. dev. {mean.deviation:.3g}"
        axes.set_title(title + _outside(numbers, edges[0], edges[-1]), loc="left")
    for axes in panels.flat[len(samples) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(len(samples) - panels.shape[1], 0) : len(samples)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("sampling period [ms]")
    for axes in panels[:, 0]:
        axes.set_ylabel("samples")
    return figure


def _most(values: Array) -> tuple[float, float]:
    """Return between which bounds values are shown: all of them, unless single ones would flatten the rest."""
    first, last = np.percentile(values, [0.5, 99.5])
    spread = last - first
    return max(float(values.min()), first - spread), min(float(values.max()), last + spread)


def _outside(values: Array, low: float, high: float) -> str:
    """Say how many values are not shown, and the farthest of them."""
    beyond = values[(values < low) | (values > high)]
    if not len(beyond):
        return ""
    farthest = beyond[np.abs(beyond - np.median(values)).argmax()]
    return f"\nnot shown: {len(beyond)}, as far as {farthest:.3g}"


Pairs = Sequence[tuple[float, float]]

_ACROSS = 3


@styles.styled
def parity(panels: Mapping[str, Mapping[str, Pairs]]) -> Figure:
    """Plot pairs of positive numbers on logarithmic axes, one panel a title, one mark a label.

    Parameters
    ----------
    panels
        By title, then by label: pairs of a published number and ours.

    Raises
    ------
    ShapeError
        If a panel has no pairs.

    Examples
    --------
    >>> parity({"error": {"K": [(1.23, 1.23), (1.68, 1.74)]}})  # doctest: +SKIP
    """
    from matplotlib.ticker import LogLocator, NullLocator

    figure, everywhere = styles.panel_grid(len(panels), min(len(panels), _ACROSS), 2.8, 0.4)
    grid = everywhere.ravel()[: len(panels)]
    for axes in everywhere.flat[len(panels) :]:
        axes.remove()
    known = list(dict.fromkeys(label for groups in panels.values() for label in groups))
    for axes, (title, groups) in zip(grid, panels.items(), strict=True):
        points = np.array([pair for pairs in groups.values() for pair in pairs], dtype=np.float64)
        if not len(points):
            raise ShapeError(f"panels: '{title}' has no pairs")
        low, high = points.min() / 1.3, points.max() * 1.3
        axes.plot([low, high], [low, high], color=styles.DESIRED, lw=0.8, zorder=1)
        for label, pairs in groups.items():
            axes.plot(*np.array(pairs).T, label=label, **styles.mark_style(known.index(label)))
        axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high), title=title, aspect="equal")
        axes.set_xlabel("published")
        for axis in (axes.xaxis, axes.yaxis):
            subs = (1.0, 2.0, 5.0) if high / low > 6 else (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)
            axis.set_major_locator(LogLocator(subs=subs))
            axis.set_major_formatter(lambda value, _: f"{value:g}")
            axis.set_minor_locator(NullLocator())
    for axes in grid[:: everywhere.shape[1]]:
        axes.set_ylabel("ours")
    styles.legend_below(figure, max(grid, key=lambda axes: len(axes.get_legend_handles_labels()[0])))
    return figure


_TIMING_BINS = 60  # free: fine enough for the tail


@styles.styled
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
    rows = _times(timing)
    figure, grid = styles.panel_grid(len(rows), len(rows), 2.0, 0.6, sharey=True)
    panels = grid.ravel()
    for axes, (name, seconds) in zip(panels, rows.items(), strict=True):
        values = 1e3 * seconds
        axes.hist(values, _TIMING_BINS, color=styles.COLOURS[0], edgecolor="white", linewidth=0.2)
        axes.set(yscale="log", xlabel=f"{name} [ms]")
        axes.set_title(
            f"median {np.median(values):.4g}\n99 % below {np.quantile(values, 0.99):.4g}", loc="left"
        )
    panels[0].axvline(1e3 * timing.period, color=styles.DESIRED, ls="--", lw=1.0)
    panels[0].set_ylabel("steps")
    figure.suptitle(
        f"T = {1e3 * timing.period:.4g} ms, {len(timing.begin)} steps, {timing.overruns} overruns"
    )
    return figure


def _times(timing: Timing) -> dict[str, Array]:
    return {"period": timing.periods, "computation": timing.computation, "idle": timing.idle[1:]}


def timing_table(timing: Timing) -> Table:
    """Return median, 99 % and longest of periods, computation and idle times, and how many periods were missed.

    Examples
    --------
    >>> print(timing_table(clock.timing).markdown())  # doctest: +SKIP
    """
    columns = [Column("timing"), *(Column(name, "ms", ".4g") for name in ("median", "99 % below", "longest"))]
    rows = [
        [name, *(1e3 * float(np.quantile(seconds, share)) for share in (0.5, 0.99, 1.0))]
        for name, seconds in _times(timing).items()
        if len(seconds)
    ]
    steps = f"{len(timing.begin)} steps of {1e3 * timing.period:.4g} ms"
    return Table(columns, rows, f"{steps}: {timing.overruns} began late, {timing.missed} periods missed")
