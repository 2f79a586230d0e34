"""Figures of what was searched for: tuned laws, learnt motions, identified servos."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    COLOURS,
    DESIRED,
    DOUBLE,
    MARKERS,
    NEUTRAL,
    legend_above,
    legend_below,
    line_style,
    line_widths,
    logarithmic,
    new_figure,
    styled,
)
from dqcontrol.loop import Record
from dqcontrol.measures.metric_tables import NUMBER_COLUMNS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.logs.servos.joint_gates import JointTrace
    from dqcontrol.tuning import Learning, Tuning


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


_WINDOW = 2.5  # s that are shown closely
_MOST = 4000  # points of a curve of residuals


@styled
def servo_fits(joints: Mapping[str, tuple[JointTrace, float]]) -> Figure:
    """Plot for each joint fit and residual: left where it is liveliest, right all along beside the floor.

    Parameters
    ----------
    joints
        By name: what was identified of it, and what noise and encoder alone would leave, rad or m.

    Examples
    --------
    >>> servo_fits({joint.name: (joint.trace, joint.floor) for joint in found.fitted})  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 0.6 + 1.25 * len(joints))
    grid = figure.subplots(len(joints), 2, squeeze=False)
    for (name, (trace, floor)), (close, all_along) in zip(joints.items(), grid, strict=True):
        shown = _liveliest(trace)
        time = trace.time[shown]
        close.plot(time, trace.target[shown], color=DESIRED, lw=0.8, label="commanded")
        close.plot(time, trace.position[shown], color=COLOURS[0], lw=1.4, label="measured")
        close.plot(time, trace.fitted[shown], color=COLOURS[1], lw=0.8, ls="--", label="fitted")
        close.set_title(name, loc="left")
        step = max(1, len(trace.time) // _MOST)
        thin = slice(None, None, step)
        left = 1e3 * (trace.position - trace.fitted)
        late = np.isfinite(trace.foreseen)
        ahead = np.where(late, 1e3 * (trace.position - trace.foreseen), np.nan)
        all_along.plot(trace.time[thin], left[thin], color=COLOURS[0], lw=0.4, label="left by the fit")
        all_along.plot(trace.time[thin], ahead[thin], color=COLOURS[1], lw=0.4, label="left where not fitted")
        for side in (-2e3, 2e3):
            all_along.axhline(side * floor, color=DESIRED, lw=0.8, ls="--")
        all_along.set_ylabel("left [mrad]")
        close.set_ylabel("[rad]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    legend_below(figure, grid[0][0], grid[0][1].get_legend_handles_labels()[0])
    return figure


def _liveliest(trace: JointTrace) -> slice:
    """Return the samples of the part of a log in which a joint's target moved most."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(trace.target)))])
    last = np.searchsorted(trace.time, trace.time + _WINDOW, side="right") - 1
    first = int(np.argmax(path[last] - path))
    return slice(first, int(last[first]) + 1)
