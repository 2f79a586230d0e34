"""What a plant sensed beside its configuration, and how far the joints stayed from their limits, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    DOUBLE,
    LIMIT,
    at_least,
    legend_below,
    line_style,
    new_figure,
    plain_names,
    styled,
)
from dqcontrol.loop.record import Record
from dqcontrol.measures.margins import joint_margins
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TITLES = {  # those that are drawn, in this order; the others stand in the recording
    "contact_force": "contact",
    "push": "push",
    "wrist_force": "wrist",
    "wrist_torque": "wrist",
    "payload": "payload",
    "spring_torque": "springs",
    "grip_force": "grip",
}

_STILL = 1e-3  # N, N·m and kg: the least height of a panel


def has_margins(limits: Limits) -> bool:
    """Return whether any variable has both limits, so that `limit_margins` can draw it."""
    return bool(np.isfinite(limits.upper - limits.lower).any())


def has_readings(record: Record) -> bool:
    """Return whether there is anything for `readings` to draw."""
    return bool(_drawn(record))


@styled
def readings(record: Record) -> Figure:
    """Plot what the plant sensed of forces: contact, pushes, wrist, payload with its estimate, springs.

    Each quantity has a panel; what was 0 all the time has none.

    Parameters
    ----------
    record
        A run on a plant that senses.

    Raises
    ------
    ShapeError
        If it sensed none of these.

    Examples
    --------
    >>> readings(run.record).savefig("readings.png")  # doctest: +SKIP
    """
    names = _drawn(record)
    if not names:
        raise ShapeError("record: holds no readings of forces")
    figure = new_figure(DOUBLE, 0.5 + 1.45 * len(names))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for axes, name in zip(panels, names, strict=True):
        signal = record.readings[name]
        for i, label in enumerate(signal.parts or (name,)):
            axes.plot(record.time, signal.values[:, i], label=label, **line_style(i))
        if name == "payload" and "payload_estimate" in record.readings:
            values = record.readings["payload_estimate"].values[:, 0]
            axes.plot(record.time, values, label="estimate", **line_style(1))
        axes.set_ylabel(f"{_TITLES[name]} [{signal.units[0]}]")
        at_least(axes, _STILL)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    panels[-1].set_xlabel("time [s]")
    return figure


@styled
def limit_margins(record: Record, limits: Limits) -> Figure:
    """Plot each joint's distance from its nearest limit, as a share of half its range; 0 is at the limit.

    Parameters
    ----------
    record
        The run.
    limits
        Of the configuration variables; those without both limits are left out.

    Raises
    ------
    ShapeError
        If the limits do not fit the record, or no variable has both.
    """
    half = (limits.upper - limits.lower) / 2
    margins = joint_margins(record, limits)
    shown = np.flatnonzero(np.isfinite(half))
    if not len(shown):
        raise ShapeError("limits: no joint has both")
    figure, names = new_figure(DOUBLE, 3.2), plain_names(record.joint_names)
    axes = figure.subplots()
    for i in shown:
        axes.plot(record.time, margins[i] / half[i], label=names[i], **line_style(int(i)))
    axes.axhline(0.0, color=LIMIT, ls="--", lw=1.1)
    axes.set_ylim(bottom=min(-0.03, axes.get_ylim()[0]), top=max(axes.get_ylim()[1], 0.1))
    axes.set_ylabel("margin / half range")
    axes.set_xlabel("time [s]")
    legend_below(figure, axes)
    return figure


def _drawn(record: Record) -> list[str]:
    return [name for name in _TITLES if name in record.readings and np.any(record.readings[name].values != 0)]
