"""Proportional control of the invariant pose error."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.integral import IntegralPoseLaw, integral_work, solve_with_integral
from dqcontrol.laws.law import LAW
from dqcontrol.laws.pose_error import left_error, left_error_twist
from dqcontrol.laws.pose_law import pose_parameters


class ProportionalWork(NamedTuple):
    """Scratch of the law."""

    preferred: Annotated[Array, "m"]
    error: Annotated[Array, 8]
    target: Annotated[Array, 8]
    solver: Annotated[Array, integral_work.sized("m")]


proportional_work: MemoryLayout[ProportionalWork] = MemoryLayout(ProportionalWork, "m")


@kernel(LAW)
def proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = N⁺ K vec8(e) + J⁺ k_I ∫ε dt."""
    given, own = pose_parameters(parameters), proportional_work(work, out.shape[0])
    left_error(pose, sample, given.hysteresis, state, own.error)
    for i in range(8):
        own.target[i] = given.gain[i] * own.error[i]
    twist = left_error_twist(own.target, own.error, pose, given.inverse)
    return solve_with_integral(
        pose, twist_jacobian, twist, sample, parameters, state, own.preferred, own.solver, out
    )


class Proportional(IntegralPoseLaw, frozen=True, kw_only=True, tag="proportional"):
    """K: q̇ = N⁺ K vec8(1 − x*x_d). [P16 3.8]

    The error norm decreases monotonically towards a resting target from everywhere but its antipode. Because e is
    projected on what a unit dual quaternion can do, ė = −Ke holds only nearly: a pure translation error decays at rate
    k exactly, a pure rotation θ as tan(θ/4) ∝ exp(−kt). A moving target is followed with a lag of about |ẋ_d|/k.

    Sampling limits: position and orientation have the loop gain k (the largest of K). With ideal joints kT < 2 is
    stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol
    check``.

    Choice: k is the reciprocal of the wanted time constant, as far as the limits allow. A moving target asks for k
    ≥ |ẋ_d| / (error allowed), or for `ProportionalFeedforward`.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, eight diagonal entries, or a `Schedule` of k.
    integral_gain, integral_position_limit, integral_orientation_limit
        k_I in 1/s²: adds k_I ∫ε dt to the end effector's twist, within ± the limits in m/s and rad/s along each of its
        axes; see ``IntegralPoseLaw``. 0 for none.
    inverse
        How J is inverted; the default is exact away from singularities.
    hysteresis
        x_d and −x_d are the same pose; the sign is changed only when Re(x*x_d) has passed 0 by this much.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.Proportional(gain=3.0)
    >>> float(np.abs(law.command(arm, q, dqc.Sample(arm.fkm(q)), period=0.001)).max()) < 1e-12
    True
    """

    kernel = proportional
    work = proportional_work
