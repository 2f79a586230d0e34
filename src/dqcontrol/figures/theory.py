"""Figures of theory: Lyapunov function, range condition, the criteria of published comparisons."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import (
    COLOURS,
    DESIRED,
    DOUBLE,
    ERROR,
    FLOOR,
    at_least,
    legend_below,
    line_style,
    line_widths,
    logarithmic,
    new_figure,
    panels_across,
    styled,
)
from dqcontrol.loop.record import Record, row_norms

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.measures.lyapunov import Certificate
    from dqcontrol.measures.task_range import TaskRange


_DECADES_OF_V = 8  # of V below its peak that are shown, which are four of the error
_FLOOR = 1e-16  # 1/s², where V is 0
_STILL_RATE = 1e-6  # the least height of the other panels: a hundredth of what an encoder of 16 bits sees


@styled
def lyapunov(certificate: Certificate) -> Figure:
    """Plot V with its parts, its rate beside −2 k_v |ξ̃|², and the share of the twist asked for outside the range of J.

    Examples
    --------
    >>> lyapunov(certificate(robot, run.record, law)).savefig("lyapunov.png")  # doctest: +SKIP
    """
    time = certificate.time
    figure = new_figure(DOUBLE, 7.4)
    panels = figure.subplots(5, 1, sharex=True)
    for i, (label, values) in enumerate(
        (
            ("$V$", certificate.value),
            (r"$|\tilde\xi|^2$", certificate.velocity_part),
            (r"$\bar k\,|\log\tilde x|^2$", certificate.pose_part),
        )
    ):
        panels[0].plot(time, np.maximum(values, _FLOOR), label=label, **line_style(i))
    logarithmic(panels[0], _DECADES_OF_V)
    panels[0].set_ylabel("$V$ [1/s²]")
    panels[1].plot(time[:-1], certificate.rate, label=r"$\dot V$, differences", **line_style(3))
    panels[1].plot(time, certificate.predicted_rate, label=r"$-2k_v|\tilde\xi|^2$", **line_style(4))
    panels[1].set_ylabel(r"$\dot V$ [1/s³]")
    panels[2].plot(time, certificate.matrosov, **line_style(5))
    panels[2].set_ylabel("$W_2$ [1/s]")
    panels[3].plot(time, certificate.outside_range, label="twist outside range of J", **line_style(6))
    panels[3].set_ylabel("twist\n[m/s, rad/s]")
    panels[4].plot(
        time, certificate.smallest_singular_value, label=r"smallest $\sigma$ of J", **line_style(7)
    )
    panels[4].set_ylabel("$\\sigma$ [m, rad]")
    for axes in panels[1:]:
        at_least(axes, _STILL_RATE)
    panels[-1].set_xlabel("time [s]")
    artists = [artist for axes in panels[1:] for artist in axes.get_legend_handles_labels()[0]]
    legend_below(figure, panels[0], artists)
    return figure


_DECADES = 6  # of the error below its peak that are shown
_STILL_SHARE = 1e-6  # m/s, rad/s, m and rad: the least height of the other panels


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
        at_least(axes, _STILL_SHARE)
    panels[-1].set_xlabel("time [s]")
    artists = [artist for axes in panels[1:] for artist in axes.get_legend_handles_labels()[0]]
    legend_below(figure, panels[0], artists)
    return figure


_DECADES_OF_CRITERIA = 5  # of the criteria below their peak that are shown

_MOST = 8  # runs; more can hardly be told apart
_MOST_COLUMNS = 4
_LETTERS = 100  # of a line of notes across two columns


@styled
def compare_criteria(records: Mapping[str, Record], unit: str = "rad or m", note: str = "") -> Figure:
    """Plot the criteria of several runs of one task, and their poses over the desired one [P16 5.2, Figures 5.2–5.4].

    The criteria are the norms of error, control signal, joint step from sample to sample, velocity and acceleration of
    the end effector, on logarithmic axes that hold both the first peak and what follows; the pose is the end effector's
    position and its orientation as a quaternion.

    Parameters
    ----------
    records
        Runs by label; the first eight are shown. The desired pose shown is that of the longest.
    unit
        Of the inputs' way: ``"rad"`` if all joints are revolute.
    note
        Words above the panels, as on runs that are not drawn.

    Raises
    ------
    ShapeError
        If there is no run.

    Examples
    --------
    >>> compare_criteria({"K": first.record, "LQR": second.record})  # doctest: +SKIP
    """
    from matplotlib.lines import Line2D

    if not records:
        raise ShapeError("records: expected at least one run, got none")
    chosen = dict(list(records.items())[:_MOST])
    across = max(2, panels_across(3))
    figure = new_figure(DOUBLE, 1.6 * 12 / across)
    grid = figure.subplots(12 // across, across, sharex=True)
    panels = grid.T.ravel()
    criteria, coordinates, coefficients = panels[:5], panels[5:8], panels[8:]
    widths = line_widths(len(chosen))
    for i, ((label, record), width) in enumerate(zip(chosen.items(), widths, strict=True)):
        style = line_style(i) | {"label": label, "lw": width}
        _draw_criteria(criteria, record, **style)
        for axes, values in zip(coordinates, record.position.T, strict=True):
            axes.plot(record.time, values, **style)
        for axes, values in zip(coefficients, _quaternions(record)[0].T, strict=True):
            axes.plot(record.time, values, **style)
    longest = max(chosen.values(), key=lambda record: record.duration)
    desired = np.hstack([longest.desired_position, _quaternions(longest)[1]])
    names = [*(f"${name}$ [m]" for name in "xyz"), *(f"orientation ${name}$" for name in "wijk")]
    for axes, values, name in zip(panels[5:], desired.T, names, strict=True):
        axes.plot(longest.time, values, color=DESIRED, ls=(0, (5, 3)), lw=0.9, label="desired")
        axes.set_ylabel(name)
        at_least(axes, 1e-3)
    for axes, label in zip(criteria, _labels(unit), strict=True):
        axes.set_ylabel(label)
        logarithmic(axes, _DECADES_OF_CRITERIA)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    left_out = len(records) - len(chosen)
    more = [Line2D([], [], ls="", label=f"{left_out} more not shown")] if left_out else []
    legend_below(figure, coordinates[0], more)
    if note:
        figure.suptitle(fill(note, _LETTERS), fontsize="medium")
    return figure


@styled
def criteria_side_by_side(records: Mapping[str, Record], unit: str = "rad or m") -> Figure:
    """Plot the pose and the criteria of each run in a column of its own, rows to one scale [P16 Figure 5.2].

    The end effector's position and its orientation as a quaternion are drawn over the desired ones, the criteria of
    `compare_criteria` below them.

    Parameters
    ----------
    records
        Runs by the titles of their columns; the first four are shown.
    unit
        As for `compare_criteria`.

    Raises
    ------
    ShapeError
        If there is no run.

    Examples
    --------
    >>> criteria_side_by_side({"20 %": slow.record, "100 %": fast.record})  # doctest: +SKIP
    """
    if not records:
        raise ShapeError("records: expected at least one run, got none")
    chosen = dict(list(records.items())[:_MOST_COLUMNS])
    figure = new_figure(DOUBLE, 1.15 * 7 + 0.6)
    grid = figure.subplots(7, len(chosen), sharex=True, sharey="row", squeeze=False)
    for column, (title, record) in zip(grid.T, chosen.items(), strict=True):
        hand, desired = _quaternions(record)
        pairs = ((record.position, record.desired_position, "xyz"), (hand, desired, "wijk"))
        for axes, (values, wanted, names) in zip(column, pairs, strict=False):
            for i, name in enumerate(names):
                axes.plot(record.time, values[:, i], label=f"${name}$", **line_style(i))
                axes.plot(
                    record.time,
                    wanted[:, i],
                    color=DESIRED,
                    lw=0.8,
                    label="desired" if i == len(names) - 1 else "",
                )
        _draw_criteria(column[2:], record, color=COLOURS[0], lw=0.9)
        column[0].set_title(title)
        column[-1].set_xlabel("time [s]")
    names = ("position\n[m]", "orientation", *_labels(unit))
    for axes, name in zip(grid[:, 0], names, strict=True):
        axes.set_ylabel(name)
    for axes in grid[2:, 0]:
        logarithmic(axes, _DECADES_OF_CRITERIA)
    for axes in grid[:2, -1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), handlelength=1.6)
    return figure


def _labels(unit: str) -> tuple[str, ...]:
    """Return the names of the criteria, their units below them: side by side they are longer than an axis."""
    rate = " or ".join(f"{each}/s" for each in unit.split(" or "))
    return (
        ERROR,
        f"control\n[{rate}]",
        f"joint step\n[{unit}]",
        "speed\n[m/s]",
        "acceleration\n[m/s²]",
    )


def _draw_criteria(panels: Iterable[Any], record: Record, **style: Any) -> None:
    for axes, (time, values, held) in zip(panels, _criteria(record), strict=True):
        axes.plot(time, np.maximum(values, FLOOR), drawstyle="steps-post" if held else "default", **style)


def _criteria(record: Record) -> list[tuple[Array, Array, bool]]:
    """Return time and value of each criterion, and whether it is held from sample to sample."""
    time, intervals = record.time, np.diff(record.time)
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        velocity = np.diff(record.position, axis=0) / intervals[:, None]
        acceleration = np.diff(velocity, axis=0) / ((intervals[1:] + intervals[:-1]) / 2)[:, None]
        return [
            (time, record.error, False),
            (time[:-1], row_norms(record.command[:-1]), True),  # the last one moves nothing
            (time[:-1], row_norms(np.diff(record.q, axis=0)), True),
            (time[:-1], row_norms(velocity), True),
            (time[1:-1], row_norms(acceleration), False),
        ]


def _quaternions(record: Record) -> tuple[Array, Array]:
    """Return the quaternions of end effector and desired pose, with signs that do not jump and agree in all runs."""
    hand, desired = record.pose[:, :4], record.desired_pose[:, :4]
    with np.errstate(invalid="ignore", over="ignore"):
        flips = np.where((desired[1:] * desired[:-1]).sum(axis=1) < 0, -1.0, 1.0)
        desired = desired * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
        return hand * np.where((hand * desired).sum(axis=1) < 0, -1.0, 1.0)[:, None], desired
