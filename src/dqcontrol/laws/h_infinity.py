"""H-infinity control of the pose: bounded influence of twist and pose disturbances."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    body_translation,
    conjugate,
    conjugate_multiply,
    multiply,
    translation,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ShapeError
from dqcontrol.laws.desired_twist import Feedforward, FeedforwardLaw, desired_twist, signed_state
from dqcontrol.laws.hand_twist import solve_hand_twist, solve_left_twist, twist_at_end_effector, twist_work
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters
from dqcontrol.laws.law import LAW, Law, LoopRates
from dqcontrol.laws.pose_error import LEVER_CURVES, short_sign, shorten_lever
from dqcontrol.laws.pose_law import Gain, Positive, Schedule, gain_rows

if TYPE_CHECKING:
    from dqcontrol.references import Reference
    from dqcontrol.robots import Robot


class HInfinityParameters(NamedTuple):
    """What compiled code knows of the law; ``tracking`` is 0 where the desired twist is not added.

    What feed-forward of second order needs comes last.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    orientation: float
    translation: float
    tracking: float
    second_order: Annotated[Array, ...]


class HInfinityWork(NamedTuple):
    """Scratch of both forms."""

    preferred: Annotated[Array, "m"]
    relative: Annotated[Array, 8]
    opposite: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    desired: Annotated[Array, 6]
    moved: Annotated[Array, 6]
    solver: Annotated[Array, twist_work.sized("m")]


h_infinity_parameters: MemoryLayout[HInfinityParameters] = MemoryLayout(HInfinityParameters, unchecked=True)
h_infinity_work: MemoryLayout[HInfinityWork] = MemoryLayout(HInfinityWork, "m", unchecked=True)


@kernel(LAW)
def h_infinity_right(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ of the inertial twist [−k_O Im r_e ; −k_T p_e] + Ad(x_e) ξ_d with x_e = x x_d*."""
    m = out.shape[0]
    given, own = h_infinity_parameters(parameters), h_infinity_work(work, m)
    relative, twist = own.relative, own.twist
    conjugate(sample, own.opposite)
    multiply(pose, own.opposite, relative)
    sign = short_sign(relative[0], given.hysteresis, state)
    for i in range(3):
        twist[i] = 2.0 * sign * relative[1 + i]
    translation(relative, twist[3:6])
    shorten_lever(twist, pose, sample, given.inverse)
    for i in range(3):
        twist[i] *= -0.5 * given.orientation
        twist[3 + i] *= -given.translation
    share = LEVER_CURVES / max(0.5 * given.orientation, given.translation)
    a, b, c, d, e, f = twist_at_end_effector(twist, pose)
    error = share * a, share * b, share * c, share * d, share * e, share * f
    if given.tracking != 0.0:
        last = signed_state(state, m).last
        desired_twist(sample, pose, twist_jacobian, given.second_order, last, own.desired)
        adjoint_twist(relative, own.desired, own.moved)
        for i in range(6):
            twist[i] += own.moved[i]
    hand_twist = twist_at_end_effector(twist, pose)
    return solve_hand_twist(
        pose, twist_jacobian, hand_twist, error, own.preferred, given.inverse, own.solver, out
    )


@kernel(LAW)
def h_infinity_left(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ of the body twist [−k_O Im r_l ; −k_T p_b,l] + Ad(x_l*) ξ_d,b with x_l = x_d* x."""
    m = out.shape[0]
    given, own = h_infinity_parameters(parameters), h_infinity_work(work, m)
    relative, twist, tracking = own.relative, own.twist, given.tracking
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], given.hysteresis, state)
    body_translation(relative, twist[3:6])
    for i in range(3):
        twist[i] = -given.orientation * sign * relative[1 + i]
        twist[3 + i] *= -given.translation
    last = signed_state(state, m).last
    desired_twist(sample, pose, twist_jacobian, given.second_order, last, own.desired)
    return solve_left_twist(
        twist,
        tracking,
        pose,
        twist_jacobian,
        sample,
        own.desired,
        own.preferred,
        given.inverse,
        own.solver,
        out,
    )


_KERNELS = {"right": h_infinity_right, "left": h_infinity_left}


class HInfinity(Law, frozen=True, kw_only=True, tag="h-infinity"):
    """HIR: q̇ = J_w⁺ [−k_O Im r_e ; −k_T p_e], x_e = x x_d* = r_e + ε½p_e r_e. [P16 3.30]

    With a resting target and ideal joints |p_e| decays at rate k_T exactly and tan(θ/4) at k_O/2. Where the robot is
    disturbed by an inertial twist v_w and by a moving pose c of the end effector (twist v_c), with gains at the bounds
    k_O = √2 √(γ_O1⁻² + γ_O2⁻²) and k_T = √(γ_T1⁻² + γ_T2⁻²):
    ‖p_e‖² ≤ γ_T1² ‖v'_w‖² + γ_T2² ‖v'_c‖² in L2 over any horizon from zero error, v' the dual parts in the inertial
    frame, and the same for ‖Im r_e‖ with the primary parts while Re(r_e) ≥ 0. The position's bound is tight. The
    orientation's is not: while errors are small k_O is √2 more than it takes, k_O = √(γ_O1⁻² + γ_O2⁻²) would do. The
    bounds assume continuous time, an undamped inverse and exact kinematics.

    The right error's p_e = p − Ad(r_e) p_d contains the lever arm of the base's origin, so accuracy depends on where
    the base frame sits; the ``left`` form has the same rates, with |p_b,l| = |p − p_d|.

    Sampling limits: the loop gain k is k_T for the position, k_O/2 for the orientation. With ideal joints kT < 2 is
    stable and kT ≤ 1 monotone, with one sample of delay kT < 1 and kT ≤ 1/4; for servos and physics ask ``dqcontrol
    check``.

    Choice: from the disturbance v expected and the error allowed, k_T ≥ |v'|/|p_e| and k_O ≥ |v|/|Im r_e|, or from
    γ. Equal loop gains have k_O = 2 k_T.

    Parameters
    ----------
    orientation_gain, translation_gain
        k_O and k_T in 1/s, numbers or `Schedule`.
    orientation_gamma, translation_gamma
        Instead of the gains: γ with equal shares of both disturbances, k_O = 2/γ_O, k_T = √2/γ_T [P16 5.5–5.6]. Small
        orientation errors then stay below γ_O/√2 times the disturbance.
    form
        ``"right"`` (as published) or ``"left"`` (recommended where position accuracy matters).
    inverse
        How J_w is inverted; the default is exact away from singularities.
    hysteresis
        How far Re(r_e) must pass 0 before the sign of x_e flips.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> q = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> law = dqc.laws.HInfinity(orientation_gamma=0.5, translation_gamma=0.5, form="left")
    >>> float(np.abs(law.command(arm, q, dqc.Sample(arm.fkm(q)), period=0.01)).max()) < 1e-12
    True
    """

    gain_powers: ClassVar[Mapping[str, float]] = {
        "orientation_gain": 1,
        "translation_gain": 1,
        "orientation_gamma": -1,
        "translation_gamma": -1,
    }
    orientation_gain: Annotated[Gain | None, Meta(description="k_O, 1/s")] = None
    translation_gain: Annotated[Gain | None, Meta(description="k_T, 1/s")] = None
    orientation_gamma: Annotated[Positive | None, Meta(description="γ_O, s")] = None
    translation_gamma: Annotated[Positive | None, Meta(description="γ_T, s")] = None
    form: Literal["right", "left"] = "right"
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[float, Meta(ge=0, lt=1)] = 0.2
    work = h_infinity_work

    @property
    def kernel(self) -> Kernel:  # type: ignore[override]
        """The kernel of the form."""
        return _KERNELS[self.form]

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis, gains and whether to track, at each time."""
        orientation = _gains("orientation", self.orientation_gain, self.orientation_gamma, 2.0, times)
        translation_ = _gains(
            "translation", self.translation_gain, self.translation_gamma, math.sqrt(2), times
        )
        return h_infinity_parameters.pack(
            inverse=self.inverse.parameters(),
            hysteresis=self.hysteresis,
            orientation=orientation,
            translation=translation_,
            tracking=float(self._tracks()),
            second_order=np.zeros(0),
        )

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return k_T and k_O/2."""
        given = h_infinity_parameters(parameters)
        return LoopRates(
            position=np.asarray(given.translation), orientation=np.asarray(given.orientation) / 2
        )

    def _tracks(self) -> bool:
        return False

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the later gain schedule, s."""
        gains = (self.orientation_gain, self.translation_gain)
        return max([gain.end for gain in gains if isinstance(gain, Schedule)], default=0.0)


class HInfinityTracking(FeedforwardLaw, HInfinity, frozen=True, kw_only=True, tag="h-infinity-tracking"):
    """HIRT: `HInfinity` with the desired twist added: q̇ = J_w⁺ ([−k_O Im r_e ; −k_T p_e] + Ad(x_e) ξ_d). [P16 3.33]

    Rates and bounds of `HInfinity` hold for a moving target; sampling limits, choice and parameters are those there;
    ``feedforward`` as of `ProportionalFeedforward`.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> twist = arm.twist_jacobian(q) @ np.full(7, 0.1)
    >>> law = dqc.laws.HInfinityTracking(orientation_gain=4.0, translation_gain=2.0)
    >>> u = law.command(arm, q, dqc.Sample(arm.fkm(q), twist), period=0.01)
    >>> np.allclose(arm.twist_jacobian(q) @ u, twist)
    True
    """

    parameters_before = h_infinity_parameters.place("second_order")
    feedforward: Feedforward = "second-order"

    def _tracks(self) -> bool:
        return True


def _gains(
    name: str, gain: float | Schedule | None, gamma: float | None, product: float, times: np.ndarray
) -> np.ndarray:
    """Return gain rows from a gain, or from a γ with gain · γ = product."""
    if (gain is None) == (gamma is None):
        raise ShapeError(f"{name}_gain: give either {name}_gain or {name}_gamma")
    if gamma is not None:
        return np.array([product / gamma])
    return gain_rows(f"{name}_gain", gain, times)  # type: ignore[arg-type]
