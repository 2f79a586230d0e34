"""Proportional control of the invariant pose error with feed-forward of the desired velocity."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, multiply
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.desired_twist import Feedforward, FeedforwardLaw, desired_twist
from dqcontrol.laws.integral import (
    IntegralPoseLaw,
    integral_parameters,
    integral_state,
    integral_work,
    solve_with_integral,
)
from dqcontrol.laws.law import LAW
from dqcontrol.laws.pose_error import left_error, left_error_twist
from dqcontrol.laws.pose_law import pose_parameters


class FeedforwardParameters(NamedTuple):
    """What compiled code knows of the law."""

    integral: Annotated[Array, integral_parameters.size()]
    second_order: Annotated[Array, ...]


class FeedforwardState(NamedTuple):
    """What it keeps: the last command that left only for feed-forward of second order."""

    integral: Annotated[Array, integral_state.size()]
    last: Annotated[Array, "m"]


class FeedforwardWork(NamedTuple):
    """Scratch of the law."""

    preferred: Annotated[Array, "m"]
    error: Annotated[Array, 8]
    target: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    velocity: Annotated[Array, 8]
    half_twist: Annotated[Array, 8]
    solver: Annotated[Array, integral_work.sized("m")]


feedforward_parameters: MemoryLayout[FeedforwardParameters] = MemoryLayout(FeedforwardParameters)
feedforward_state: MemoryLayout[FeedforwardState] = MemoryLayout(FeedforwardState, "m", unchecked=True)
feedforward_work: MemoryLayout[FeedforwardWork] = MemoryLayout(FeedforwardWork, "m")


@kernel(LAW)
def proportional_feedforward(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = N⁺ (K vec8(e) − vec8(x*ẋ_d)) + J⁺ k_I ∫ε dt with ẋ_d = ½t x_d, t = ξ_d to second order."""
    m = out.shape[0]
    given, own = pose_parameters(parameters), feedforward_work(work, m)
    error, target, half_twist = own.error, own.target, own.half_twist
    sign = left_error(pose, sample, given.hysteresis, state, error)
    numbers, last = feedforward_parameters(parameters).second_order, feedforward_state(state, m).last
    desired_twist(sample, pose, twist_jacobian, numbers, last, own.twist)
    half_twist[0], half_twist[4] = 0.0, 0.0
    for i in range(3):
        half_twist[1 + i] = 0.5 * sign * own.twist[i]
        half_twist[5 + i] = 0.5 * sign * own.twist[3 + i]
    multiply(half_twist, sample, own.velocity)
    conjugate_multiply(pose, own.velocity, target)
    for i in range(8):
        target[i] = given.gain[i] * error[i] - target[i]
    twist = left_error_twist(target, error, pose, pose_parameters(parameters).inverse)
    return solve_with_integral(
        pose, twist_jacobian, twist, sample, parameters, state, own.preferred, own.solver, out
    )


class ProportionalFeedforward(
    FeedforwardLaw, IntegralPoseLaw, frozen=True, kw_only=True, tag="proportional-feedforward"
):
    """K+FF: q̇ = N⁺ (K vec8(1 − x*x_d) − vec8(x*ẋ_d)). [P16 3.12]

    Like `Proportional`, with the desired velocity added, so that ė = −Ke (projected) also for a moving target. A
    command is held for a period, so ẋ_d = ½tx_d has t = ξ_d + h (ξ̇_d − J̇(u⁻)u⁻) in place of ξ_d, h = T/2 and what
    joints are late, u⁻ the last command that left: the error falls with T².

    Sampling limits: position and orientation have the loop gain k (the largest of K). With ideal joints kT < 2 is
    stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol
    check``. The feed-forward changes none of them.

    Choice: k as for `Proportional`, but only to correct errors: the motion itself is fed forward.

    Parameters
    ----------
    gain, integral_gain, integral_position_limit, integral_orientation_limit, inverse, hysteresis, null_space
        As of `Proportional`.
    feedforward
        ``"second-order"``, or ``"printed"``: ξ_d as it is, with an error that falls with T.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> twist = arm.twist_jacobian(q) @ np.full(7, 0.1)
    >>> u = dqc.laws.ProportionalFeedforward(gain=3.0).command(arm, q, dqc.Sample(arm.fkm(q), twist), period=0.001)
    >>> np.allclose(arm.twist_jacobian(q) @ u, twist)
    True
    """

    kernel = proportional_feedforward
    work = feedforward_work
    parameters_before = integral_parameters.size()
    state_before = integral_state.size()
    feedforward: Feedforward = "second-order"
