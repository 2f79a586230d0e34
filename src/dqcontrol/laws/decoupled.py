"""Proportional control of position and orientation apart from each other, and of only a part of the pose."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec import Meta
from msgspec.structs import replace

from dqcontrol.algebra.dual_quaternion_kernels import quaternion_product, rotate, translation
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.laws.growth import NO_ERROR, counted, pose_error
from dqcontrol.laws.integral import IntegralPoseLaw, integral_work, solve_with_integral
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters, solve, solver_work
from dqcontrol.laws.law import LAW, Law, LoopRates
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_law import Gain, Schedule, gain_rows, pose_parameters

if TYPE_CHECKING:
    from dqcontrol.references import Reference
    from dqcontrol.robots import Robot


class RotationWork(NamedTuple):
    """Scratch of the error of orientation: r_e, 1 − r_e, and the angular velocity that reduces it."""

    relative: Annotated[Array, 4]
    error: Annotated[Array, 4]
    product: Annotated[Array, 4]
    omega: Annotated[Array, 3]


rotation_work: MemoryLayout[RotationWork] = MemoryLayout(RotationWork, unchecked=True)


class DecoupledWork(NamedTuple):
    """Scratch of `DecoupledProportional`."""

    preferred: Annotated[Array, "m"]
    rotation: Annotated[Array, rotation_work.size()]
    here: Annotated[Array, 3]
    there: Annotated[Array, 3]
    solver: Annotated[Array, integral_work.sized("m")]


class PartialParameters(NamedTuple):
    """What compiled code knows of `PartialProportional`.

    Attributes
    ----------
    axis, spare
        That of the end effector, and one across it, about which half a turn goes.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    gain: float
    axis: Annotated[Array, 3]
    spare: Annotated[Array, 3]


class PartialWork(NamedTuple):
    """Scratch of `PartialProportional`: what the part is and is to be, its error, and its Jacobian."""

    preferred: Annotated[Array, "m"]
    here: Annotated[Array, 3]
    there: Annotated[Array, 3]
    spare: Annotated[Array, 3]
    rotation: Annotated[Array, rotation_work.size()]
    target: Annotated[Array, 3]
    matrix: Annotated[Array, 3, "m"]
    solver: Annotated[Array, solver_work.size()]


decoupled_work: MemoryLayout[DecoupledWork] = MemoryLayout(DecoupledWork, "m")
partial_parameters: MemoryLayout[PartialParameters] = MemoryLayout(PartialParameters, unchecked=True)
partial_work: MemoryLayout[PartialWork] = MemoryLayout(PartialWork, "m", unchecked=True)


@inline
def _velocity_rows(position, twist_jacobian, out):
    """Write J_p with ṗ = J_p u into three rows."""
    px, py, pz = position[0], position[1], position[2]
    for c in range(twist_jacobian.shape[1]):
        x, y, z = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        out[0, c] = twist_jacobian[3, c] - (py * z - pz * y)
        out[1, c] = twist_jacobian[4, c] - (pz * x - px * z)
        out[2, c] = twist_jacobian[5, c] - (px * y - py * x)


@inline
def _rotation_error(pose, desired, hysteresis, sign, rotation):
    """Write r_e = short(r*r_d) and 1 − r_e."""
    relative, error = rotation.relative, rotation.error
    quaternion_product((pose[0], -pose[1], -pose[2], -pose[3]), desired[0:4], relative)
    given = short_sign(relative[0], hysteresis, sign)
    for i in range(4):
        relative[i] *= given
        error[i] = -relative[i]
    error[0] += 1.0


@inline
def _angular_velocity(pose, rotation):
    """Write the ω that solves −½ω_b r_e = −e nearest: ω_b = Im(−2 e r_e*), turned to inertial axes."""
    relative, product = rotation.relative, rotation.product
    quaternion_product(rotation.error, (relative[0], -relative[1], -relative[2], -relative[3]), product)
    rotate(pose, (-2.0 * product[1], -2.0 * product[2], -2.0 * product[3]), rotation.omega)


@kernel(LAW)
def decoupled_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = N_d⁺ K e + J⁺ k_I ∫ε dt with e = [p_d − p ; vec4(1 − r*r_d)]."""
    given, own = pose_parameters(parameters), decoupled_work(work, out.shape[0])
    here, there, rotation = own.here, own.there, rotation_work(own.rotation)
    _rotation_error(pose, sample, given.hysteresis, state, rotation)
    for i in range(4):
        rotation.error[i] *= given.gain[4 + i]
    _angular_velocity(pose, rotation)
    omega = rotation.omega
    translation(pose, here)
    translation(sample, there)
    for i in range(3):
        there[i] = given.gain[1 + i] * (there[i] - here[i])
    twist = omega[0], omega[1], omega[2], there[0], there[1], there[2]
    return solve_with_integral(
        pose, twist_jacobian, twist, sample, parameters, state, own.preferred, own.solver, out
    )


class DecoupledProportional(IntegralPoseLaw, frozen=True, kw_only=True, tag="decoupled-proportional"):
    """Decoupled P: q̇ = N_d⁺ K [p_d − p ; 1 − r*r_d], N_d = [J_p ; H⁻(r_d) C4 J_r]. [P16 3.1.1]

    Position and orientation converge independently: with ideal joints the end effector moves on a straight line to a
    resting target. Both decay at rate k (orientation as tan(θ/4)).

    Sampling limits: position and orientation have the loop gain k (the largest of their entries of K). With ideal
    joints kT < 2 is stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and
    physics ask ``dqcontrol check``.

    Choice: as for `Proportional`; position and orientation may have rates of their own.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, or eight diagonal entries (the first is not used, three for the position, four
        for the orientation), or a `Schedule` of k.
    integral_gain, integral_position_limit, integral_orientation_limit, inverse, null_space
        As of `Proportional`.
    hysteresis
        How far Re(r*r_d) must pass 0 before the sign of r_d flips.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.DecoupledProportional(gain=[1, 4, 4, 4, 2, 2, 2, 2])
    >>> here, there = arm.fkm(q), arm.fkm(q + 0.02)
    >>> u = law.command(arm, q, dqc.Sample(there), period=0.01)
    >>> way = dqc.algebra.translation(there) - dqc.algebra.translation(here)
    >>> np.allclose(arm.translation_jacobian(q) @ u, 4 * way)
    True
    """

    kernel = decoupled_proportional
    work = decoupled_work

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries for p_d − p and for Im(r*r_d)."""
        gains = pose_parameters(parameters).gain
        return LoopRates(gains[:, 1:4].max(axis=1), gains[:, 5:8].max(axis=1), self.integral_gain)


@kernel(LAW)
def position_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J_p⁺ k (p_d − p)."""
    given, own = partial_parameters(parameters), partial_work(work, out.shape[0])
    here, there, target = own.here, own.there, own.target
    translation(pose, here)
    translation(sample, there)
    for i in range(3):
        target[i] = given.gain * (there[i] - here[i])
    error, inverse = pose_error(pose, sample), inverse_parameters(given.inverse)
    error = counted((0.0, 0.0, 0.0, error[3], error[4], error[5]), inverse.share)
    missing = twist_jacobian, (here[0], here[1], here[2]), error, 1.0
    _velocity_rows(here, twist_jacobian, own.matrix)
    return solve(own.matrix, target, own.preferred, missing, given.inverse, own.solver, out)


@kernel(LAW)
def rotation_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J_ω⁺ ω with the ω nearest to k (1 − r*r_d); the state is the sign of r_d."""
    n = out.shape[0]
    given, own = partial_parameters(parameters), partial_work(work, n)
    rotation, matrix = rotation_work(own.rotation), own.matrix
    omega = rotation.omega
    length = inverse_parameters(given.inverse).length
    _rotation_error(pose, sample, 0.2, state, rotation)
    for i in range(4):
        rotation.error[i] *= given.gain
    _angular_velocity(pose, rotation)
    for c in range(n):
        for i in range(3):
            matrix[i, c] = length * twist_jacobian[i, c]
    for i in range(3):
        omega[i] *= length
    error, inverse = pose_error(pose, sample), inverse_parameters(given.inverse)
    error = counted((error[0], error[1], error[2], 0.0, 0.0, 0.0), inverse.share)
    missing = twist_jacobian, (0.0, 0.0, 0.0), error, length * length
    return solve(matrix, omega, own.preferred, missing, given.inverse, own.solver, out)


@inline
def _turn(axis, desired, spare, out):
    """Write θ n × l, the way on the sphere from an axis l to the desired one; half a turn goes about ``spare``."""
    x = axis[1] * desired[2] - axis[2] * desired[1]
    y = axis[2] * desired[0] - axis[0] * desired[2]
    z = axis[0] * desired[1] - axis[1] * desired[0]
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = axis[0] * desired[0] + axis[1] * desired[1] + axis[2] * desired[2]
    if sine > 1e-9:
        scale = math.atan2(sine, cosine) / sine
        x, y, z = scale * x, scale * y, scale * z
    elif cosine < 0.0:
        x, y, z = math.pi * spare[0], math.pi * spare[1], math.pi * spare[2]
    out[0] = y * axis[2] - z * axis[1]
    out[1] = z * axis[0] - x * axis[2]
    out[2] = x * axis[1] - y * axis[0]


@kernel(LAW)
def axis_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J_l⁺ k θ n × l for the direction l = Ad(r) a of one axis a of the end effector; J_l u = ω × l."""
    n = out.shape[0]
    given, own = partial_parameters(parameters), partial_work(work, n)
    target, axis, matrix = own.target, own.here, own.matrix
    rotate(pose, given.axis, axis)
    rotate(sample, given.axis, own.there)
    rotate(pose, given.spare, own.spare)
    _turn(axis, own.there, own.spare, target)
    length = inverse_parameters(given.inverse).length
    for i in range(3):
        target[i] *= given.gain
    for c in range(n):
        x, y, z = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        matrix[0, c] = length * (y * axis[2] - z * axis[1])
        matrix[1, c] = length * (z * axis[0] - x * axis[2])
        matrix[2, c] = length * (x * axis[1] - y * axis[0])
    for i in range(3):
        target[i] *= length
    missing = twist_jacobian, (0.0, 0.0, 0.0), NO_ERROR, length * length
    return solve(matrix, target, own.preferred, missing, given.inverse, own.solver, out)


_PARTS = {"position": position_proportional, "rotation": rotation_proportional, "axis": axis_proportional}


class PartialProportional(Law, frozen=True, kw_only=True, tag="partial-proportional"):
    """P on a part of the pose; what is left free may serve a ``null_space`` motion. [P16 2.2.2]

    ``position``: q̇ = J_p⁺ k (p_d − p); ``rotation``: orientation only, tan(θ/4) ∝ exp(−kt); ``axis``: only the
    direction l of one axis of the end effector, q̇ = J_l⁺ k θ n × l, n the axis and θ the angle that turn it to l_d the
    short way, for tools that are symmetric about it. With ideal joints the part's error decays at rate k (θ itself,
    also from half a turn); the rest of the pose moves as it happens to.

    Sampling limits: the part has the loop gain k. With ideal joints kT < 2 is stable and kT ≤ 1 monotone, with one
    sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol check``.

    Choice: k as for `Proportional`, and a ``null_space`` motion for what is left free.

    Parameters
    ----------
    part
        ``"position"``, ``"rotation"`` or ``"axis"``.
    gain
        k in 1/s, a number or a `Schedule`.
    axis
        Direction in the end effector's frame, for ``"axis"``; any length.
    inverse
        How the part's Jacobian is inverted; the default is exact away from singularities. An axis can turn only two
        ways, so its Jacobian always has one vanishing singular value, which is filtered out.
    null_space
        Motion preferred where the part leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.PartialProportional(part="position", gain=2.0)
    >>> here, there = arm.fkm(q), arm.fkm(q + 0.1)
    >>> u = law.command(arm, q, dqc.Sample(there), period=0.01)
    >>> way = dqc.algebra.translation(there) - dqc.algebra.translation(here)
    >>> np.allclose(arm.translation_jacobian(q) @ u, 2 * way)
    True
    """

    gain_powers: ClassVar[Mapping[str, float]] = {"gain": 1}
    part: Literal["position", "rotation", "axis"]
    gain: Annotated[Gain, Meta(description="1/s")]
    axis: Annotated[tuple[float, float, float], Meta(description="in the end effector's frame")] = (
        0.0,
        0.0,
        1.0,
    )
    inverse: Inverse = FilteredInverse()
    work = partial_work

    @property
    def kernel(self) -> Kernel:  # type: ignore[override]
        """The kernel of the part."""
        return _PARTS[self.part]

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, gain and axis at each time."""
        axis = as_array("axis", self.axis, (3,))
        if np.linalg.norm(axis) < 1e-9:
            raise ValueRangeError("axis: must not be zero")
        gains = gain_rows("gain", self.gain, times)
        axis = axis / np.linalg.norm(axis)
        spare = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        inverse = self.inverse
        if self.part == "position":  # no angles to be measured in metres
            inverse = replace(inverse, characteristic_length=1.0)
        return partial_parameters.pack(
            inverse=inverse.parameters(), gain=gains, axis=axis, spare=spare / np.linalg.norm(spare)
        )

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return k for the part that is controlled."""
        gains = np.asarray(partial_parameters(parameters).gain)
        if self.part == "position":
            return LoopRates(position=gains, orientation=None)
        return LoopRates(position=None, orientation=gains)

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the gain schedule, s."""
        return self.gain.end if isinstance(self.gain, Schedule) else 0.0
