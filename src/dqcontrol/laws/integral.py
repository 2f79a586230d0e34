"""The integral of the error, with anti-windup: an option of the proportional laws of the whole pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, rotated, translation
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import pose_error
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_work
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.laws.law import LoopRates, beside
from dqcontrol.laws.pose_law import PoseLaw
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class IntegralParameters(NamedTuple):
    """What compiled code knows of an `IntegralPoseLaw`.

    Attributes
    ----------
    inverse, hysteresis, gain
        Those of `PoseParameters`, in the same order: what is of the integral stands behind them.
    step, back
        k_I T and T/T_t.
    bounds
        On the integral's part of ω and of ṗ.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]
    step: float
    back: float
    bounds: Annotated[Array, 2]


class IntegralState(NamedTuple):
    """What an `IntegralPoseLaw` keeps; without an integral only the sign of x_d.

    Attributes
    ----------
    total
        The integral, in the end effector's axes.
    asked, delivered
        Twists of the end effector: what the law asked for, and what left.
    """

    sign: Annotated[Array, 1]
    total: Annotated[Array, 6]
    asked: Annotated[Array, 6]
    delivered: Annotated[Array, 6]


class IntegralWork(NamedTuple):
    """Scratch of `solve_with_integral` for n inputs."""

    relative: Annotated[Array, 8]
    error: Annotated[Array, 6]
    solver: Annotated[Array, twist_work.sized("n")]


integral_parameters: MemoryLayout[IntegralParameters] = MemoryLayout(IntegralParameters)
integral_state: MemoryLayout[IntegralState] = MemoryLayout(IntegralState)
integral_work: MemoryLayout[IntegralWork] = MemoryLayout(IntegralWork, "n")


@inline
def solve_with_integral(pose, twist_jacobian, twist, sample, parameters, state, preferred, work, out):
    """Write out = z + J⁺ (t + k_I ∫ε dt − J z), t the end effector's twist [ω ; ṗ] that K e asks for."""
    given, kept = integral_parameters(parameters), integral_state(state)
    own = integral_work(work, twist_jacobian.shape[1])
    if given.step != 0.0:
        twist = _add_integral(twist, pose, sample, given, kept, own)
    error = pose_error(pose, sample)
    return solve_hand_twist(pose, twist_jacobian, twist, error, preferred, given.inverse, own.solver, out)


@inline
def _add_integral(twist, pose, sample, given, kept, own):
    """Return the end effector's twist [ω ; ṗ] with k_I ∫ε dt added, ε = [2 Im r ; p] of short(x*x_d), in its axes.

    Where less left than was asked for in the last sample, the integral gives up its part of the difference at the rate
    1/T_t; it is never driven through 0 by that, so it does not work against K e.
    """
    total, asked, left = kept.total, kept.asked, kept.delivered
    conjugate_multiply(pose, sample, own.relative)
    for i in range(8):
        own.relative[i] *= kept.sign[0]
    for i in range(3):
        own.error[i] = 2.0 * own.relative[1 + i]
    translation(own.relative, own.error[3:6])
    inward = pose[0], -pose[1], -pose[2], -pose[3]
    for half in range(2):
        x, y, z = 3 * half, 3 * half + 1, 3 * half + 2
        a, b, c = rotated(inward, (asked[x] - left[x], asked[y] - left[y], asked[z] - left[z]))
        bound = given.bounds[half]
        total[x] = _summed(total[x] + given.step * own.error[x], given.back * a, bound)
        total[y] = _summed(total[y] + given.step * own.error[y], given.back * b, bound)
        total[z] = _summed(total[z] + given.step * own.error[z], given.back * c, bound)
    a, b, c = rotated(pose, (total[0], total[1], total[2]))
    u, v, w = rotated(pose, (total[3], total[4], total[5]))
    a, b, c = a + twist[0], b + twist[1], c + twist[2]
    u, v, w = u + twist[3], v + twist[4], w + twist[5]
    asked[0], asked[1], asked[2] = a, b, c
    asked[3], asked[4], asked[5] = u, v, w
    return a, b, c, u, v, w


@inline
def _summed(value, excess, bound):
    """Return one number of the integral: less the excess, but not through 0, and within its bound."""
    if value * excess > 0.0:
        value = max(value - excess, 0.0) if value > 0.0 else min(value - excess, 0.0)
    return min(max(value, -bound), bound)


class IntegralPoseLaw(PoseLaw, frozen=True, kw_only=True):
    """A law that adds k_I ∫ε dt to the twist that it asks for, ε ≈ [θn ; p_d − p] in the end effector's axes.

    Without it (``integral_gain`` 0) the command is that of K e alone. Where limits, clamped joints or a supervisor let
    less leave than was asked for, the integral is calculated back from what left, with the tracking time 1/√k_I; what
    it holds otherwise it keeps until the error changes sign. Its part of the end effector's speed is bounded, too.
    """

    gain_powers: ClassVar[Mapping[str, float]] = {"gain": 1, "integral_gain": 2}
    integral_gain: Annotated[float, Meta(ge=0, le=1e6, description="k_I, 1/s²")] = 0.0
    integral_position_limit: Annotated[
        float,
        Meta(
            gt=0,
            le=1e6,
            description="largest speed that k_I ∫ε dt asks of the end effector along each axis, m/s",
        ),
    ] = 2.0
    integral_orientation_limit: Annotated[
        float, Meta(gt=0, le=1e6, description="the same about each axis, rad/s")
    ] = 2.0

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return inverse, hysteresis, gains, k_I T, T/T_t and bounds, one row a sample as long as they change."""
        gain, back = self.integral_gain, min(math.sqrt(self.integral_gain) * period, 1.0)
        bounds = self.integral_orientation_limit, self.integral_position_limit
        return beside(super().rows(robot, reference, period), [gain * period, back, *bounds])

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign of x_d, the integral, and what was asked for and what left."""
        return integral_state.size() if self.integral_gain else 1

    @property
    def delivered_at(self) -> int:
        """Where the state takes the end effector's twist that left; 0 without an integral."""
        return integral_state.place("delivered") if self.integral_gain else 0

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries, and k_I."""
        rates = super().loop_rates(parameters)
        return LoopRates(rates.position, rates.orientation, self.integral_gain)
