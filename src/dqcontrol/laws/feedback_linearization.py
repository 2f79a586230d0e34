"""Feedback linearisation of the hand's motion: the pose error behaves like a damped spring, whatever the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, get_args

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.kernels import (
    adjoint_twist,
    conjugate,
    conjugate_multiply,
    cross_twist,
    log_body,
    log_inertial,
    rotate,
    translation,
)
from dqcontrol.compile import inlined, kernel
from dqcontrol.errors import ValueRangeError, as_positive, unknown_name
from dqcontrol.laws.inverses import (
    ELSEWHERE,
    FilteredInverse,
    Inverse,
    solve,
    solve_hand_twist,
    work_size,
)
from dqcontrol.laws.law import LAW, SCRATCH, Law
from dqcontrol.laws.null_space import AnyNullSpace, BestHeading
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_law import HYSTERESIS, parameter_head
from dqcontrol.laws.sideways import (
    drive_table,
    feasible_inputs,
    turn_rates,
    twist_jacobian_with_sideways,
)
from dqcontrol.robots import Robot
from dqcontrol.robots.kernels import hand_jacobian

if TYPE_CHECKING:
    from dqcontrol.references import Reference

VelocityState = Literal["realised", "commanded", "realised-unconstrained"]
Logarithm = Literal["body", "inertial"]

_FIRST = HYSTERESIS + 1
_PERIOD, _STIFFNESS, _DAMPING, _VELOCITY_STATE, _LOGARITHM, _SMOOTH, _DRIVES = range(_FIRST, _FIRST + 7)
_REALISED, _COMMANDED, _REALISED_UNCONSTRAINED = range(3)

# Of the decrease 2 k_v |ξ̃|² of V that the body logarithm has, the inertial one may give up this share.
_GIVEN_UP = 0.5


@inlined
def spring(relative, error_twist, stiffness, damping, inertial, out):
    """Write k_p log x̃ of the body logarithm with k_p = k̄/2, or of the inertial one as far as V then decreases.

    With the inertial logarithm V̇ = 2 (k̄ A₁ − k_p A₂) − 2 k_v |ξ̃|², and k_p A₂ ≥ k̄ A₁ − s k_v |ξ̃|² leaves
    V̇ ≤ −2 (1 − s) k_v |ξ̃|². Where no k_p between 0 and 4 k̄ does that, the body logarithm takes its place.
    """
    log_body(relative, out)
    gain = 0.5 * stiffness
    if inertial:
        first, square = 0.0, 0.0
        for i in range(6):
            first += 0.5 * out[i] * error_twist[i]  # A₁ = ⟨L, L̇⟩, the same for both logarithms
            square += error_twist[i] * error_twist[i]
        needed = stiffness * first - _GIVEN_UP * damping * square
        log_inertial(relative, out)
        second = 0.0
        for i in range(6):
            second += out[i] * error_twist[i]  # A₂ = ⟨L, ξ̃⟩
        if second > 0.0 and gain * second < needed:
            gain = needed / second
        elif second < 0.0 and gain * second < needed:
            gain = min(gain, needed / second)
        if gain < 0.0 or gain > 4.0 * stiffness or gain * second < needed - 1e-12 * abs(needed):
            log_body(relative, out)
            gain = 0.5 * stiffness
    for i in range(6):
        out[i] *= gain


@inlined
def apply(jacobian, inputs, out):
    """Write the twist J u."""
    for k in range(6):
        out[k] = 0.0
        for i in range(jacobian.shape[1]):
            out[k] += jacobian[k, i] * inputs[i]


@inlined
def is_blocked(jacobian, i):
    """Return whether an input has been taken out of the Jacobian, at a joint limit."""
    size = 0.0
    for k in range(6):
        size += abs(jacobian[k, i])
    return size == 0.0


@inlined
def solve_body_twist(body_twist, pose, twist_jacobian, preferred, inverse, work, out):
    """Write out = z + J⁺ (t − J z) with the Jacobian of the hand's [ω ; ṗ], for a body twist t.

    A body twist is [ω ; ṗ] in the hand's axes, so what is least squares here does not depend on where the inertial
    frame is, however far a base has gone from it.
    """
    n = twist_jacobian.shape[1]
    hand_twist, position, rest = work[0:6], work[6:9], work[9:]
    rotate(pose, body_twist[0:3], hand_twist[0:3])
    rotate(pose, body_twist[3:6], hand_twist[3:6])
    status = solve_hand_twist(pose, twist_jacobian, hand_twist, preferred, 1.0, inverse, rest, out)
    if status != ELSEWHERE:
        return status
    rotate(pose, body_twist[0:3], hand_twist[0:3])
    rotate(pose, body_twist[3:6], hand_twist[3:6])
    translation(pose, position)
    matrix = rest[0 : 6 * n].reshape(6, n)
    hand_jacobian((position[0], position[1], position[2]), twist_jacobian, matrix)
    return solve(matrix, hand_twist, preferred, inverse, rest[6 * n :], out)


@kernel(LAW)
def feedback_linearization(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write u = J⁺ (ξ_b + T U), ξ_b the twist that the last inputs give the hand here, and remember u."""
    m = twist_jacobian.shape[1]
    own, rest = work[m : m + SCRATCH], work[m + SCRATCH :]
    period = parameters[_PERIOD]
    drives = parameters[_DRIVES:].reshape((parameters.shape[0] - _DRIVES) // 2, 2)
    velocity_state = int(parameters[_VELOCITY_STATE])
    sideways = 0 if velocity_state == _REALISED else drives.shape[0]
    memory, last = state[1:7], state[7:]

    opposite, relative = own[0:8], own[8:16]
    twist, body_twist, desired, error_twist = own[16:22], own[22:28], own[28:34], own[34:40]
    product = own[40:46]
    conjugate(pose, opposite)
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], parameters[HYSTERESIS], state)
    for i in range(8):
        relative[i] *= sign

    n = m + sideways
    jacobian = rest[0 : 6 * n].reshape(6, n)
    twist_jacobian_with_sideways(drives[0:sideways], twist_jacobian, jacobian)
    if velocity_state == _REALISED:
        for i in range(6):
            body_twist[i] = memory[i]
    else:
        apply(jacobian, last, twist)
        adjoint_twist(opposite, twist, body_twist)
    # Ad(x̃*) ξ_d,b = Ad(x* x_d) Ad(x_d*) ξ_d, and the same for its rate
    adjoint_twist(opposite, sample[8:14], desired)
    for i in range(6):
        error_twist[i] = body_twist[i] - desired[i]
    cross_twist(desired, error_twist, product)
    for i in range(6):
        body_twist[i] += period * (product[i] - parameters[_DAMPING] * error_twist[i])
    adjoint_twist(opposite, sample[14:20], product)
    spring(
        relative,
        error_twist,
        parameters[_STIFFNESS],
        parameters[_DAMPING],
        parameters[_LOGARITHM] != 0.0,
        twist,
    )
    for i in range(6):
        body_twist[i] += period * (product[i] - twist[i])

    preferred, rates, rest = rest[6 * n : 7 * n], rest[7 * n : 8 * n], rest[8 * n :]
    for i in range(n):
        preferred[i] = work[i] if i < m else 0.0
        if parameters[_SMOOTH] != 0.0:
            preferred[i] = last[i] + period * parameters[_DAMPING] * (preferred[i] - last[i])
        if is_blocked(jacobian, i):
            preferred[i] = 0.0
    status = solve_body_twist(body_twist, pose, jacobian, preferred, parameters, rest, rates)
    feasible_inputs(drives[0:sideways], rates, out)
    apply(jacobian, rates, twist)
    adjoint_twist(opposite, twist, memory)
    if velocity_state == _COMMANDED:
        turn_rates(drives, out, period, rates)
        for i in range(m, n):
            last[i] = rates[i]
    for i in range(m):
        last[i] = rates[i] if velocity_state == _COMMANDED else out[i]
    return status


class FeedbackLinearization(Law, frozen=True, kw_only=True, tag="feedback-linearization"):
    """Make the hand move like a damped spring towards its desired pose. [S17 4.8–4.27, Wang and Yu 2013]

    With x̃ = x_d* x (the short way), its logarithm log x̃ = θ/2 n + ε½p̃_b and ξ̃ = ξ_b − Ad(x̃*) ξ_d,b:

    U = −k_p log x̃ − k_v ξ̃ + Ad(x̃*) ξ̇_d,b + (Ad(x̃*) ξ_d,b) × ξ̃,   u = z + J⁺ (ξ_b + T U − J z),   k_p = k̄/2.

    J is the Jacobian of body twists and ξ_b the hand's body twist, which the law remembers: J u of the last sample, 0
    at the start. So a robot that takes velocities is driven by accelerations: the first command is of the size of T U,
    however large the error.

    Guarantee: dξ̃/dt = −k_p log x̃ − k_v ξ̃, and V = |ξ̃|² + k̄ |log x̃|² falls at V̇ = −2 k_v |ξ̃|², for goals at
    rest and moving ones: asymptotically stable from everywhere but half a turn away. About a fixed axis, and for
    translations, θ̈ + k_v θ̇ + k̄/4 θ = 0. This holds in continuous time and where J⁺ is exact: at singularities the
    twist asked for does not lie in the range of J, and the hand may stay there, which S17 leaves open. `BestHeading`,
    the default, keeps drives out of those that their heading can avoid.

    S17's k_p = k̄ A₁/A₂, A₁ = ⟨log x̃, d log x̃/dt⟩, A₂ = ⟨log x̃, ξ̃⟩, is k̄/2 identically if the logarithm is taken
    with p̃ in the hand's axes; as printed, with p̃ in those of the desired pose, it is unbounded and may be negative.

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
        How J is inverted; the default is exact away from singularities. Without a null space motion its damping acts
        once a sample on the velocity itself: a `DampedInverse` is then friction σ²/(σ² + λ²) everywhere.
    hysteresis
        How far Re(x̃) must pass 0 before its sign flips.
    velocity_state
        ``"realised"``: ξ_b as above, with J the Jacobian of v, ω and q̇. S17 solves for ẋ, ẏ and φ̇ as if a base could
        move sideways, sends what drives can do of it (F, 4.27), and takes ξ_b = J(q(k)) q̇(k−1), which adds the
        acceleration J̇q̇ to U (4.17). Its q̇ is then either that solution, ``"commanded"``, or what was sent,
        ``"realised-unconstrained"``, which loses most of the motion in some directions every sample and hardly arrives
        anywhere: the print leaves open which is meant.
    logarithm
        ``"body"``, or ``"inertial"`` as S17 prints it (3.13). Its k_p is then k̄/2 as far as V̇ ≤ −k_v |ξ̃|² allows;
        where no k_p in (0, 4k̄) does, that sample takes the body logarithm.
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
    >>> law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0).prepare(robot, None, dt=0.05)
    >>> state = law.initial_state(q)
    >>> for _ in range(400):
    ...     q = robot.integrate(q, law.command(q, target, state), law.dt)
    >>> float(np.abs(robot.fkm(q) - target.pose).max()) < 1e-3
    True
    """

    kernel = feedback_linearization
    stiffness: Annotated[float, Meta(gt=0, description="k̄, 1/s²")]
    damping: Annotated[float, Meta(gt=0, description="k_v, 1/s")]
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[float, Meta(ge=0, lt=1)] = 0.2
    velocity_state: VelocityState = "realised"
    logarithm: Logarithm = "body"
    null_space: AnyNullSpace | None = BestHeading()

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return one row: inverse, hysteresis, period, gains, choices, and the table of drives."""
        for field, value, names in (
            ("velocity_state", self.velocity_state, VelocityState),
            ("logarithm", self.logarithm, Logarithm),
        ):
            if value not in get_args(names):
                raise unknown_name(field, str(value), get_args(names))
        drives = drive_table(robot)
        if len(drives) < len(robot.drives) and self.velocity_state == "realised-unconstrained":
            raise ValueRangeError(
                f"velocity_state: {self.velocity_state!r} is for the constrained form of {robot.name}, got the other"
            )
        return np.array(
            [
                [
                    *parameter_head(self.inverse, self.hysteresis),
                    dt,
                    as_positive("stiffness", self.stiffness),
                    as_positive("damping", self.damping),
                    get_args(VelocityState).index(self.velocity_state),
                    get_args(Logarithm).index(self.logarithm),
                    self.null_space is not None,
                    *drives.ravel(),
                ]
            ]
        )

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign, the hand's twist and the last inputs, with a sideways speed for each drive."""
        return 7 + robot.input_size + len(drive_table(robot))

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion, scratch, two Jacobians, two rows of rates and the solver's own."""
        n = robot.input_size + len(drive_table(robot))
        return robot.input_size + SCRATCH + 14 * n + 9 + work_size()
