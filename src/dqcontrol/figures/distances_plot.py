"""Distances that were to be kept, over time: how near they came, what pressed, and what gave way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    DOUBLE,
    NEUTRAL,
    at_least,
    beyond_spikes,
    legend_below,
    line_style,
    new_figure,
    styled,
)
from dqcontrol.loop.constraint_signals import PRESSURE, ROOM, SLACK
from dqcontrol.measures.held import PlanOfRun, plans_of_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.loop.record import Record

_MOST = 8  # names with a curve of their own
_ROOM_LABELS = {"m": "room beyond\nwhat is asked [mm]", "rad": "room beyond\nwhat is asked [°]"}
_SLACK_LABELS = {"m": "gave way\n[mm/s]", "rad": "gave way\n[°/s]"}
_PROVED: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 1.2}
_STILL = 1e-3  # the least height of a panel of multipliers or of what gave way


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
    from matplotlib.lines import Line2D

    if ROOM not in record.readings:
        raise ShapeError("record: had no constraints to keep")
    room, pressure, slack = (record.readings[name] for name in (ROOM, PRESSURE, SLACK))
    nearest = np.argsort(np.nanmin(room.values, axis=0), kind="stable")[:_MOST]
    of_unit = {unit: [k for k, i in enumerate(nearest) if room.units[i] == unit] for unit in ("m", "rad")}
    rows = [(room, unit, label) for unit, label in _ROOM_LABELS.items() if of_unit[unit]]
    rows.append((pressure, "", "multiplier"))
    rows += [
        (slack, unit, label)
        for unit, label in _SLACK_LABELS.items()
        if slack.values[:, nearest[of_unit[unit]]].any()
    ]
    figure = new_figure(DOUBLE, 0.7 + 1.5 * len(rows))
    made = plans_of_run(record)
    panels = figure.subplots(len(rows), 1, sharex=True)
    for axes, (signal, unit, label) in zip(panels, rows, strict=True):
        shown = of_unit[unit] if unit else range(len(nearest))
        scale = {"m": 1e3, "rad": np.degrees(1.0), "": 1.0}[unit]
        values = scale * signal.values[:, nearest]
        for k in shown:
            axes.plot(record.time, values[:, k], label=room.parts[nearest[k]], **line_style(k))
        if signal is room:
            axes.set_yscale("symlog", linthresh=10.0)
            axes.axhline(0.0, color="black", linewidth=0.6)
            if unit == "m" and made:
                _draw_proofs(axes, made, float(record.time[-1]))
        else:
            beyond_spikes(axes, values[:, shown])
            at_least(axes, _STILL)
        axes.set_ylabel(label)
    panels[-1].set_xlabel("time [s]")
    _draw_causes(panels, made)
    proofs = [Line2D([], [], label="proved of the planned way", **_PROVED)] if made else []
    legend_below(figure, panels[len(rows) - 1 - sum(signal is slack for signal, _, _ in rows)], proofs)
    return figure


def _draw_proofs(axes: Any, made: Sequence[PlanOfRun], end: float) -> None:
    """Draw the room that is proved of planned ways."""
    ends = [*(each.time for each in made[1:]), end]
    for each, last in zip(made, ends, strict=True):
        if np.isfinite(each.room):
            axes.hlines(1e3 * each.room, each.time, last, **_PROVED)


def _draw_causes(panels: Sequence[Any], made: Sequence[PlanOfRun]) -> None:
    """Draw when another way was planned, and say why in the last panel."""
    for each in made:
        if not each.held_by:
            continue
        for axes in panels:
            axes.axvline(each.time, color=NEUTRAL, linewidth=0.8)
        panels[-1].annotate(
            f" planned again:\n held by {each.held_by}",
            (each.time, 0.97),
            xycoords=("data", "axes fraction"),
            va="top",
            fontsize="small",
        )
