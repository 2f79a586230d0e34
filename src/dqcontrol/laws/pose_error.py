"""The left-invariant pose error 1 − x*x_d and its Jacobian N, shared by the laws that use them."""

from __future__ import annotations

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, rotated
from dqcontrol.compiled.compile import inlined
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.laws.inverses import ELSEWHERE, solve, solve_pose_rate
from dqcontrol.laws.law import SCRATCH
from dqcontrol.laws.nearest_twist import nearest_twist
from dqcontrol.robots.kinematics_kernels import fill_pose_jacobian


@inlined
def short_sign(real_part, hysteresis, state):
    """Return the sign that takes the short way round, with hysteresis; state[0] remembers it, 0 at the start."""
    if state[0] == 0.0:
        state[0] = 1.0 if real_part >= 0.0 else -1.0
    elif state[0] * real_part < -hysteresis:
        state[0] = -state[0]
    return state[0]


@inlined
def left_error(pose, desired, hysteresis, state, error):
    """Write e = 1 − short(x*x_d) and return the sign given to x_d. [P16 2.23]"""
    conjugate_multiply(pose, desired, error)
    sign = short_sign(error[0], hysteresis, state)
    for i in range(8):
        error[i] = -sign * error[i]
    error[0] += 1.0
    return sign


@inlined
def error_jacobian(pose_jacobian, desired, sign, out):
    """Write N = H⁻(x_d) C8 J (8 × n), so that ė = −N q̇ for a constant x_d. [P16 3.7, S17 4.46]"""
    n = pose_jacobian.shape[1]
    w, x, y, z = sign * desired[0], sign * desired[1], sign * desired[2], sign * desired[3]
    dw, dx, dy, dz = sign * desired[4], sign * desired[5], sign * desired[6], sign * desired[7]
    for i in range(n):
        a, b, c, d = pose_jacobian[0, i], -pose_jacobian[1, i], -pose_jacobian[2, i], -pose_jacobian[3, i]
        e, f, g, h = pose_jacobian[4, i], -pose_jacobian[5, i], -pose_jacobian[6, i], -pose_jacobian[7, i]
        out[0, i] = a * w - b * x - c * y - d * z
        out[1, i] = a * x + b * w + c * z - d * y
        out[2, i] = a * y - b * z + c * w + d * x
        out[3, i] = a * z + b * y - c * x + d * w
        out[4, i] = a * dw - b * dx - c * dy - d * dz + e * w - f * x - g * y - h * z
        out[5, i] = a * dx + b * dw + c * dz - d * dy + e * x + f * w + g * z - h * y
        out[6, i] = a * dy - b * dz + c * dw + d * dx + e * y - f * z + g * w + h * x
        out[7, i] = a * dz + b * dy - c * dx + d * dw + e * z + f * y - g * x + h * w


@inlined
def solve_left_error(target, error, pose, pose_jacobian, twist_jacobian, desired, sign, inverse, work, out):
    """Write out = z + N⁺ (target − N z) with the preferred motion z."""
    n = pose_jacobian.shape[1]
    preferred, rest = work[0:n], work[n + SCRATCH :]
    e = error  # N u = −½ξ_b x_e with x_e = 1 − e
    relative = 1.0 - e[0], -e[1], -e[2], -e[3], -e[4], -e[5], -e[6], -e[7]
    angular, linear, offset = nearest_twist(target, relative)
    ax, ay, az = rotated(pose, angular)
    bx, by, bz = rotated(pose, linear)
    hand_twist, offset = (-ax, -ay, -az, -bx, -by, -bz), rotated(pose, offset)
    status = solve_pose_rate(pose, twist_jacobian, hand_twist, preferred, offset, inverse, rest, out)
    if status != ELSEWHERE:
        return status
    fill_pose_jacobian(pose, twist_jacobian, pose_jacobian)
    matrix = as_matrix(rest[0 : 8 * n], 8, n)
    error_jacobian(pose_jacobian, desired, sign, matrix)
    return solve(matrix, target, preferred, inverse, rest[8 * n :], out)
