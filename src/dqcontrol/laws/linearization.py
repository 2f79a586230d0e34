"""One sample of feedback linearisation: the step that all laws of this kind share."""

from __future__ import annotations

from typing import Literal

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    conjugate,
    conjugate_multiply,
    cross_twist,
    log_body,
    log_inertial,
)
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.laws.hand_twist import in_inertial_axes, solve_hand_twist
from dqcontrol.laws.law import SCRATCH
from dqcontrol.laws.pose_error import short_sign
from dqcontrol.laws.pose_law import HYSTERESIS
from dqcontrol.laws.unconstrained_drive import twist_jacobian_with_sideways
from dqcontrol.limits.position_limit import FIXED

VelocityState = Literal["realised", "commanded", "realised-unconstrained"]
Logarithm = Literal["body", "inertial"]

_FIRST = HYSTERESIS + 1
PERIOD, _STIFFNESS, _DAMPING, VELOCITY_STATE, _LOGARITHM, _SMOOTH, DRIVES = range(_FIRST, _FIRST + 7)
REALISED, COMMANDED, REALISED_UNCONSTRAINED = range(3)

# Of the decrease 2 k_v |ξ̃|² of V that the body logarithm has, the inertial one may give up this share.
_GIVEN_UP = 0.5


@inline
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
    return size < 100.0 * FIXED


@inline
def linearize(pose, twist_jacobian, sample, parameters, state, work, rates):
    """Write the rates z + J⁺ (ξ_b + T U − J z), and remember the twist that they give the hand.

    ξ_b is the body twist that was remembered, or J times the rates that were. Where that is so, drives count as if they
    could move sideways: their speeds to the side are the last of the rates.
    """
    m, n = twist_jacobian.shape[1], rates.shape[0]
    scratch, rest = work[m : m + SCRATCH], work[m + SCRATCH :]
    period = parameters[PERIOD]
    drives = as_matrix(parameters[DRIVES:], (parameters.shape[0] - DRIVES) // 2, 2)
    memory, last = state[1:7], state[7:]

    opposite, relative = scratch[0:8], scratch[8:16]
    twist, body_twist, desired, error_twist = scratch[16:22], scratch[22:28], scratch[28:34], scratch[34:40]
    product = scratch[40:46]
    conjugate(pose, opposite)
    conjugate_multiply(sample, pose, relative)
    sign = short_sign(relative[0], parameters[HYSTERESIS], state)
    for i in range(8):
        relative[i] *= sign

    jacobian = as_matrix(rest[0 : 6 * n], 6, n)
    twist_jacobian_with_sideways(drives[0 : n - m], twist_jacobian, jacobian)
    if int(parameters[VELOCITY_STATE]) == REALISED:
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

    preferred, rest = rest[6 * n : 7 * n], rest[7 * n :]
    for i in range(n):
        preferred[i] = work[i] if i < m else 0.0
        if parameters[_SMOOTH] != 0.0 and not is_fixed(jacobian, i):
            preferred[i] = last[i] + period * parameters[_DAMPING] * (preferred[i] - last[i])
    hand_twist = in_inertial_axes(body_twist, pose)
    status = solve_hand_twist(pose, jacobian, hand_twist, preferred, parameters, rest, rates)
    apply(jacobian, rates, twist)
    adjoint_twist(opposite, twist, memory)
    for i in range(n):
        if is_fixed(jacobian, i):
            rates[i] *= FIXED
    return status
