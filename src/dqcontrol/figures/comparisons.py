"""Figures of several runs over time. Each function returns a matplotlib figure and shows or saves nothing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures import style as styles
from dqcontrol.figures.plots import draw_errors, pose_panels, with_sign_of, without_jumps
from dqcontrol.loop.record import Record, row_norms
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_DECADES_OF_CRITERIA = 5  # of the criteria below their peak that are shown
_MOST = 8  # runs; more can hardly be told apart
_MOST_COLUMNS = 4
_LETTERS = 100  # of a line of notes across two columns


@styles.styled
def compare_poses(records: Mapping[str, Record]) -> Figure:
    """Plot the eight coefficients of several runs' poses over the longest run's desired one. [S17 Fig. 5.2]

    Signs follow the desired pose, which itself does not jump, so that x and −x, which are one pose, look it.

    Raises
    ------
    ShapeError
        If there is no run.
    """
    styles.first_of(records)
    longest = max(records.values(), key=len)
    desired = without_jumps(longest.desired_pose)
    figure, panels = pose_panels()
    for n, (label, record) in enumerate(records.items()):
        pose = _towards(record.pose, without_jumps(record.desired_pose), desired)
        for i, axes in enumerate(panels):
            axes.plot(record.time, pose[:, i], label=label, **styles.line_style(n))
    for i, axes in enumerate(panels):
        axes.plot(longest.time, desired[:, i], color=styles.DESIRED, ls=":", lw=1.2, label="desired")
        styles.at_least(axes, 1e-3)
    styles.legend_below(figure, panels[0])
    return figure


@styles.styled
def compare_joints(
    records: Mapping[str, Record],
    limits: Limits,
    joints: Sequence[int],
    span: tuple[float, float] | None = None,
) -> Figure:
    """Plot some joints of several runs, each in a panel of its own, with their limits. [S17 Figs 5.10, 5.13]

    Parameters
    ----------
    records
        Runs by label.
    limits
        Of all configuration variables.
    joints
        Indices of the revolute ones that are shown.
    span
        A time from and to, s, that is shaded.

    Raises
    ------
    ShapeError
        If there is no run.
    """
    names = styles.first_of(records).joint_names
    figure, panels = _titled_panels([names[i] for i in joints], 1.5)
    for axes, i in zip(panels, joints, strict=True):
        for n, (label, record) in enumerate(records.items()):
            axes.plot(record.time, np.degrees(record.q[:, i]), label=label, **styles.line_style(n))
        for bound in (limits.lower[i], limits.upper[i]):
            if np.isfinite(bound):
                axes.axhline(np.degrees(bound), color=styles.LIMIT, lw=1.1)
        if span is not None:
            axes.axvspan(*span, color="#dddddd", lw=0, zorder=0)
        axes.set_ylabel("angle [°]")
    styles.legend_below(figure, panels[0])
    return figure


@styles.styled
def compare_inputs(inputs: Mapping[str, tuple[Array, Array]], names: Sequence[str]) -> Figure:
    """Plot the inputs of several runs, each input in a panel of its own. [S17 Fig. 5.7]

    Parameters
    ----------
    inputs
        By label the times (N,) and the inputs (N, m).
    names
        m titles with their units.

    Raises
    ------
    ShapeError
        If there is no run.
    """
    if not inputs:
        raise ShapeError("inputs: expected at least one run, got none")
    figure, panels = _titled_panels(names, 1.4)
    for i, axes in enumerate(panels):
        for n, (label, (time, values)) in enumerate(inputs.items()):
            axes.step(time, values[:, i], where="post", label=label, **styles.line_style(n))
        styles.at_least(axes, 1e-3)
    styles.legend_below(figure, panels[0])
    return figure


def _titled_panels(titles: Sequence[str], height: float) -> tuple[Figure, Any]:
    """Return a figure and its panels over time, one for each title."""
    figure, grid = styles.panel_grid(len(titles), 2, height, 0.8, sharex=True)
    panels = grid.T.ravel()
    for axes, title in zip(panels, titles, strict=False):
        axes.set_title(title, loc="left")
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("time [s]")
    for axes in panels[len(titles) :]:
        axes.set_axis_off()
    return figure, panels[: len(titles)]


def _towards(poses: Array, own: Array, shown: Array) -> Array:
    """Return poses with signs that do not jump, the last of them near its own desired pose as that is shown."""
    smooth = without_jumps(poses)
    sign = np.sign(smooth[-1, :4] @ own[-1, :4]) * np.sign(own[0, :4] @ shown[0, :4])
    return smooth if sign == 0 else sign * smooth


@styles.styled
def compare_errors(records: Mapping[str, Record]) -> Figure:
    """Plot the errors of several runs by label, as `errors` does for one.

    Raises `ShapeError` if there is no run.

    Examples
    --------
    >>> compare_errors({"K": first.record, "LQR": second.record})  # doctest: +SKIP
    """
    figure = draw_errors(records)
    styles.legend_below(figure, figure.axes[0])
    return figure


@styles.styled
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

    styles.first_of(records)
    chosen = dict(list(records.items())[:_MOST])
    across = max(2, styles.panels_across(3))
    figure = styles.new_figure(styles.DOUBLE, 1.6 * 12 / across)
    grid = figure.subplots(12 // across, across, sharex=True)
    panels = grid.T.ravel()
    criteria, coordinates, coefficients = panels[:5], panels[5:8], panels[8:]
    widths = styles.line_widths(len(chosen))
    for i, ((label, record), width) in enumerate(zip(chosen.items(), widths, strict=True)):
        style = styles.line_style(i) | {"label": label, "lw": width}
        _draw_criteria(criteria, record, **style)
        for axes, values in zip(coordinates, record.position.T, strict=True):
            axes.plot(record.time, values, **style)
        for axes, values in zip(coefficients, _quaternions(record)[0].T, strict=True):
            axes.plot(record.time, values, **style)
    longest = max(chosen.values(), key=lambda record: record.duration)
    desired = np.hstack([longest.desired_position, _quaternions(longest)[1]])
    names = [*(f"${name}$ [m]" for name in "xyz"), *(f"orientation ${name}$" for name in "wijk")]
    for axes, values, name in zip(panels[5:], desired.T, names, strict=True):
        axes.plot(longest.time, values, color=styles.DESIRED, ls=(0, (5, 3)), lw=0.9, label="desired")
        axes.set_ylabel(name)
        styles.at_least(axes, 1e-3)
    for axes, label in zip(criteria, _labels(unit), strict=True):
        axes.set_ylabel(label)
        styles.logarithmic(axes, _DECADES_OF_CRITERIA)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    left_out = len(records) - len(chosen)
    more = [Line2D([], [], ls="", label=f"{left_out} more not shown")] if left_out else []
    styles.legend_below(figure, coordinates[0], more)
    if note:
        figure.suptitle(fill(note, _LETTERS), fontsize="medium")
    return figure


@styles.styled
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
    styles.first_of(records)
    chosen = dict(list(records.items())[:_MOST_COLUMNS])
    figure = styles.new_figure(styles.DOUBLE, 1.15 * 7 + 0.6)
    grid = figure.subplots(7, len(chosen), sharex=True, sharey="row", squeeze=False)
    for column, (title, record) in zip(grid.T, chosen.items(), strict=True):
        hand, desired = _quaternions(record)
        pairs = ((record.position, record.desired_position, "xyz"), (hand, desired, "wijk"))
        for axes, (values, wanted, names) in zip(column, pairs, strict=False):
            for i, name in enumerate(names):
                axes.plot(record.time, values[:, i], label=f"${name}$", **styles.line_style(i))
                axes.plot(
                    record.time,
                    wanted[:, i],
                    color=styles.DESIRED,
                    lw=0.8,
                    label="desired" if i == len(names) - 1 else "",
                )
        _draw_criteria(column[2:], record, color=styles.COLOURS[0], lw=0.9)
        column[0].set_title(title)
        column[-1].set_xlabel("time [s]")
    names = ("position\n[m]", "orientation", *_labels(unit))
    for axes, name in zip(grid[:, 0], names, strict=True):
        axes.set_ylabel(name)
    for axes in grid[2:, 0]:
        styles.logarithmic(axes, _DECADES_OF_CRITERIA)
    for axes in grid[:2, -1]:
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), handlelength=1.6)
    return figure


def _labels(unit: str) -> tuple[str, ...]:
    """Return the names of the criteria, their units below them: side by side they are longer than an axis."""
    rate = " or ".join(f"{each}/s" for each in unit.split(" or "))
    return (
        styles.ERROR,
        f"control\n[{rate}]",
        f"joint step\n[{unit}]",
        "speed\n[m/s]",
        "acceleration\n[m/s²]",
    )


def _draw_criteria(panels: Iterable[Any], record: Record, **style: Any) -> None:
    for axes, (time, values, held) in zip(panels, _criteria(record), strict=True):
        axes.plot(
            time, np.maximum(values, styles.FLOOR), drawstyle="steps-post" if held else "default", **style
        )


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
    desired = without_jumps(record.desired_pose[:, :4])
    return with_sign_of(desired, record.pose[:, :4]), desired
