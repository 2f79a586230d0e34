"""Figures of runs over time. Each function returns a matplotlib figure and shows or saves nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.figures.style import (
    COLOURS,
    DESIRED,
    DOUBLE,
    ERROR,
    FLOOR,
    LIMIT,
    at_least,
    has_transient,
    legend_below,
    line_style,
    logarithmic,
    new_figure,
    panels_across,
    plain_names,
    styled,
)
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import TASK
from dqcontrol.measures.metrics import joint_margins
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_NAMES = ("$w$", "$i$", "$j$", "$k$")


def pose_panels() -> tuple[Any, list[Any]]:
    """Return a figure and its labelled axes: those of the primary part, then of the dual part."""
    figure = new_figure(DOUBLE, 6.2)
    grid = figure.subplots(4, 2, sharex=True)
    panels = [*grid[:, 0], *grid[:, 1]]
    for i, axes in enumerate(panels):
        axes.set_ylabel(_NAMES[i % 4] + (" [m]" if i > 3 else ""))
    grid[0, 0].set_title("primary part")
    grid[0, 1].set_title("dual part")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    return figure, panels


@styled
def compare_poses(records: Mapping[str, Record]) -> Figure:
    """Plot the eight coefficients of several runs' poses over the longest run's desired one. [S17 Fig. 5.2]

    Signs follow the desired pose, which itself does not jump, so that x and −x, which are one pose, look it.

    Raises
    ------
    ShapeError
        If there is no run.
    """
    _first(records)
    longest = max(records.values(), key=len)
    desired = _without_jumps(longest.desired_pose)
    figure, panels = pose_panels()
    for n, (label, record) in enumerate(records.items()):
        pose = _towards(record.pose, _without_jumps(record.desired_pose), desired)
        for i, axes in enumerate(panels):
            axes.plot(record.time, pose[:, i], label=label, **line_style(n))
    for i, axes in enumerate(panels):
        axes.plot(longest.time, desired[:, i], color=DESIRED, ls=":", lw=1.2, label="desired")
        at_least(axes, 1e-3)
    legend_below(figure, panels[0])
    return figure


@styled
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
    first = _first(records)
    across = panels_across(2)
    rows = -(-len(joints) // across)
    figure = new_figure(DOUBLE, 0.8 + 1.5 * rows)
    panels = figure.subplots(rows, across, sharex=True, squeeze=False).T.ravel()
    for axes, i in zip(panels, joints, strict=False):
        for n, (label, record) in enumerate(records.items()):
            axes.plot(record.time, np.degrees(record.q[:, i]), label=label, **line_style(n))
        for bound in (limits.lower[i], limits.upper[i]):
            if np.isfinite(bound):
                axes.axhline(np.degrees(bound), color=LIMIT, lw=1.1)
        if span is not None:
            axes.axvspan(*span, color="#dddddd", lw=0, zorder=0)
        axes.set_title(first.joint_names[i], loc="left")
        axes.set_ylabel("angle [°]")
    for axes in panels[len(joints) :]:
        axes.set_axis_off()
    for axes in panels[: len(joints)]:
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("time [s]")
    legend_below(figure, panels[0])
    return figure


@styled
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
    across = panels_across(2)
    rows = -(-len(names) // across)
    figure = new_figure(DOUBLE, 0.8 + 1.4 * rows)
    panels: Any = figure.subplots(rows, across, sharex=True, squeeze=False).T.ravel()
    for i, name in enumerate(names):
        for n, (label, (time, values)) in enumerate(inputs.items()):
            panels[i].step(time, values[:, i], where="post", label=label, **line_style(n))
        panels[i].set_title(name, loc="left")
        at_least(panels[i], 1e-3)
        panels[i].tick_params(labelbottom=True)
        panels[i].set_xlabel("time [s]")
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    legend_below(figure, panels[0])
    return figure


def _first(records: Mapping[str, Record]) -> Record:
    if not records:
        raise ShapeError("records: expected at least one run, got none")
    return next(iter(records.values()))


def _without_jumps(poses: Array) -> Array:
    """Return poses whose signs do not change from one to the next."""
    flips = np.where((poses[1:, :4] * poses[:-1, :4]).sum(axis=1) < 0, -1.0, 1.0)
    return poses * np.concatenate([[1.0], np.cumprod(flips)])[:, None]


def _towards(poses: Array, own: Array, shown: Array) -> Array:
    """Return poses with signs that do not jump, the last of them near its own desired pose as that is shown."""
    smooth = _without_jumps(poses)
    sign = np.sign(smooth[-1, :4] @ own[-1, :4]) * np.sign(own[0, :4] @ shown[0, :4])
    return smooth if sign == 0 else sign * smooth


_TITLES = {  # those that are drawn, in this order; the others stand in the recording
    "contact_force": "contact",
    "push": "push",
    "wrist_force": "wrist",
    "wrist_torque": "wrist",
    "payload": "payload",
    "spring_torque": "springs",
    "grip_force": "grip",
}

_STILL_READING = 1e-3  # N, N·m and kg: the least height of a panel


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
        at_least(axes, _STILL_READING)
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


_SMALLEST_ERROR = 1e-3  # mm and °: the least height of a panel


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
        axes.set_ylim(0, max(_SMALLEST_ERROR, axes.get_ylim()[1]))
    panels[1].set_xlabel("time [s]")
    legend_below(figure, panels[0])
    return figure


@styled
def disturbance(record: Record) -> Figure:
    """Plot the rotation ω and the velocity ṗ = v − p × ω that the disturbance gave the end effector, inertial axes.

    Parameters
    ----------
    record
        A run with a disturbance.

    Raises
    ------
    ShapeError
        If it had none.

    Examples
    --------
    >>> disturbance(run.record).savefig("disturbance.png")  # doctest: +SKIP
    """
    if record.disturbance is None:
        raise ShapeError("record: holds no disturbance")
    omega = record.disturbance[:, :3]
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        velocity = record.disturbance[:, 3:] - np.cross(record.position, omega)
    figure = new_figure(DOUBLE, 3.8)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, values, label in zip(
        panels, (omega, velocity), ("rotation [rad/s]", "velocity of end effector [m/s]"), strict=True
    ):
        for i, name in enumerate("xyz"):
            axes.step(record.time, values[:, i], where="post", label=name, lw=1.0, **line_style(i))
        axes.set_ylabel(label)
        at_least(axes, 1e-3)
    panels[-1].set_xlabel("time [s]")
    legend_below(figure, panels[0])
    return figure


UNITS = ("m", "rad")
_STILL = 1e-3  # m/s or rad/s: the least height of a panel of commands
_DECADES = 6  # of the error below its peak that are shown
_SMALLEST = {"mm": 1e-3, "°": 1e-3}  # a micrometre and 4 seconds of arc: no axis shows less in full height


@styled
def pose_coefficients(record: Record) -> Figure:
    """Plot the eight coefficients of the end pose over the desired ones.

    Signs follow the end effector continuously and the desired pose takes the nearer sign, so that a change between x
    and −x, which are one pose, does not show as a jump.

    Parameters
    ----------
    record
        The run.

    Examples
    --------
    >>> pose_coefficients(run.record).savefig("pose.png")  # doctest: +SKIP
    """
    pose, desired = _continuous(record)
    figure, panels = pose_panels()
    for i, axes in enumerate(panels):
        axes.plot(record.time, pose[:, i], color=COLOURS[0], label="end effector")
        axes.plot(record.time, desired[:, i], color=DESIRED, ls="--", lw=1.1, label="desired")
        at_least(axes, 1e-3)
    legend_below(figure, panels[0])
    return figure


@styled
def errors(record: Record) -> Figure:
    """Plot the error of a run: its norm |1 − x* x_d| (logarithmic), in mm and in degrees."""
    return _errors({"": record})


@styled
def compare_errors(records: Mapping[str, Record]) -> Figure:
    """Plot the errors of several runs by label, as `errors` does for one.

    Raises `ShapeError` if there is no run.

    Examples
    --------
    >>> compare_errors({"K": first.record, "LQR": second.record})  # doctest: +SKIP
    """
    figure = _errors(records)
    legend_below(figure, figure.axes[0])
    return figure


@styled
def joint_angles(record: Record, limits: Limits | None = None, units: Sequence[str] | None = None) -> Figure:
    """Plot each configuration variable in a panel of its own, with the limits that are near.

    Parameters
    ----------
    record
        The run.
    limits
        Of the configuration variables. A limit is drawn where it lies close to the motion, and stands in the
        panel's title in any case.
    units
        ``"rad"`` (shown in degrees) or ``"m"`` for each variable; rad if omitted.

    Raises
    ------
    ShapeError
        If limits or units do not fit the record.
    UnknownNameError
        If a unit is neither.
    """
    units = _units("units", units, record.joint_names)
    if limits is not None and len(limits.lower) != len(units):
        raise ShapeError(f"limits: expected {len(units)} as in the record's q, got {len(limits.lower)}")
    columns = panels_across(2) if len(units) > 1 else 1
    rows = -(-len(units) // columns)
    figure = new_figure(DOUBLE, 0.7 + 1.35 * rows)
    panels = figure.subplots(rows, columns, sharex=True, squeeze=False).T.ravel()
    for i, (name, unit) in enumerate(zip(plain_names(record.joint_names), units, strict=True)):
        axes = panels[i]
        scale, sign = (180 / np.pi, "°") if unit == "rad" else (1.0, "m")
        axes.plot(record.time, scale * record.q[:, i], color=COLOURS[0])
        at_least(axes, scale * 0.01)
        title = name
        if limits is not None:
            lower, upper = scale * limits.lower[i], scale * limits.upper[i]
            title += f"   ({_bound(lower)} … {_bound(upper)} {sign})"
            _near_limits(axes, lower, upper)
        axes.set_title(title, loc="left")
        axes.set_ylabel("angle [°]" if unit == "rad" else "position [m]")
    for axes in panels[len(units) :]:  # an empty panel carries the time axis of its column
        axes.spines.left.set_visible(False)
        axes.tick_params(left=False, labelleft=False)
        axes.grid(False)
    for axes in panels[rows - 1 :: rows]:
        axes.set_xlabel("time [s]")
    return figure


@styled
def control_signals(record: Record, units: Sequence[str] | None = None) -> Figure:
    """Plot the commanded inputs and the norm of those of one unit, each held until the next sample.

    Parameters
    ----------
    record
        The run.
    units
        ``"rad"`` or ``"m"`` for each input, meaning rad/s or m/s; rad if omitted. Each unit has its panel.

    Raises
    ------
    ShapeError, UnknownNameError
        If the units do not fit the record, or one is neither.
    """
    units = _units("units", units, record.input_names)
    kinds = [unit for unit in ("rad", "m") if unit in units]
    command = record.command.copy()
    if len(command) > 1 and not command[-1].any():
        command[-1] = command[-2]  # nothing was commanded any more, which is no end of the motion
    of_kind = {kind: [i for i, unit in enumerate(units) if unit == kind] for kind in kinds}
    several = [kind for kind in kinds if len(of_kind[kind]) > 1]
    count, names = len(kinds) + len(several), plain_names(record.input_names)
    figure = new_figure(DOUBLE, 1.9 * count + 0.4)
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    for axes, (kind, mine) in zip(panels, of_kind.items(), strict=False):
        for i in mine:
            axes.step(record.time, command[:, i], where="post", label=names[i], **line_style(i))
        axes.set_ylabel(f"input [{kind}/s]")
        at_least(axes, _STILL)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(mine) - 1) // 8)
    for axes, kind in zip(panels[len(kinds) :], several, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):  # a diverged run
            norm = np.linalg.norm(command[:, of_kind[kind]], axis=1)
        axes.step(record.time, norm, where="post", color=DESIRED)
        axes.set_ylabel(f"norm [{kind}/s]")
        axes.set_ylim(0, max(axes.get_ylim()[1], _STILL))
    panels[-1].set_xlabel("time [s]")
    return figure


def _errors(records: Mapping[str, Record]) -> Figure:
    if not records:
        raise ShapeError("records: expected at least one run, got none")
    figure = new_figure(DOUBLE, 5.0)
    panels = figure.subplots(3, 1, sharex=True)
    for i, (label, record) in enumerate(records.items()):
        style = line_style(i) | {"label": label}
        panels[0].plot(record.time, np.maximum(record.error, FLOOR), **style)
        panels[1].plot(record.time, 1e3 * record.position_error, **style)
        panels[2].plot(record.time, np.degrees(record.orientation_error), **style)
    logarithmic(panels[0], _DECADES)
    panels[0].set_ylabel(ERROR)
    for axes, name, unit in ((panels[1], "position", "mm"), (panels[2], "orientation", "°")):
        axes.set_ylabel(f"{name} [{unit}]")
        if all(has_transient(np.asarray(line.get_ydata())) for line in axes.lines):
            logarithmic(axes, floor=_SMALLEST[unit])
        else:
            axes.set_ylim(0, max(_SMALLEST[unit], axes.get_ylim()[1]))
    panels[2].set_xlabel("time [s]")
    return figure


def _continuous(record: Record) -> tuple[Array, Array]:
    """Return pose and desired pose with signs that do not jump."""
    pose, desired = record.pose.copy(), record.desired_pose.copy()
    with np.errstate(invalid="ignore", over="ignore"):
        flips = np.where((pose[1:, :4] * pose[:-1, :4]).sum(axis=1) < 0, -1.0, 1.0)
        pose[1:] *= np.cumprod(flips)[:, None]
        desired *= np.where((pose[:, :4] * desired[:, :4]).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    return pose, desired


def _units(field: str, units: Sequence[str] | None, names: Sequence[str]) -> Sequence[str]:
    if units is None:
        return ["rad"] * len(names)
    if len(units) != len(names):
        raise ShapeError(f"{field}: expected {len(names)} units, got {len(units)}")
    for unit in units:
        if unit not in UNITS:
            raise unknown_name(field, unit, UNITS)
    return units


def _near_limits(axes: Axes, lower: float, upper: float) -> None:
    """Draw the limits that lie within one height of the panel from it."""
    low, high = axes.get_ylim()
    height = high - low
    if np.isfinite(lower) and low - lower < height:
        axes.axhline(lower, color=LIMIT, ls="--", lw=1.1)
        axes.set_ylim(bottom=min(low, lower - 0.08 * height))
    if np.isfinite(upper) and upper - high < height:
        axes.axhline(upper, color=LIMIT, ls="--", lw=1.1)
        axes.set_ylim(top=max(high, upper + 0.08 * height))


def _bound(value: float) -> str:
    return f"{value:.4g}".replace("-", "−").replace("inf", "∞")
