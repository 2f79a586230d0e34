"""The Lyapunov function of a run over time, and how near it came to what the robot cannot do."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.figures.style import (
    DOUBLE,
    at_least,
    legend_below,
    line_style,
    logarithmic,
    new_figure,
    styled,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.measures.lyapunov import Certificate

_DECADES = 8  # of V below its peak that are shown, which are four of the error
_FLOOR = 1e-16  # 1/s², where V is 0
_STILL = 1e-6  # the least height of the other panels: a hundredth of what an encoder of 16 bits sees


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
    logarithmic(panels[0], _DECADES)
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
        at_least(axes, _STILL)
    panels[-1].set_xlabel("time [s]")
    artists = [artist for axes in panels[1:] for artist in axes.get_legend_handles_labels()[0]]
    legend_below(figure, panels[0], artists)
    return figure
