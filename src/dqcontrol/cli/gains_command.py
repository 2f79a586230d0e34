"""Gains for a robot's period, delay and lag."""

from __future__ import annotations

from dqcontrol.cli.options import BaseLink, Seconds, TipLink
from dqcontrol.cli.screen import print_table


def gains(
    robot: str,
    /,
    *,
    period: Seconds,
    delay: Seconds = 0.0,
    lag: Seconds = 0.0,
    base_link: BaseLink = None,
    tip_link: TipLink = None,
) -> None:
    """Say which gains a period, a delay and a lag allow each law, what to expect of them, and why.

    Times are in seconds, or with a unit: 8ms.

    Parameters
    ----------
    robot
        Name, .yaml or .urdf file of an arm.
    period
        Control period.
    delay
        From command to joint and back.
    lag
        Time constant with which joints follow their targets.
    """
    from dqcontrol.experiments.gain_advice import advise_gains

    advice = advise_gains(robot, period, delay, lag, base_link=base_link, tip_link=tip_link)
    print_table(advice.table)
    kinds: dict[str, list[str]] = {}
    for kind, parameters in advice.parameters.items():
        written = ", ".join(f"{key}: {value:g}" for key, value in parameters.items())
        kinds.setdefault(written, []).append(kind)
    for written, laws in kinds.items():
        print(f"{written}   # {', '.join(laws)}")
    for line in advice.reasons:
        print(line)
