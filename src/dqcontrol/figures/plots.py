"""Figures of runs over time. Each function returns a matplotlib figure and shows or saves nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.figures.pose_panels import pose_panels
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
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
