"""Figures of learning from repetition: errors from repeat to repeat, and over time before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.figures.style import COLOURS, DOUBLE, NEUTRAL, legend_above, logarithmic, new_figure, styled
from dqcontrol.loop import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.tuning import Learning


@styled
def repeats_of_learning(learning: Learning) -> Figure:
    """Plot the position's error against the repeats, beside it over time, before and after.

    Examples
    --------
    >>> repeats_of_learning(learning).savefig("learning.pdf")  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 2.8)
    left, right = figure.subplots(1, 2)
    numbers = [each.number for each in learning.repeats]
    left.plot(
        numbers, [each.position for each in learning.repeats], "o-", color=COLOURS[0], label="true, RMS"
    )
    left.plot(numbers, [each.seen for each in learning.repeats], "s--", color=COLOURS[1], label="as measured")
    left.plot(
        numbers, [each.noise for each in learning.repeats], ":", color=NEUTRAL, label="noise in the band"
    )
    best = learning.repeats[learning.best]
    left.plot(best.number, best.position, "o", ms=9, mfc="none", mec=NEUTRAL, label="kept")
    logarithmic(left)
    left.set_xlabel("repeat")
    left.set_ylabel("position error [mm]")
    legend_above(left, 2)
    left.xaxis.get_major_locator().set_params(integer=True)
    start = learning.first.desired_position
    before, after = _over_time(learning.first, start), _over_time(learning.last, start)
    right.plot(*before, color=COLOURS[1], label="first")
    right.plot(*after, color=COLOURS[0], label=f"repeat {learning.best}")
    logarithmic(right)
    right.set_ylim(bottom=0.1 * min(np.median(before[1]), np.median(after[1])))  # at the start both are 0
    right.set_xlabel("time [s]")
    legend_above(right, 2)
    return figure


def _over_time(record: Record, desired: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and errors against the motion that was asked for, mm."""
    count = min(len(record), len(desired))
    errors = 1e3 * np.linalg.norm(record.position[:count] - desired[:count], axis=1)
    return record.time[:count], np.maximum(errors, 1e-6)
