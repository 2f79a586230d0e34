"""The integral of the error, with anti-windup: an option of the proportional laws of the whole pose."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, rotated, translation
from dqcontrol.compiled.compile import inline
from dqcontrol.errors import as_positive
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.laws.pose_law import GAIN, PoseLaw
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

INTEGRAL = GAIN + 8  # parameters: k_I T, T/T_t, bounds on ω and ṗ
# State, behind the sign of x_d: the integral in the hand's axes, what was asked of the hand, and what left for it.
_SUM, _ASKED, DELIVERED, _END = 1, 7, 13, 19


@inline
def add_integral(twist, pose, sample, parameters, state, scratch):
    """Return the hand's twist [ω ; ṗ] with k_I ∫ε dt added, ε = [2 Im r ; p] of short(x*x_d), in the hand's axes.

    Where less left than was asked for in the last sample, the integral gives up its part of the difference at the rate
    1/T_t; it is never driven through 0 by that, so it does not work against K e.
    """
    step, back = parameters[INTEGRAL], parameters[INTEGRAL + 1]
    if step == 0.0:
        return twist
    relative, error = scratch[0:8], scratch[8:14]
    conjugate_multiply(pose, sample, relative)
    for i in range(8):
        relative[i] *= state[0]
    for i in range(3):
        error[i] = 2.0 * relative[1 + i]
    translation(relative, error[3:6])
    inward = pose[0], -pose[1], -pose[2], -pose[3]
    for half in range(2):
        first = 3 * half
        asked, left, total = _ASKED + first, DELIVERED + first, _SUM + first
        a, b, c = rotated(
            inward,
            (
                state[asked] - state[left],
                state[asked + 1] - state[left + 1],
                state[asked + 2] - state[left + 2],
            ),
        )
        bound = parameters[INTEGRAL + 2 + half]
        state[total] = _summed(state[total] + step * error[first], back * a, bound)
        state[total + 1] = _summed(state[total + 1] + step * error[first + 1], back * b, bound)
        state[total + 2] = _summed(state[total + 2] + step * error[first + 2], back * c, bound)
    a, b, c = rotated(pose, (state[_SUM], state[_SUM + 1], state[_SUM + 2]))
    u, v, w = rotated(pose, (state[_SUM + 3], state[_SUM + 4], state[_SUM + 5]))
    a, b, c = a + twist[0], b + twist[1], c + twist[2]
    u, v, w = u + twist[3], v + twist[4], w + twist[5]
    state[_ASKED], state[_ASKED + 1], state[_ASKED + 2] = a, b, c
    state[_ASKED + 3], state[_ASKED + 4], state[_ASKED + 5] = u, v, w
    return a, b, c, u, v, w


@inline
def _summed(value, excess, bound):
    """Return one number of the integral: less the excess, but not through 0, and within its bound."""
    if value * excess > 0.0:
        value = max(value - excess, 0.0) if value > 0.0 else min(value - excess, 0.0)
    return min(max(value, -bound), bound)


class IntegralPoseLaw(PoseLaw, frozen=True, kw_only=True):
    """A law that adds k_I ∫ε dt to the twist that it asks of the hand, ε ≈ [θn ; p_d − p] in the hand's axes.

    Without it (``integral_gain`` 0) the command is that of K e alone. Where limits, clamped joints or a supervisor let
    less leave than was asked for, the integral is calculated back from what left, with the tracking time 1/√k_I; what
    it holds otherwise it keeps until the error changes sign. Its part of the hand's speed is bounded, too.
    """

    integral_gain: Annotated[float, Meta(ge=0, le=1e6, description="k_I, 1/s²")] = 0.0
    integral_position_limit: Annotated[
        float,
        Meta(gt=0, le=1e6, description="largest speed that k_I ∫ε dt asks of the hand along each axis, m/s"),
    ] = 2.0
    integral_orientation_limit: Annotated[
        float, Meta(gt=0, le=1e6, description="the same about each axis, rad/s")
    ] = 2.0
    integral_limit: Annotated[
        float | None,
        Meta(description="1/s; old: integral_position_limit and integral_orientation_limit are twice this"),
    ] = None

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return inverse, hysteresis, gains, k_I T, T/T_t and bounds, one row a sample as long as they change."""
        rows = super().rows(robot, reference, dt)
        gain = as_positive("integral_gain", self.integral_gain, zero_allowed=True)
        position = as_positive("integral_position_limit", self.integral_position_limit)
        orientation = as_positive("integral_orientation_limit", self.integral_orientation_limit)
        if self.integral_limit is not None:
            warnings.warn(
                "integral_limit is replaced by integral_position_limit (m/s) and integral_orientation_limit (rad/s), "
                "twice its number, and ends with the next release",
                FutureWarning,
                stacklevel=3,
            )
            position = orientation = 2.0 * as_positive("integral_limit", self.integral_limit)
        own = gain * dt, min(math.sqrt(gain) * dt, 1.0), orientation, position
        return np.hstack([rows, np.tile(own, (len(rows), 1))])

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign of x_d, the integral, and what was asked for and what left."""
        return _END if self.integral_gain else 1

    @property
    def delivered_at(self) -> int:
        """Where the state takes the hand's twist that left; 0 without an integral."""
        return DELIVERED if self.integral_gain else 0

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries, and k_I."""
        return replace(super().loop_rates(parameters), integral=self.integral_gain)
