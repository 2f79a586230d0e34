"""How far a robot is from what it is to do beside the task of its law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import DOUBLE, legend_below, line_style, new_figure, styled
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import TASK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SMALLEST = 1e-3  # mm and °: the least height of a panel


def has_tasks(record: Record) -> bool:
    """Return whether there is anything for `task_errors` to draw."""
    return any(name.startswith(TASK) for name in record.readings)


@styled
def task_errors(record: Record) -> Figure:
    """Plot distance and angle of each further task from its pose.

    Parameters
    ----------
    record
        A run with further tasks.

    Raises
    ------
    ShapeError
        If it has none.

    Examples
    --------
    >>> task_errors(run.record).savefig("tasks.png")  # doctest: +SKIP
    """
    if not has_tasks(record):
        raise ShapeError("record: has no tasks beside that of its law")
    figure = new_figure(DOUBLE, 3.6)
    panels = figure.subplots(2, 1, sharex=True)
    found = [(name, signal) for name, signal in record.readings.items() if name.startswith(TASK)]
    for i, (name, signal) in enumerate(found):
        label = name.removeprefix(TASK).replace("_", " ")
        moved, turned = 1e3 * signal.values[:, 0], np.degrees(signal.values[:, 1])
        panels[0].plot(record.time, moved, label=label, **line_style(i))
        panels[1].plot(record.time, turned, label=label, **line_style(i))
    for axes, name, unit in ((panels[0], "position", "mm"), (panels[1], "orientation", "°")):
        axes.set_ylabel(f"{name} [{unit}]")
        axes.set_ylim(0, max(_SMALLEST, axes.get_ylim()[1]))
    panels[1].set_xlabel("time [s]")
    legend_below(figure, panels[0])
    return figure
