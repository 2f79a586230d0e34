"""Proportional control of the invariant pose error with feed-forward of the desired velocity."""

from __future__ import annotations

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, multiply
from dqcontrol.compiled.compile import kernel
from dqcontrol.laws.hand_twist import solve_hand_twist
from dqcontrol.laws.integral import IntegralPoseLaw, add_integral
from dqcontrol.laws.law import LAW, SCRATCH
from dqcontrol.laws.pose_error import left_error, left_error_twist
from dqcontrol.laws.pose_law import GAIN, HYSTERESIS


@kernel(LAW)
def proportional_feedforward(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = N⁺ (K vec8(e) − vec8(x*ẋ_d)) + J⁺ k_I ∫ε dt with ẋ_d = ½ξ_d x_d."""
    n = pose_jacobian.shape[1]
    scratch, rest = work[n : n + SCRATCH], work[n + SCRATCH :]
    error, target, velocity, half_twist = scratch[0:8], scratch[8:16], scratch[16:24], scratch[24:32]
    sign = left_error(pose, sample, parameters[HYSTERESIS], state, error)
    half_twist[0], half_twist[4] = 0.0, 0.0
    for i in range(3):
        half_twist[1 + i] = 0.5 * sign * sample[8 + i]
        half_twist[5 + i] = 0.5 * sign * sample[11 + i]
    multiply(half_twist, sample, velocity)
    conjugate_multiply(pose, velocity, target)
    for i in range(8):
        target[i] = parameters[GAIN + i] * error[i] - target[i]
    twist = left_error_twist(target, error, pose)
    twist = add_integral(twist, pose, sample, parameters, state, scratch[16:32])
    return solve_hand_twist(pose, twist_jacobian, twist, work[0:n], parameters, rest, out)


class ProportionalFeedforward(IntegralPoseLaw, frozen=True, kw_only=True, tag="proportional-feedforward"):
    """K+FF: q̇ = N⁺ (K vec8(1 − x*x_d) − vec8(x*ẋ_d)). [P16 3.12]

    Like `Proportional`, with the desired velocity added, so that ė = −Ke (projected) also for a moving target: ideal
    joints follow without lag up to the period.

    Sampling limits: position and orientation have the loop gain k (the largest of K). With ideal joints kT < 2 is
    stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol
    check``. The feed-forward changes none of them.

    Choice: k as for `Proportional`, but only to correct errors: the motion itself is fed forward.

    Parameters
    ----------
    gain, integral_gain, integral_position_limit, integral_orientation_limit, inverse, hysteresis, null_space
        As of `Proportional`.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> twist = arm.twist_jacobian(q) @ np.full(7, 0.1)
    >>> u = dqc.laws.ProportionalFeedforward(gain=3.0).command(arm, q, dqc.Sample(arm.fkm(q), twist), dt=0.001)
    >>> np.allclose(arm.twist_jacobian(q) @ u, twist)
    True
    """

    kernel = proportional_feedforward
