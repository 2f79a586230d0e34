"""One sample of feedback linearisation: the step that all laws of this kind share."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    conjugate,
    conjugate_multiply,
    cross_twist,
    log_body,
    log_inertial,
    position,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import pose_error
from dqcontrol.laws.hand_twist import in_inertial_axes, solve_hand_twist, twist_work
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_inverse import DAMPED_POSE, solve_pose_rows
from dqcontrol.laws.unconstrained_drive import twist_jacobian_with_sideways
from dqcontrol.limits.position_limit import FIXED

VelocityState = Literal["realised", "commanded", "realised-unconstrained"]
Logarithm = Literal["body", "inertial", "inertial-unguarded"]

REALISED, COMMANDED, REALISED_UNCONSTRAINED = range(3)
BODY, INERTIAL, INERTIAL_UNGUARDED = range(3)


class LinearizationParameters(NamedTuple):
    """What compiled code knows of these laws.

    Attributes
    ----------
    velocity_state, logarithm
        Places in the types above.
    smooth
        1 where the inputs come to preferred ones smoothly.
    drives
        Table of the drives that cannot move sideways, see `drive_table`.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    period: float
    stiffness: float
    damping: float
    velocity_state: float
    logarithm: float
    smooth: float
    drives: Annotated[Array, "drives", 2]


class LinearizationState(NamedTuple):
    """What they keep: the sign of x_d, the hand's body twist, and the last rates, sideways ones included."""

    sign: Annotated[Array, 1]
    twist: Annotated[Array, 6]
    last: Annotated[Array, "columns"]


class LinearizationWork(NamedTuple):
    """Their scratch, for m inputs and a Jacobian of as many columns or more."""

    preferred: Annotated[Array, "m"]
    opposite: Annotated[Array, 8]
    relative: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    body_twist: Annotated[Array, 6]
    desired: Annotated[Array, 6]
    error_twist: Annotated[Array, 6]
    product: Annotated[Array, 6]
    jacobian: Annotated[Array, 6, "columns"]
    preferred_rates: Annotated[Array, "columns"]
    solver: Annotated[Array, twist_work.sized("columns")]
    rates: Annotated[Array, "columns"]


linearization_parameters: MemoryLayout[LinearizationParameters] = MemoryLayout(
    LinearizationParameters, "drives"
)
linearization_state: MemoryLayout[LinearizationState] = MemoryLayout(LinearizationState, "columns")
linearization_work: MemoryLayout[LinearizationWork] = MemoryLayout(LinearizationWork, "m", "columns")

# Of the decrease 2 k_v |ξ̃|² of V that the body logarithm has, the inertial one may give up this share: below 1 V still
# decreases; at 0 the inertial logarithm would be left wherever it does worse at all.
_GIVEN_UP = 0.5


@inline
def spring(relative, error_twist, stiffness, damping, logarithm, out):
    """Write k_p log x̃ of the body logarithm with k_p = k̄/2, or of the inertial one as far as V then decreases.

    With the inertial logarithm V̇ = 2 (k̄ A₁ − k_p A₂) − 2 k_v |ξ̃|², and k_p A₂ ≥ k̄ A₁ − s k_v |ξ̃|² leaves
    V̇ ≤ −2 (1 − s) k_v |ξ̃|². Where no k_p between 0 and 4 k̄ does that, the body logarithm takes its place. Unguarded, it
    is k̄ A₁/A₂ whatever that is, and k̄ where A₂ = 0 [S17 4.44].
    """
    log_body(relative, out)
    gain = 0.5 * stiffness
    if logarithm != BODY:
        first, square = 0.0, 0.0
        for i in range(6):
            first += 0.5 * out[i] * error_twist[i]  # A₁ = ⟨L, L̇⟩, the same for both logarithms
            square += error_twist[i] * error_twist[i]
        needed = stiffness * first - _GIVEN_UP * damping * square
        log_inertial(relative, out)
        second = 0.0
        for i in range(6):
            second += out[i] * error_twist[i]  # A₂ = ⟨L, ξ̃⟩
        if logarithm == INERTIAL_UNGUARDED:
            gain = stiffness * first / second if second != 0.0 else stiffness
        elif second > 0.0 and gain * second < needed:
            gain = needed / second
        elif second < 0.0 and gain * second < needed:
            gain = min(gain, needed / second)
        if logarithm == INERTIAL and (
            gain < 0.0 or gain > 4.0 * stiffness or gain * second < needed - 1e-12 * abs(needed)
        ):  # rounding: needed / second · second is needed to some 2⁻⁵³
            log_body(relative, out)
            gain = 0.5 * stiffness
    for i in range(6):
        out[i] *= gain


@inline
def apply(jacobian, inputs, out):
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
def linearize(pose, twist_jacobian, sample, given, kept, own):
    """Write the rates z + J⁺ (ξ_b + T U − J z), and remember the twist that they give the hand.

    ξ_b is the body twist that was remembered, or J times the rates that were. Where that is so, drives count as if they
    could move sideways: their speeds to the side are the last of the rates.
    """
    m, n = twist_jacobian.shape[1], own.rates.shape[0]
    period, jacobian, preferred, last = given.period, own.jacobian, own.preferred_rates, kept.last
    opposite, relative, twist, body_twist = own.opposite, own.relative, own.twist, own.body_twist
    desired, error_twist, product = own.desired, own.error_twist, own.product
    conjugate(pose, opposite)
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], given.hysteresis, kept.sign)
    for i in range(8):
        relative[i] *= sign

    twist_jacobian_with_sideways(given.drives[0 : n - m], twist_jacobian, jacobian)
    if int(given.velocity_state) == REALISED:
        for i in range(6):
            body_twist[i] = kept.twist[i]
    else:
        apply(jacobian, last, twist)
        adjoint_twist(opposite, twist, body_twist)
    # Ad(x̃*) ξ_d,b = Ad(x* x_d) Ad(x_d*) ξ_d, and the same for its rate
    adjoint_twist(opposite, sample[8:14], desired)
    for i in range(6):
        error_twist[i] = body_twist[i] - desired[i]
    cross_twist(desired, error_twist, product)
    for i in range(6):
        body_twist[i] += period * (product[i] - given.damping * error_twist[i])
    adjoint_twist(opposite, sample[14:20], product)
    spring(relative, error_twist, given.stiffness, given.damping, int(given.logarithm), twist)
    for i in range(6):
        body_twist[i] += period * (product[i] - twist[i])

    for i in range(n):
        preferred[i] = own.preferred[i] if i < m else 0.0
        if given.smooth != 0.0 and not is_fixed(jacobian, i):
            preferred[i] = last[i] + period * given.damping * (preferred[i] - last[i])
    hand_twist = in_inertial_axes(body_twist, pose)
    if inverse_parameters(given.inverse).kind == DAMPED_POSE:
        status = solve_pose_rows(
            pose, position(pose), jacobian, hand_twist, preferred, given.inverse, own.solver, own.rates
        )
    else:
        missing = pose_error(pose, sample)
        status = solve_hand_twist(
            pose, jacobian, hand_twist, missing, preferred, given.inverse, own.solver, own.rates
        )
    apply(jacobian, own.rates, twist)
    adjoint_twist(opposite, twist, kept.twist)
    for i in range(n):
        if is_fixed(jacobian, i):
            own.rates[i] *= FIXED
    return status
