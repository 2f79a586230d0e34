"""Feedback linearisation of the end effector: its pose error behaves like a damped spring, whatever the robot.

The step of one sample is that of all laws of this kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    conjugate,
    conjugate_multiply,
    cross_twist,
    log_body,
    position,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import pose_error
from dqcontrol.laws.hand_twist import in_inertial_axes, solve_hand_twist, twist_work
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters
from dqcontrol.laws.law import LAW, Law, LoopRates
from dqcontrol.laws.null_space import AnyNullSpace, BestHeading
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_inverse import DAMPED_POSE, DampedPoseInverse, solve_pose_rows
from dqcontrol.limits.position_limit import FIXED
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class LinearizationParameters(NamedTuple):
    """What compiled code knows of these laws.

    Attributes
    ----------
    smooth
        1 where the inputs come to preferred ones smoothly.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    period: float
    stiffness: float
    damping: float
    smooth: float


class LinearizationState(NamedTuple):
    """What they keep: the sign of x_d, the end effector's body twist, and the last inputs."""

    sign: Annotated[Array, 1]
    twist: Annotated[Array, 6]
    last: Annotated[Array, "m"]


class LinearizationWork(NamedTuple):
    """Their scratch, for m inputs."""

    preferred: Annotated[Array, "m"]
    opposite: Annotated[Array, 8]
    relative: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    body_twist: Annotated[Array, 6]
    desired: Annotated[Array, 6]
    error_twist: Annotated[Array, 6]
    product: Annotated[Array, 6]
    preferred_rates: Annotated[Array, "m"]
    solver: Annotated[Array, twist_work.sized("m")]


linearization_parameters: MemoryLayout[LinearizationParameters] = MemoryLayout(LinearizationParameters)
linearization_state: MemoryLayout[LinearizationState] = MemoryLayout(LinearizationState, "m")
linearization_work: MemoryLayout[LinearizationWork] = MemoryLayout(LinearizationWork, "m")


@inline
def twist_of_inputs(jacobian, inputs, out):
    """Write the twist J u."""
    for k in range(6):
        out[k] = 0.0
        for i in range(jacobian.shape[1]):
            out[k] += jacobian[k, i] * inputs[i]


@inline
def is_fixed(jacobian, i):
    """Return whether an input has been taken out of the Jacobian, at a limit."""
    size = 0.0
    for k in range(6):
        size += abs(jacobian[k, i])
    return size < 100.0 * FIXED  # a column that is not fixed sums to less than 100 on robots of up to 50 m


@inline
def motion_errors(pose, sample, given, kept, own):
    """Write x̃ and ξ̃, and into ``body_twist`` ξ_b + T U without the spring, ξ_b the twist that was remembered."""
    opposite, relative, body_twist = own.opposite, own.relative, own.body_twist
    desired, error_twist, product = own.desired, own.error_twist, own.product
    conjugate(pose, opposite)
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], given.hysteresis, kept.sign)
    for i in range(8):
        relative[i] *= sign
    for i in range(6):
        body_twist[i] = kept.twist[i]
    # Ad(x̃*) ξ_d,b = Ad(x* x_d) Ad(x_d*) ξ_d, and the same for its rate
    adjoint_twist(opposite, sample[8:14], desired)
    for i in range(6):
        error_twist[i] = body_twist[i] - desired[i]
    cross_twist(desired, error_twist, product)
    for i in range(6):
        body_twist[i] += given.period * (product[i] - given.damping * error_twist[i])
    adjoint_twist(opposite, sample[14:20], product)


@inline
def solve_rates(pose, jacobian, sample, given, kept, own, out):
    """Write out = z + J⁺ (ξ_b + T U − J z), the spring's part of U as ``twist`` has it, and remember ξ_b = J out."""
    period, preferred, last = given.period, own.preferred_rates, kept.last
    twist, body_twist, product = own.twist, own.body_twist, own.product
    n = jacobian.shape[1]
    for i in range(6):
        body_twist[i] += period * (product[i] - twist[i])

    for i in range(n):
        preferred[i] = own.preferred[i]
        if given.smooth != 0.0 and not is_fixed(jacobian, i):
            preferred[i] = last[i] + period * given.damping * (preferred[i] - last[i])
    hand_twist = in_inertial_axes(body_twist, pose)
    if inverse_parameters(given.inverse).kind == DAMPED_POSE:
        status = solve_pose_rows(
            pose, position(pose), jacobian, hand_twist, preferred, given.inverse, own.solver, out
        )
    else:
        missing = pose_error(pose, sample)
        status = solve_hand_twist(
            pose, jacobian, hand_twist, missing, preferred, given.inverse, own.solver, out
        )
    twist_of_inputs(jacobian, out, twist)
    adjoint_twist(own.opposite, twist, kept.twist)
    for i in range(n):
        if is_fixed(jacobian, i):
            out[i] *= FIXED
    return status


class FeedbackWork(NamedTuple):
    """Scratch of `FeedbackLinearization`; that of all laws of this kind begins with the preferred motion."""

    linear: Annotated[Array, linearization_work.sized("m")]
    jacobian: Annotated[Array, 6, "m"]


feedback_work: MemoryLayout[FeedbackWork] = MemoryLayout(FeedbackWork, "m")


@kernel(LAW)
def feedback_linearization(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write z + J⁺ (ξ_b + T U − J z), and remember it."""
    m = out.shape[0]
    given, kept = linearization_parameters(parameters), linearization_state(state, m)
    whole = feedback_work(work, m)
    own, jacobian = linearization_work(whole.linear, m), whole.jacobian
    motion_errors(pose, sample, given, kept, own)
    log_body(own.relative, own.twist)
    for i in range(6):
        own.twist[i] *= 0.5 * given.stiffness
        for j in range(m):  # a copy: LLVM takes sums over an array of the caller's in another order
            jacobian[i, j] = twist_jacobian[i, j]
    status = solve_rates(pose, jacobian, sample, given, kept, own, out)
    for i in range(m):
        kept.last[i] = out[i]
    return status


# V measures a body twist by |[ω ; ṗ]|, so what cannot be done must be missed by the least of just that: then V falls
# at the rate proven in regulation also where J has lost rank, with another ℓ it may rise.
IN_BODY_TWISTS = FilteredInverse(threshold=0.02, damping=0.05, characteristic_length=1.0)


class FeedbackLinearization(Law, frozen=True, kw_only=True, tag="feedback-linearization"):
    """Make the end effector move like a damped spring towards its desired pose. [S17 4.8–4.27, Wang and Yu 2013]

    With x̃ = x_d* x (the short way), its logarithm log x̃ = θ/2 n + ε½p̃_b and ξ̃ = ξ_b − Ad(x̃*) ξ_d,b:

    U = −k_p log x̃ − k_v ξ̃ + Ad(x̃*) ξ̇_d,b + (Ad(x̃*) ξ_d,b) × ξ̃,   u = z + J⁺ (ξ_b + T U − J z),   k_p = k̄/2.

    J is the Jacobian of body twists and ξ_b the end effector's body twist, which the law remembers: J u of the last
    sample, 0 at the start. So a robot that takes velocities is driven by accelerations: the first command is of the
    size of T U, however large the error.

    Guarantee: dξ̃/dt = −k_p log x̃ − k_v ξ̃, and V = |ξ̃|² + k̄ |log x̃|² falls at V̇ = −2 k_v |ξ̃|², for goals at
    rest and moving ones: asymptotically stable from everywhere but half a turn away. About a fixed axis, and for
    translations, θ̈ + k_v θ̇ + k̄/4 θ = 0. This holds in continuous time and where J⁺ is exact: at singularities the
    twist asked for does not lie in the range of J, and the end effector may stay there, which S17 leaves open.
    `BestHeading`, the default, keeps drives out of those that their heading can avoid.

    S17's k_p = k̄ A₁/A₂, A₁ = ⟨log x̃, d log x̃/dt⟩, A₂ = ⟨log x̃, ξ̃⟩, is k̄/2 identically if the logarithm is taken
    with p̃ in the end effector's axes; as printed, with p̃ in those of the desired pose, it is unbounded and may
    be negative.

    Sampling limits: with ideal joints stable for 0 < k_v T < 2 and (k̄/4) T² < 4 − 2 k_v T. V may rise by O(T²) a
    sample. Delays and lags are not in the loop of the velocity; they should be short against 1/k_v.

    Choice: ω_n = √k̄/2 is the natural frequency, ζ = k_v/√k̄ the damping ratio. k_v = √k̄ is critical, the fastest
    without overshoot: the error falls to 2 % in 5.8/ω_n. With much more k_v it decays at k̄/(4 k_v).

    Parameters
    ----------
    stiffness
        k̄ (k̄_p in S17), 1/s².
    damping
        k_v, 1/s.
    inverse
        How J is inverted; the default is exact where singular values exceed 0.02. Its ℓ is 1 m, unlike that of other
        laws: where J has lost rank, P the projection onto its range, V̇ = −2 k_v |ξ̃|² of a goal at rest needs ⟨ξ_b, P
        U⟩ = ⟨ξ_b, U⟩, which least squares in |[ω ; ṗ]| alone, V's own measure, gives. Without a null space motion the
        damping acts once a sample on the velocity itself: a `DampedInverse` is then friction σ²/(σ² + λ²) everywhere,
        more of it the shorter the period, and so is the `DampedPoseInverse` that S17 prints (4.19).
    hysteresis
        How far Re(x̃) must pass 0 before its sign flips.
    null_space
        Motion preferred where the task leaves freedom. The inputs come to it at the rate k_v: z = u⁻ + k_v T (z₀ − u⁻)
        with the last inputs u⁻ and the preferred ones z₀, so that they start smoothly too, and singularities hold up
        accelerations but do not brake. With None, as published, the smallest inputs are taken: u = J⁺ (ξ_b + T U).

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> robot = dqc.load_robot("little-john")
    >>> q = np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(robot.integrate(q, [0.2, 0.1, 0, 0, 0, 0, 0], 1.0)))
    >>> law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0).prepare(robot, None, period=0.05)
    >>> state = law.initial_state(q)
    >>> for _ in range(400):
    ...     q = robot.integrate(q, law.command(q, target, state), law.period)
    >>> float(np.abs(robot.fkm(q) - target.pose).max()) < 1e-3
    True
    """

    kernel = feedback_linearization
    work = feedback_work
    gain_powers: ClassVar[Mapping[str, float]] = {"stiffness": 2, "damping": 1}
    stiffness: Annotated[float, Meta(gt=0, description="k̄, 1/s²")]
    damping: Annotated[float, Meta(gt=0, description="k_v, 1/s")]
    inverse: Inverse | DampedPoseInverse = IN_BODY_TWISTS
    hysteresis: Annotated[float, Meta(ge=0, lt=1)] = 0.2
    null_space: AnyNullSpace | None = BestHeading()

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return one row: inverse, hysteresis, period and gains."""
        return linearization_parameters.pack(
            inverse=self.inverse.parameters(),
            hysteresis=self.hysteresis,
            period=period,
            stiffness=self.stiffness,
            damping=self.damping,
            smooth=self.null_space is not None,
        )[None]

    def loop_rates(self, parameters: np.ndarray) -> LoopRates | None:
        """Return k̄/(4 k_v) behind a lag of k_v."""
        rates = np.full(len(parameters), self.stiffness / (4 * self.damping))
        return LoopRates(rates, rates, lag=self.damping)

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign, the end effector's twist and the last inputs."""
        return linearization_state.size(robot.input_size)
