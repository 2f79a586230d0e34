"""Distances that were to be kept, over time: how near they came, what pressed, and what gave way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import DOUBLE, beyond_spikes, legend_below, line_style, new_figure, styled
from dqcontrol.loop.kept_signals import PRESSURE, ROOM, SLACK

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.loop.record import Record

_MOST = 8  # names with a curve of their own


@styled
def distances(record: Record) -> Figure:
    """Plot the room beyond each distance that was asked for, multipliers, and how much each gave way.

    Parameters
    ----------
    record
        Of a run with constraints.

    Raises
    ------
    ShapeError
        If it had none.

    Examples
    --------
    >>> distances(run.record).savefig("distances.png")  # doctest: +SKIP
    """
    if ROOM not in record.readings:
        raise ShapeError("record: had no constraints to keep")
    figure = new_figure(DOUBLE, 5.2)
    panels = figure.subplots(3, 1, sharex=True)
    room, pressure, slack = (record.readings[name] for name in (ROOM, PRESSURE, SLACK))
    nearest = np.argsort(np.nanmin(room.values, axis=0), kind="stable")[:_MOST]
    for k, i in enumerate(nearest):
        unit = 1e3 if room.units[i] == "m" else np.degrees(1.0)
        label = f"{room.parts[i]} [{'mm' if room.units[i] == 'm' else '°'}]"
        panels[0].plot(record.time, unit * room.values[:, i], label=label, **line_style(k))
        panels[1].plot(record.time, pressure.values[:, i], **line_style(k))
        panels[2].plot(record.time, 1e3 * slack.values[:, i], **line_style(k))
    panels[0].set_yscale("symlog", linthresh=10.0)
    beyond_spikes(panels[1], pressure.values[:, nearest])
    beyond_spikes(panels[2], 1e3 * slack.values[:, nearest])
    panels[0].axhline(0.0, color="black", linewidth=0.6)
    panels[0].set_ylabel("room beyond\nwhat is asked")
    panels[1].set_ylabel("multiplier")
    panels[2].set_ylabel("gave way\n[mm/s, mrad/s]")
    panels[-1].set_xlabel("time [s]")
    legend_below(figure, panels[0])
    return figure
