"""Gains for a robot's period, delay and lag."""

from __future__ import annotations

import warnings
from typing import Annotated

from cyclopts import Parameter, Token

from dqcontrol.cli.screen import print_table
from dqcontrol.files.units import as_seconds


def _seconds(_type: type, tokens: tuple[Token, ...]) -> float:
    """Return a time with or without unit in seconds."""
    seconds = as_seconds(text := tokens[0].value)
    if seconds is None:
        raise ValueError(f"expected a time as 0.008, 8ms or 8 ms, got '{text}'")
    return seconds


Seconds = Annotated[float, Parameter(converter=_seconds)]


def gains(
    robot: str,
    /,
    *,
    period: Seconds,
    delay: Seconds = 0.0,
    lag: Seconds = 0.0,
    tip_link: str | None = None,
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
    tip_link
        Of a URDF file.
    """
    from dqcontrol.errors import NoteWarning
    from dqcontrol.experiments.gain_advice import advise_gains

    if period >= 1:
        warnings.warn(f"period: {period:g} s; for milliseconds write {period:g}ms", NoteWarning, stacklevel=2)
    advice = advise_gains(robot, period, delay, lag, tip_link=tip_link)
    print_table(advice.table)
    for line in advice.reasons:
        print(line)
