"""The range condition of a run over time: what is asked of the end effector, and what of it the robot cannot do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.figures.style import (
    DOUBLE,
    ERROR,
    FLOOR,
    at_least,
    legend_below,
    line_style,
    logarithmic,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.measures.task_range import TaskRange

_DECADES = 6  # of the error below its peak that are shown
_STILL = 1e-6  # m/s, rad/s, m and rad: the least height of the other panels


@styled
def range_condition(found: TaskRange, error: np.ndarray) -> Figure:
    """Plot the twist asked for with its part outside the range of J, singular values, and the run's error.

    Parameters
    ----------
    found
        From `dqcontrol.measures.task_range`.
    error
        The record's, shape (N,).

    Examples
    --------
    >>> range_condition(task_range(robot, record), record.error).savefig("range.png")  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 5.2)
    panels = figure.subplots(3, 1, sharex=True)
    time = found.time
    panels[0].plot(time, np.maximum(error, FLOOR), **line_style(0))
    logarithmic(panels[0], _DECADES)
    panels[0].set_ylabel(ERROR)
    panels[1].plot(time, found.asked, label="twist asked for", **line_style(1))
    panels[1].plot(time, found.outside, label="outside the range of J", **line_style(2))
    panels[1].set_ylabel("twist [m/s, rad/s]")
    panels[2].plot(time, found.smallest_singular_value, **line_style(3))
    panels[2].set_ylabel("smallest\nsingular value [m, rad]")
    for axes in panels[1:]:
        at_least(axes, _STILL)
    panels[-1].set_xlabel("time [s]")
    artists = [artist for axes in panels[1:] for artist in axes.get_legend_handles_labels()[0]]
    legend_below(figure, panels[0], artists)
    return figure
