"""The inputs that give the end effector a twist [ω ; ṗ]: what every law of the whole pose ends in.

Solved at the end effector, in the measure |[ℓω ; ṗ]|, so that nothing depends on where the inertial frame is.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import position, rotated
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import counted, pose_error
from dqcontrol.laws.inverses import BY_MANIPULABILITY, DAMPED, finite, inverse_parameters, solve, solver_work
from dqcontrol.laws.least_norm import least_norm
from dqcontrol.robots.kinematics.kinematics_kernels import hand_jacobian


class TwistWork(NamedTuple):
    """What it takes to solve for n inputs."""

    matrix: Annotated[Array, 6, "n"]
    twist: Annotated[Array, 6]
    solver: Annotated[Array, solver_work.size()]


twist_work: MemoryLayout[TwistWork] = MemoryLayout(TwistWork, "n")


@inline
def weigh(row, y, i, length):
    """Let a row of ω, and what is asked for it, count in metres."""
    for c in range(row.shape[0]):
        row[c] *= length
    y[i] *= length


@inline
def solve_hand_twist(pose, twist_jacobian, hand_twist, error, preferred, inverse_numbers, work, out):
    """Write out = z + J⁺ (t − J z) for the end effector's twist t = [ω ; ṗ], inertial axes, in the measure |[ℓω ; ṗ]|.

    The error [θ ; p_d − p] that t feeds back says how far damping grows. Where J has full row rank the measure does not
    matter: one 6 × 6 system in straight lines, for all laws.
    """
    inverse = inverse_parameters(inverse_numbers)
    n = twist_jacobian.shape[1]
    p = position(pose)
    px, py, pz = p
    missing = counted(error, inverse.share)
    square_length = inverse.length * inverse.length
    if n >= 6 and inverse.kind != BY_MANIPULABILITY:
        square_level, vanishing = inverse.level * inverse.level, inverse.damping * inverse.damping
        damped = 1.0 if inverse.kind == DAMPED else 0.0
        limit, damping = (1.0 - damped) * square_level, damped * square_level
        if least_norm(
            twist_jacobian,
            px,
            py,
            pz,
            hand_twist,
            preferred,
            missing,
            inverse.growth,
            square_length,
            limit,
            vanishing,
            damping,
            out,
        ):
            return finite(out)
    own = twist_work(work, n)
    hand_jacobian(p, twist_jacobian, own.matrix)
    for i in range(6):
        own.twist[i] = hand_twist[i]
    for i in range(3):
        weigh(own.matrix[i], own.twist, i, inverse.length)
    needs = twist_jacobian, p, missing, square_length
    return solve(own.matrix, own.twist, preferred, needs, inverse_numbers, own.solver, out)


@inline
def twist_at_end_effector(twist, pose):
    """Return the end effector's [ω ; ṗ] of an inertial twist ξ = ω + εv: ṗ = v + ω × p."""
    px, py, pz = position(pose)
    a, b, c = twist[0], twist[1], twist[2]
    return a, b, c, twist[3] + b * pz - c * py, twist[4] + c * px - a * pz, twist[5] + a * py - b * px


@inline
def in_inertial_axes(body_twist, pose):
    """Return the end effector's [ω ; ṗ] of a body twist, which is that in the end effector's axes."""
    ax, ay, az = rotated(pose, (body_twist[0], body_twist[1], body_twist[2]))
    bx, by, bz = rotated(pose, (body_twist[3], body_twist[4], body_twist[5]))
    return ax, ay, az, bx, by, bz


@inline
def solve_left_twist(
    body_twist, tracking, pose, twist_jacobian, sample, desired, preferred, inverse, work, out
):
    """Write out = z + J⁺ (t − J z) for a body twist, and the desired one, inertial, unless ``tracking`` is 0."""
    a, b, c, d, e, f = in_inertial_axes(body_twist, pose)
    if tracking != 0.0:
        u, v, w, x, y, z = twist_at_end_effector(desired, pose)
        a, b, c, d, e, f = a + u, b + v, c + w, d + x, e + y, f + z
    error = pose_error(pose, sample)
    return solve_hand_twist(pose, twist_jacobian, (a, b, c, d, e, f), error, preferred, inverse, work, out)
