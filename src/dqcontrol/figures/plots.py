"""Figures of one run over time. Each function returns a matplotlib figure and shows or saves nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.figures import style as styles
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import PRESSURE, ROOM, SLACK, TASK
from dqcontrol.measures.held import PlanOfRun, plans_of_run
from dqcontrol.measures.metrics import joint_margins
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dqcontrol.measures.lyapunov import Certificate
    from dqcontrol.measures.task_range import TaskRange


UNITS = ("m", "rad")
_NAMES = ("$w$", "$i$", "$j$", "$k$")
_STILL = 1e-3  # m/s or rad/s, mm and °, N, N·m and kg, multipliers: the least height of a panel
_DECADES = 6  # of the error below its peak that are shown


def pose_panels() -> tuple[Any, list[Any]]:
    """Return a figure and its labelled axes: those of the primary part, then of the dual part."""
    figure = styles.new_figure(styles.DOUBLE, 6.2)
    grid = figure.subplots(4, 2, sharex=True)
    panels = [*grid[:, 0], *grid[:, 1]]
    for i, axes in enumerate(panels):
        axes.set_ylabel(_NAMES[i % 4] + (" [m]" if i > 3 else ""))
    grid[0, 0].set_title("primary part")
    grid[0, 1].set_title("dual part")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    return figure, panels


def without_jumps(poses: Array) -> Array:
    """Return poses, or their rotations, whose signs do not change from one to the next."""
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        flips = np.where((poses[1:, :4] * poses[:-1, :4]).sum(axis=1) < 0, -1.0, 1.0)
        return poses * np.concatenate([[1.0], np.cumprod(flips)])[:, None]


def with_sign_of(shown: Array, poses: Array) -> Array:
    """Return poses, or their rotations, each with the sign that is nearer to what is shown."""
    with np.errstate(invalid="ignore", over="ignore"):
        return poses * np.where((poses[:, :4] * shown[:, :4]).sum(axis=1) < 0, -1.0, 1.0)[:, None]


@styles.styled
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
    pose = without_jumps(record.pose)
    desired = with_sign_of(pose, record.desired_pose)
    figure, panels = pose_panels()
    for i, axes in enumerate(panels):
        axes.plot(record.time, pose[:, i], color=styles.COLOURS[0], label="end effector")
        axes.plot(record.time, desired[:, i], color=styles.DESIRED, ls="--", lw=1.1, label="desired")
        styles.at_least(axes, 1e-3)
    styles.legend_below(figure, panels[0])
    return figure


@styles.styled
def errors(record: Record) -> Figure:
    """Plot the error of a run: its norm |1 − x* x_d| (logarithmic), in mm and in degrees."""
    return draw_errors({"": record})


def draw_errors(records: Mapping[str, Record]) -> Figure:
    """Return a figure of the errors of runs by label."""
    styles.first_of(records)
    figure, panels = styles.time_panels(3, 5.0)
    for i, (label, record) in enumerate(records.items()):
        style = styles.line_style(i) | {"label": label}
        panels[0].plot(record.time, np.maximum(record.error, styles.FLOOR), **style)
        panels[1].plot(record.time, 1e3 * record.position_error, **style)
        panels[2].plot(record.time, np.degrees(record.orientation_error), **style)
    styles.logarithmic(panels[0], _DECADES)
    panels[0].set_ylabel(styles.ERROR)
    for axes, name, unit in ((panels[1], "position", "mm"), (panels[2], "orientation", "°")):
        axes.set_ylabel(f"{name} [{unit}]")
        if all(styles.has_transient(np.asarray(line.get_ydata())) for line in axes.lines):
            styles.logarithmic(axes, floor=_STILL)
        else:
            axes.set_ylim(0, max(_STILL, axes.get_ylim()[1]))
    return figure


@styles.styled
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
    figure, grid = styles.panel_grid(len(units), 2 if len(units) > 1 else 1, 1.35, 0.7, sharex=True)
    panels = grid.T.ravel()
    for i, (name, unit) in enumerate(zip(styles.plain_names(record.joint_names), units, strict=True)):
        axes = panels[i]
        scale, sign = (180 / np.pi, "°") if unit == "rad" else (1.0, "m")
        axes.plot(record.time, scale * record.q[:, i], color=styles.COLOURS[0])
        styles.at_least(axes, scale * 0.01)
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
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    return figure


def _near_limits(axes: Axes, lower: float, upper: float) -> None:
    """Draw the limits that lie within one height of the panel from it."""
    low, high = axes.get_ylim()
    height = high - low
    if np.isfinite(lower) and low - lower < height:
        axes.axhline(lower, color=styles.LIMIT, ls="--", lw=1.1)
        axes.set_ylim(bottom=min(low, lower - 0.08 * height))
    if np.isfinite(upper) and upper - high < height:
        axes.axhline(upper, color=styles.LIMIT, ls="--", lw=1.1)
        axes.set_ylim(top=max(high, upper + 0.08 * height))


def _bound(value: float) -> str:
    return f"{value:.4g}".replace("-", "−").replace("inf", "∞")


@styles.styled
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
    count, names = len(kinds) + len(several), styles.plain_names(record.input_names)
    figure, panels = styles.time_panels(count, 1.9 * count + 0.4)
    for axes, (kind, mine) in zip(panels, of_kind.items(), strict=False):
        for i in mine:
            axes.step(record.time, command[:, i], where="post", label=names[i], **styles.line_style(i))
        axes.set_ylabel(f"input [{kind}/s]")
        styles.at_least(axes, _STILL)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), ncols=1 + (len(mine) - 1) // 8)
    for axes, kind in zip(panels[len(kinds) :], several, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):  # a diverged run
            norm = np.linalg.norm(command[:, of_kind[kind]], axis=1)
        axes.step(record.time, norm, where="post", color=styles.DESIRED)
        axes.set_ylabel(f"norm [{kind}/s]")
        axes.set_ylim(0, max(axes.get_ylim()[1], _STILL))
    return figure


def _units(field: str, units: Sequence[str] | None, names: Sequence[str]) -> Sequence[str]:
    if units is None:
        return ["rad"] * len(names)
    if len(units) != len(names):
        raise ShapeError(f"{field}: expected {len(names)} units, got {len(units)}")
    for unit in units:
        if unit not in UNITS:
            raise unknown_name(field, unit, UNITS)
    return units


def has_margins(limits: Limits) -> bool:
    """Return whether any variable has both limits, so that `limit_margins` can draw it."""
    return bool(np.isfinite(limits.upper - limits.lower).any())


@styles.styled
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
    figure, (axes,) = styles.time_panels(1, 3.2)
    names = styles.plain_names(record.joint_names)
    for i in shown:
        axes.plot(record.time, margins[i] / half[i], label=names[i], **styles.line_style(int(i)))
    axes.axhline(0.0, color=styles.LIMIT, ls="--", lw=1.1)
    axes.set_ylim(bottom=min(-0.03, axes.get_ylim()[0]), top=max(axes.get_ylim()[1], 0.1))
    axes.set_ylabel("margin / half range")
    styles.legend_below(figure, axes)
    return figure


_TITLES = {  # those that are drawn, in this order; the others stand in the recording
    "contact_force": "contact",
    "push": "push",
    "wrist_force": "wrist",
    "wrist_torque": "wrist",
    "payload": "payload",
    "spring_torque": "springs",
    "grip_force": "grip",
}


def _drawn(record: Record) -> list[str]:
    return [name for name in _TITLES if name in record.readings and np.any(record.readings[name].values != 0)]


def has_readings(record: Record) -> bool:
    """Return whether there is anything for `readings` to draw."""
    return bool(_drawn(record))


@styles.styled
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
    figure, panels = styles.time_panels(len(names), 0.5 + 1.45 * len(names))
    for axes, name in zip(panels, names, strict=True):
        signal = record.readings[name]
        for i, label in enumerate(signal.parts or (name,)):
            axes.plot(record.time, signal.values[:, i], label=label, **styles.line_style(i))
        if name == "payload" and "payload_estimate" in record.readings:
            values = record.readings["payload_estimate"].values[:, 0]
            axes.plot(record.time, values, label="estimate", **styles.line_style(1))
        axes.set_ylabel(f"{_TITLES[name]} [{signal.units[0]}]")
        styles.at_least(axes, _STILL)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def has_tasks(record: Record) -> bool:
    """Return whether there is anything for `task_errors` to draw."""
    return any(name.startswith(TASK) for name in record.readings)


@styles.styled
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
    figure, panels = styles.time_panels(2, 3.6)
    found = [(name, signal) for name, signal in record.readings.items() if name.startswith(TASK)]
    for i, (name, signal) in enumerate(found):
        label = name.removeprefix(TASK).replace("_", " ")
        moved, turned = 1e3 * signal.values[:, 0], np.degrees(signal.values[:, 1])
        panels[0].plot(record.time, moved, label=label, **styles.line_style(i))
        panels[1].plot(record.time, turned, label=label, **styles.line_style(i))
    for axes, name, unit in ((panels[0], "position", "mm"), (panels[1], "orientation", "°")):
        axes.set_ylabel(f"{name} [{unit}]")
        axes.set_ylim(0, max(_STILL, axes.get_ylim()[1]))
    styles.legend_below(figure, panels[0])
    return figure


@styles.styled
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
    figure, panels = styles.time_panels(2, 3.8)
    drawn = {"rotation [rad/s]": omega, "velocity of end effector [m/s]": velocity}
    for axes, (label, values) in zip(panels, drawn.items(), strict=True):
        for i, name in enumerate("xyz"):
            axes.step(record.time, values[:, i], where="post", label=name, lw=1.0, **styles.line_style(i))
        axes.set_ylabel(label)
        styles.at_least(axes, 1e-3)
    styles.legend_below(figure, panels[0])
    return figure


_MOST = 8  # names with a curve of their own
_ROOM_LABELS = {"m": "room beyond\nwhat is asked [mm]", "rad": "room beyond\nwhat is asked [°]"}
_SLACK_LABELS = {"m": "gave way\n[mm/s]", "rad": "gave way\n[°/s]"}
_PROVED: dict[str, Any] = {"color": "black", "linestyle": ":", "linewidth": 1.2}


@styles.styled
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
    figure, panels = styles.time_panels(len(rows), 0.7 + 1.5 * len(rows))
    made = plans_of_run(record)
    for axes, (signal, unit, label) in zip(panels, rows, strict=True):
        shown = of_unit[unit] if unit else range(len(nearest))
        scale = {"m": 1e3, "rad": np.degrees(1.0), "": 1.0}[unit]
        values = scale * signal.values[:, nearest]
        for k in shown:
            axes.plot(record.time, values[:, k], label=room.parts[nearest[k]], **styles.line_style(k))
        if signal is room:
            axes.set_yscale("symlog", linthresh=10.0)
            axes.axhline(0.0, color="black", linewidth=0.6)
            if unit == "m" and made:
                _draw_proofs(axes, made, float(record.time[-1]))
        else:
            styles.beyond_spikes(axes, values[:, shown])
            styles.at_least(axes, _STILL)
        axes.set_ylabel(label)
    _draw_causes(panels, made)
    proofs = [Line2D([], [], label="proved of the planned way", **_PROVED)] if made else []
    styles.legend_below(figure, panels[len(rows) - 1 - sum(signal is slack for signal, _, _ in rows)], proofs)
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
            axes.axvline(each.time, color=styles.NEUTRAL, linewidth=0.8)
        panels[-1].annotate(
            f" planned again:\n held by {each.held_by}",
            (each.time, 0.97),
            xycoords=("data", "axes fraction"),
            va="top",
            fontsize="small",
        )


_DECADES_OF_V = 8  # of V below its peak that are shown, which are four of the error
_FLOOR = 1e-16  # 1/s², where V is 0
_STILL_THEORY = 1e-6  # the least height of a panel of theory: a hundredth of what an encoder of 16 bits sees


@styles.styled
def lyapunov(certificate: Certificate) -> Figure:
    """Plot V with its parts, its rate beside −2 k_v |ξ̃|², and the share of the twist asked for outside the range of J.

    Examples
    --------
    >>> lyapunov(certificate(robot, run.record, law)).savefig("lyapunov.png")  # doctest: +SKIP
    """
    time = certificate.time
    figure, panels = styles.time_panels(5, 7.4)
    for i, (label, values) in enumerate(
        (
            ("$V$", certificate.value),
            (r"$|\tilde\xi|^2$", certificate.velocity_part),
            (r"$\bar k\,|\log\tilde x|^2$", certificate.pose_part),
        )
    ):
        panels[0].plot(time, np.maximum(values, _FLOOR), label=label, **styles.line_style(i))
    styles.logarithmic(panels[0], _DECADES_OF_V)
    panels[0].set_ylabel("$V$ [1/s²]")
    panels[1].plot(time[:-1], certificate.rate, label=r"$\dot V$, differences", **styles.line_style(3))
    panels[1].plot(time, certificate.predicted_rate, label=r"$-2k_v|\tilde\xi|^2$", **styles.line_style(4))
    panels[1].set_ylabel(r"$\dot V$ [1/s³]")
    panels[2].plot(time, certificate.matrosov, **styles.line_style(5))
    panels[2].set_ylabel("$W_2$ [1/s]")
    panels[3].plot(time, certificate.outside_range, label="twist outside range of J", **styles.line_style(6))
    panels[3].set_ylabel("twist\n[m/s, rad/s]")
    panels[4].plot(
        time, certificate.smallest_singular_value, label=r"smallest $\sigma$ of J", **styles.line_style(7)
    )
    panels[4].set_ylabel("$\\sigma$ [m, rad]")
    return _theory(figure, panels)


@styles.styled
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
    figure, panels = styles.time_panels(3, 5.2)
    time = found.time
    panels[0].plot(time, np.maximum(error, styles.FLOOR), **styles.line_style(0))
    styles.logarithmic(panels[0], _DECADES)
    panels[0].set_ylabel(styles.ERROR)
    panels[1].plot(time, found.asked, label="twist asked for", **styles.line_style(1))
    panels[1].plot(time, found.outside, label="outside the range of J", **styles.line_style(2))
    panels[1].set_ylabel("twist [m/s, rad/s]")
    panels[2].plot(time, found.smallest_singular_value, **styles.line_style(3))
    panels[2].set_ylabel("smallest\nsingular value [m, rad]")
    return _theory(figure, panels)


def _theory(figure: Figure, panels: Any) -> Figure:
    """Return a figure of numbers of theory with its legend, in panels that noise does not fill."""
    for axes in panels[1:]:
        styles.at_least(axes, _STILL_THEORY)
    artists = [artist for axes in panels[1:] for artist in axes.get_legend_handles_labels()[0]]
    styles.legend_below(figure, panels[0], artists)
    return figure
