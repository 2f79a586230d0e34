"""Proportional control of the difference of poses."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled import LAW, MemoryLayout, inline, kernel
from dqcontrol.laws import IntegralPoseLaw, LoopRates, parts


class ClassicWork(NamedTuple):
    """Scratch of `ClassicProportional`."""

    preferred: Annotated[Array, "m"]
    rate: Annotated[Array, 8]
    solver: Annotated[Array, parts.integral_work.sized("m")]


classic_work: MemoryLayout[ClassicWork] = MemoryLayout(ClassicWork, "m")


@inline
def classic_twist(pose, sample, gain, hysteresis, sign_kept, rate):
    """Return the hand's twist nearest to K vec8(x_d − x), which is written to ``rate``, the short way round."""
    dot = pose[0] * sample[0] + pose[1] * sample[1] + pose[2] * sample[2] + pose[3] * sample[3]
    sign = parts.short_sign(dot, hysteresis, sign_kept)
    for i in range(8):
        rate[i] = gain[i] * (sign * sample[i] - pose[i])
    return parts.hand_twist_of_rate(rate, pose)


@kernel(LAW)
def classic_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ (K e + k_I ∫ε dt) with e = vec8(x_d − x)."""
    given, own = parts.pose_parameters(parameters), classic_work(work, out.shape[0])
    twist = classic_twist(pose, sample, given.gain, given.hysteresis, state, own.rate)
    return parts.solve_with_integral(
        pose, twist_jacobian, twist, sample, parameters, state, own.preferred, own.solver, out
    )


class ClassicProportional(IntegralPoseLaw, frozen=True, kw_only=True, tag="classic-proportional"):
    """Classic P: q̇ = J⁺ K vec8(x_d − x). [P16 2.20–2.22]

    |x_d − x| never grows and decays at rate k while J has full rank. The error is not invariant: how translation and
    rotation are weighed depends on where the base frame sits, as long as both are corrected; what cannot be done is
    missed by least squares in the hand's twist, as with all laws.
    Prefer `Proportional` unless you compare with the literature.

    Sampling limits: position and orientation have the loop gain k (the largest of K). With ideal joints kT < 2 is
    stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol
    check``.

    Choice: as for `Proportional`.

    Parameters
    ----------
    gain, integral_gain, integral_position_limit, integral_orientation_limit, inverse, null_space
        As of `Proportional`.
    hysteresis
        How far ⟨r, r_d⟩ must pass 0 before the sign of x_d flips.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import ClassicProportional
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target, law = dqc.references.SetPoint(arm.fkm(q + 0.1)), ClassicProportional(gain=3.0)
    >>> record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, period=0.01, duration=3.0)
    >>> bool(record.error[-1] < 1e-3 * record.error[0])
    True
    """

    kernel = classic_proportional
    work = classic_work

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest entry of K, a bound for both: how it is shared depends on the pose."""
        largest = parts.pose_parameters(parameters).gain.max(axis=1)
        return LoopRates(position=largest, orientation=largest, integral=self.integral_gain)
