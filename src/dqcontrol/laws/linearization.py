"""One sample of feedback linearisation: the step that all laws of this kind share."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import (
    adjoint_twist,
    conjugate,
    conjugate_multiply,
    cross_twist,
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
from dqcontrol.limits.position_limit import FIXED


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
