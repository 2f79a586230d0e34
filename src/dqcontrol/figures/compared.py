"""Figures that lay the poses, joints and inputs of several runs over each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures.pose_panels import pose_panels
from dqcontrol.figures.style import (
    DESIRED,
    DOUBLE,
    LIMIT,
    at_least,
    legend_below,
    line_style,
    new_figure,
    panels_across,
    styled,
)
from dqcontrol.loop.record import Record
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
