"""Gains that a robot's period, delay and lag allow each law, and what is to be expected of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.experiments.check import check
from dqcontrol.measures.stability import GainLimits, gain_limits, with_lag
from dqcontrol.plants import Servo
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.robots import load_robot, most_dexterous
from dqcontrol.tables.tables import Cell, Column, Table

_SPEED = 0.1  # m/s of a target that moves
_HORIZON = 20.0  # time constants that a linear quadratic law looks ahead


@dataclass(frozen=True)
class GainAdvice:
    """Gains for each law, and why they are what they are.

    Attributes
    ----------
    table
        One row a law: overshoot and time constant, and how far the end effector lags behind a target that moves at 0.1
        m/s.
    parameters
        Of each law, as a spec has them.
    reasons
        In a line each.
    """

    table: Table
    parameters: dict[str, dict[str, float]]
    reasons: tuple[str, ...]


def advise_gains(
    robot: str | Path,
    period: float,
    delay: float = 0.0,
    lag: float = 0.0,
    *,
    base_link: str | None = None,
    tip_link: str | None = None,
) -> GainAdvice:
    """Return the largest gains that are good: damping ratio 0.7 or more, and twice as much is stable.

    Parameters
    ----------
    robot
        As for `load_robot`; an arm.
    period
        T, s.
    delay
        From command to joint and back, s; any.
    lag
        τ of the joints' first-order lag, s; 0 for none.
    base_link, tip_link
        Of a URDF file.

    Raises
    ------
    Error
        If the robot is unknown or has a mobile base, or a number is out of range.

    Examples
    --------
    >>> from dqcontrol.experiments.gain_advice import advise_gains
    >>> advice = advise_gains("iiwa7", period=0.008, delay=0.030, lag=0.050)
    >>> advice.parameters["h-infinity"]
    {'translation_gain': 6.3, 'orientation_gain': 12.6}
    """
    period = as_positive("period", period)
    plant = Servo(
        delay=as_positive("delay", delay, zero_allowed=True),
        time_constant=as_positive("lag", lag, zero_allowed=True),
    )
    arm = load_robot(robot, base_link, tip_link)
    model = plant.linear_model(arm, most_dexterous(arm), period)
    if model is None:
        raise ValueRangeError(
            f"robot: {arm.name} has a mobile base, of which no linear model is known; give an arm"
        )
    limits = gain_limits(model, period)
    gain = rounded_down(limits.recommended / period, 2)
    parameters = law_parameters(gain, rounded_down(_stiffest(model, period), 2))
    laws = {kind: {"kind": kind, **each} for kind, each in parameters.items()}
    checks = check(
        {
            "name": "gains",
            "robot": {"source": str(robot), "base_link": base_link, "tip_link": tip_link},
            "start": most_dexterous(arm).tolist(),
            "period": period,
            "reference": {"kind": "set-point", "duration": _HORIZON / gain},  # long: its end is no part of it
            "laws": laws,
            "plant": {"kind": "servo", "delay": plant.delay, "time_constant": plant.time_constant},
        }
    )
    rows: list[list[tuple[Column, Cell]]] = []
    for row, kind in zip(checks, laws, strict=True):
        slowest = min(abs(loop.gain.value) for loop in row.loops)
        behind = 1e3 * _SPEED / slowest if kind in _LAGGING else 0.0
        percent = 100 * row.overshoot
        rows.append(
            [
                (Column("law"), kind),
                (Column("overshoot", "%", ".2g"), percent if percent > 0.05 else 0.0),
                (Column("time constant", "s", ".3g"), row.time_constant),
                (Column(f"lag at {_SPEED:g} m/s", "mm", ".3g"), behind),
            ]
        )
    title = f"{arm.name}: T = {1e3 * period:.4g} ms, delay {1e3 * delay:.4g} ms, lag {1e3 * lag:.4g} ms"
    return GainAdvice(Table.of(rows, title), parameters, tuple(_reasons(limits, period, delay, lag, gain)))


_LAGGING = ("proportional", "decoupled-proportional", "h-infinity")  # without feed-forward


def law_parameters(gain: float, slow: float) -> dict[str, dict[str, float]]:
    """Return laws whose loops have a gain; that of accelerations has one of its own, behind its lag 1/k_v = 1/(4 k)."""
    proportional = {"gain": gain}
    both = {"translation_gain": gain, "orientation_gain": _four_digits(2 * gain)}
    squared = {"error_weight": _four_digits(gain**2), "control_weight": 1.0}
    return {
        "proportional": proportional,
        "proportional-feedforward": proportional,
        "decoupled-proportional": proportional,
        "h-infinity": both,
        "h-infinity-tracking": both,
        "linear-quadratic-r8": squared,
        "linear-quadratic-dq": squared,
        "feedback-linearization": {
            "stiffness": _four_digits(16 * slow**2),
            "damping": _four_digits(4 * slow),
        },
    }


def _stiffest(model: LinearModel, period: float) -> float:
    """Return the largest k that is good behind a lag of 1/(4 k), critically damped by itself."""
    low, high = 0.0, 0.4 / period  # k_v T < 2 leaves room
    for _ in range(30):
        middle = (low + high) / 2
        good = gain_limits(with_lag(model, 4 * middle, period), period).recommended / period >= middle
        low, high = (middle, high) if good else (low, middle)
    return low


def _reasons(limits: GainLimits, period: float, delay: float, lag: float, gain: float) -> list[str]:
    stable = limits.stable / period
    half = limits.recommended >= limits.stable / 2 * (1 - 1e-9)
    why = "twice as much is the limit" if half else "beyond it the damping ratio falls below 0.7"
    late = f"delay and lag of {1e3 * (delay + lag):.3g} ms decide, not the period: shorten them first"
    return [
        f"k = {gain:.3g} 1/s: {why}; unstable from k = {stable:.3g} 1/s on",
        *([late] if delay + lag > 4 * period else []),
        "a target that moves: take a law with feed-forward rather than more gain; a constant push of v leaves v/k, "
        "which an integral_gain up to k²/4 removes",
    ]


def _four_digits(value: float) -> float:
    return float(f"{value:.4g}")


def rounded_down(value: float, digits: int) -> float:
    """Return so many digits of a number ≥ 0, not more than it is."""
    place = 10.0 ** (math.floor(math.log10(value)) + 1 - digits) if value > 0 else 1.0
    return float(f"{math.floor(value / place + 1e-9) * place:.6g}")
