"""Identified servos: what joints did beside what their model says, and what is left."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.figures.style import COLOURS, DESIRED, DOUBLE, legend_below, new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.logs.servos.joint_gates import JointTrace

_WINDOW = 2.5  # s that are shown closely
_MOST = 4000  # points of a curve of residuals


@styled
def servo_fits(joints: Mapping[str, tuple[JointTrace, float]]) -> Figure:
    """Plot for each joint fit and residual: left where it is liveliest, right all along beside the floor.

    Parameters
    ----------
    joints
        By name: what was identified of it, and what noise and encoder alone would leave, rad or m.

    Examples
    --------
    >>> servo_fits({joint.name: (joint.trace, joint.floor) for joint in found.fitted})  # doctest: +SKIP
    """
    figure = new_figure(DOUBLE, 0.6 + 1.25 * len(joints))
    grid = figure.subplots(len(joints), 2, squeeze=False)
    for (name, (trace, floor)), (close, all_along) in zip(joints.items(), grid, strict=True):
        shown = _liveliest(trace)
        time = trace.time[shown]
        close.plot(time, trace.target[shown], color=DESIRED, lw=0.8, label="commanded")
        close.plot(time, trace.position[shown], color=COLOURS[0], lw=1.4, label="measured")
        close.plot(time, trace.fitted[shown], color=COLOURS[1], lw=0.8, ls="--", label="fitted")
        close.set_title(name, loc="left")
        step = max(1, len(trace.time) // _MOST)
        thin = slice(None, None, step)
        left = 1e3 * (trace.position - trace.fitted)
        late = np.isfinite(trace.foreseen)
        ahead = np.where(late, 1e3 * (trace.position - trace.foreseen), np.nan)
        all_along.plot(trace.time[thin], left[thin], color=COLOURS[0], lw=0.4, label="left by the fit")
        all_along.plot(trace.time[thin], ahead[thin], color=COLOURS[1], lw=0.4, label="left where not fitted")
        for side in (-2e3, 2e3):
            all_along.axhline(side * floor, color=DESIRED, lw=0.8, ls="--")
        all_along.set_ylabel("left [mrad]")
        close.set_ylabel("[rad]")
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    legend_below(figure, grid[0][0], grid[0][1].get_legend_handles_labels()[0])
    return figure


def _liveliest(trace: JointTrace) -> slice:
    """Return the samples of the part of a log in which a joint's target moved most."""
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(trace.target)))])
    last = np.searchsorted(trace.time, trace.time + _WINDOW, side="right") - 1
    first = int(np.argmax(path[last] - path))
    return slice(first, int(last[first]) + 1)
