"""What a disturbance did to the end effector, over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.errors import ShapeError
from dqcontrol.figures.style import DOUBLE, at_least, legend_below, line_style, new_figure, styled
from dqcontrol.loop.record import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
