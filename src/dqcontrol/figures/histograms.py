"""How a quantity is distributed, one panel a label."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.figures.style import COLOURS, DESIRED, DOUBLE, new_figure, panels_across, styled
from dqcontrol.measures.statistics import mean_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_BINS = 40


@styled
def histogram(values: Mapping[str, ArrayLike], label: str = "sampling period [ms]") -> Figure:
    """Plot how often values occur, one panel a label, with mean and standard deviation above it [P16 Figures 5.5–5.6].

    Parameters
    ----------
    values
        By label, each of shape (N,), as the sampling periods of a run: ``1e3 * np.diff(record.time)``.
    label
        What they are, with unit.

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
    columns = panels_across(2 if len(samples) in (2, 4) else min(3, len(samples)))
    rows = -(-len(samples) // columns)
    figure = new_figure(DOUBLE, 0.5 + 2.1 * rows)
    panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, (name, numbers) in zip(panels.flat, samples.items(), strict=False):
        axes.hist(numbers, edges, color=COLOURS[0], edgecolor="white", linewidth=0.3)
        mean = mean_of(numbers)
        axes.axvline(mean.mean, color=DESIRED, ls="--", lw=1.0)
        title = f"{name}\nmean {mean.mean:.4g}, std. dev. {mean.deviation:.3g}"
        axes.set_title(title + _outside(numbers, edges[0], edges[-1]), loc="left")
    for axes in panels.flat[len(samples) :]:
        axes.set_visible(False)
    for axes in panels.flat[max(len(samples) - columns, 0) : len(samples)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel(label)
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
