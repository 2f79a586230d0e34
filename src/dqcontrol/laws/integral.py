"""The integral of the error, within a bound: an option of the proportional laws of the whole pose."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.compiled.compile import inlined
from dqcontrol.errors import as_positive
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.laws.pose_law import GAIN, PoseLaw
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

INTEGRAL = GAIN + 8  # parameters: k_I T, bound
_SIGN, _SUM = 1, 2  # state, behind the sign of x_d: that which the integral belongs to, and the integral (8)


@inlined
def add_integral(error, first, last, parameters, state, target):
    """Add k_I ∫e dt to some of the rates asked for, each number clamped; it starts anew where the sign of x_d flips."""
    step, bound = parameters[INTEGRAL], parameters[INTEGRAL + 1]
    if step == 0.0:
        return
    if state[_SIGN] != state[0]:
        state[_SIGN] = state[0]
        for i in range(8):
            state[_SUM + i] = 0.0
    for i in range(first, last):
        state[_SUM + i] = min(max(state[_SUM + i] + step * error[i], -bound), bound)
        target[i] += state[_SUM + i]


class IntegralPoseLaw(PoseLaw, frozen=True, kw_only=True):
    """A law that adds k_I ∫e dt to the rates K e that it asks for, each of its numbers within ± `integral_limit`.

    Without it (``integral_gain`` 0) the command is K e alone. Nothing leaks: what the integral holds it keeps until the
    error changes sign, and the bound is what ends a windup.
    """

    integral_gain: Annotated[float, Meta(ge=0, le=1e6, description="k_I, 1/s²")] = 0.0
    integral_limit: Annotated[
        float,
        Meta(gt=0, le=1e6, description="largest part of each rate of the error that k_I ∫e dt makes, 1/s"),
    ] = 1.0

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return inverse, hysteresis, gains, k_I T and its bound, one row a sample as long as they change."""
        rows = super().rows(robot, reference, dt)
        gain = as_positive("integral_gain", self.integral_gain, zero_allowed=True)
        own = gain * dt, as_positive("integral_limit", self.integral_limit)
        return np.hstack([rows, np.tile(own, (len(rows), 1))])

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign of x_d and the integral."""
        return _SUM + 8 if self.integral_gain else 1

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries, and k_I."""
        return replace(super().loop_rates(parameters), integral=self.integral_gain)
