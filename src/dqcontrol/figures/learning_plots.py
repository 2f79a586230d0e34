"""Figures of learning from repetition: errors from repeat to repeat, and over time before and after; of forces, too."""

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
    """Plot the position's error against the repeats, beside it over time, before and after; a wanted force's instead.

    Examples
    --------
    >>> repeats_of_learning(learning).savefig("learning.pdf")  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 2.8)
    left, right = figure.subplots(1, 2)
    repeats, forces = learning.repeats, learning.forces
    numbers = [each.number for each in repeats]
    errors = [each.position if each.force is None else each.force for each in repeats]
    seen = [each.seen if each.force is None else each.learnable for each in repeats]
    measured = "as measured" if forces is None else "as measured, in the band"
    left.plot(numbers, errors, "o-", color=COLOURS[0], label="true, RMS")
    left.plot(numbers, seen, "s--", color=COLOURS[1], label=measured)
    left.plot(numbers, [each.noise for each in repeats], ":", color=NEUTRAL, label="noise in the band")
    left.plot(learning.best, errors[learning.best], "o", ms=9, mfc="none", mec=NEUTRAL, label="kept")
    logarithmic(left)
    left.set_xlabel("repeat")
    left.set_ylabel("position error [mm]" if forces is None else "force error [N]")
    legend_above(left, 2)
    left.xaxis.get_major_locator().set_params(integer=True)
    of_first = {"color": COLOURS[1], "label": "first"}
    of_best = {"color": COLOURS[0], "label": f"repeat {learning.best}"}
    if forces is None:
        start = learning.first.desired_position
        before, after = _over_time(learning.first, start), _over_time(learning.last, start)
        right.plot(*before, **of_first)
        right.plot(*after, **of_best)
        logarithmic(right)
        right.set_ylim(bottom=0.1 * min(np.median(before[1]), np.median(after[1])))  # at the start both are 0
    else:
        for record, style in ((learning.first, of_first), (learning.last, of_best)):
            lines = right.plot(record.time, forces.errors(record), lw=0.9, **style)
            for line in lines[1:]:
                line.set_label("_")
        right.set_ylabel("force − wanted force [N]")
    right.set_xlabel("time [s]")
    legend_above(right, 2)
    return figure


def _over_time(record: Record, desired: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return times and errors against the motion that was asked for, mm."""
    count = min(len(record), len(desired))
    errors = 1e3 * np.linalg.norm(record.position[:count] - desired[:count], axis=1)
    return record.time[:count], np.maximum(errors, 1e-6)
