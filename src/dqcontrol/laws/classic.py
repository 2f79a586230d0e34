"""Proportional control of the difference of poses, and open-loop resolved motion rate control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import multiply
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_work
from dqcontrol.laws.integral import IntegralPoseLaw, integral_work, solve_with_integral
from dqcontrol.laws.inverses import FilteredInverse, Inverse
from dqcontrol.laws.law import LAW, Law
from dqcontrol.laws.loop_rates import LoopRates
from dqcontrol.laws.nearest_twist import nearest_twist
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_law import pose_parameters

if TYPE_CHECKING:
    from dqcontrol.robots import Robot


class ClassicWork(NamedTuple):
    """Scratch of `ClassicProportional`."""

    preferred: Annotated[Array, "m"]
    rate: Annotated[Array, 8]
    solver: Annotated[Array, integral_work.sized("m")]


class OpenLoopWork(NamedTuple):
    """Scratch of `OpenLoop`."""

    preferred: Annotated[Array, "m"]
    rate: Annotated[Array, 8]
    half_twist: Annotated[Array, 8]
    solver: Annotated[Array, twist_work.sized("m")]


classic_work: MemoryLayout[ClassicWork] = MemoryLayout(ClassicWork, "m")
open_loop_work: MemoryLayout[OpenLoopWork] = MemoryLayout(OpenLoopWork, "m")


@inline
def _hand_twist(rate, pose):
    """Return the hand's twist [ω ; ṗ] that moves its pose nearest to a wanted rate."""
    (ax, ay, az), (bx, by, bz), (dx, dy, dz) = nearest_twist(rate, pose)
    px, py, pz = 2.0 * dx, 2.0 * dy, 2.0 * dz
    return ax, ay, az, bx + ay * pz - az * py, by + az * px - ax * pz, bz + ax * py - ay * px  # ṗ = v + ω × p


@inline
def classic_twist(pose, sample, gain, hysteresis, sign_kept, rate):
    """Return the hand's twist nearest to K vec8(x_d − x), which is written to ``rate``, the short way round."""
    dot = pose[0] * sample[0] + pose[1] * sample[1] + pose[2] * sample[2] + pose[3] * sample[3]
    sign = short_sign(dot, hysteresis, sign_kept)
    for i in range(8):
        rate[i] = gain[i] * (sign * sample[i] - pose[i])
    return _hand_twist(rate, pose)


@kernel(LAW)
def classic_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ (K e + k_I ∫ε dt) with e = vec8(x_d − x)."""
    given, own = pose_parameters(parameters), classic_work(work, out.shape[0])
    twist = classic_twist(pose, sample, given.gain, given.hysteresis, state, own.rate)
    return solve_with_integral(
        pose, twist_jacobian, twist, sample, parameters, state, own.preferred, own.solver, out
    )


@kernel(LAW)
def open_loop(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ vec8(ẋ_d), ẋ_d = ½ξ_d x_d; the parameters are the inverse's, the state is the sign of x_d."""
    own = open_loop_work(work, out.shape[0])
    half_twist = own.half_twist
    dot = pose[0] * sample[0] + pose[1] * sample[1] + pose[2] * sample[2] + pose[3] * sample[3]
    sign = short_sign(dot, 0.0, state)
    half_twist[0], half_twist[4] = 0.0, 0.0
    for i in range(3):
        half_twist[1 + i] = 0.5 * sign * sample[8 + i]
        half_twist[5 + i] = 0.5 * sign * sample[11 + i]
    multiply(half_twist, sample, own.rate)
    twist = _hand_twist(own.rate, pose)
    return solve_hand_twist(pose, twist_jacobian, twist, NO_ERROR, own.preferred, parameters, own.solver, out)


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
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target, law = dqc.references.SetPoint(arm.fkm(q + 0.1)), dqc.laws.ClassicProportional(gain=3.0)
    >>> record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, period=0.01, duration=3.0)
    >>> bool(record.error[-1] < 1e-3 * record.error[0])
    True
    """

    kernel = classic_proportional
    work = classic_work

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest entry of K, a bound for both: how it is shared depends on the pose."""
        largest = pose_parameters(parameters).gain.max(axis=1)
        return LoopRates(position=largest, orientation=largest, integral=self.integral_gain)


class OpenLoop(Law, frozen=True, kw_only=True, tag="open-loop"):
    """Resolved motion rate control without feedback: q̇ = J⁺ vec8(ẋ_d). [P16 2.10–2.13]

    The errors of integration, joints and start are never corrected: the hand drifts. For comparison only.

    Sampling limits: none, as there is no loop; the error of integration grows with T.

    Parameters
    ----------
    inverse
        How J is inverted; the default is exact away from singularities.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> twist = arm.twist_jacobian(q) @ np.full(7, 0.1)
    >>> u = dqc.laws.OpenLoop().command(arm, q, dqc.Sample(arm.fkm(q), twist), dt=0.01)
    >>> np.allclose(arm.twist_jacobian(q) @ u, twist)
    True
    """

    kernel = open_loop
    work = open_loop_work
    inverse: Inverse = FilteredInverse()

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return the inverse's parameters."""
        return np.array([self.inverse.parameters()])

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return zeros: no error is corrected."""
        return LoopRates(position=np.zeros(len(parameters)), orientation=np.zeros(len(parameters)))
