"""The left-invariant pose error 1 − x*x_d and its Jacobian N, shared by the laws that use them."""

from __future__ import annotations

from dqcontrol.algebra.kernels import conjugate_multiply, rotate
from dqcontrol.compile import inlined
from dqcontrol.laws.inverses import ELSEWHERE, solve, solve_pose_rate
from dqcontrol.laws.law import SCRATCH
from dqcontrol.laws.nearest_twist import nearest_twist


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
    """Write out = z + N⁺ (target − N z) with the preferred motion z; target and error are overwritten."""
    n = pose_jacobian.shape[1]
    preferred, scratch, rest = work[0:n], work[n + 32 : n + SCRATCH], work[n + SCRATCH :]
    body_twist, hand_twist, offset = scratch[0:6], scratch[6:12], scratch[12:15]
    for i in range(8):  # N u = −½ξ_b x_e with x_e = 1 − e
        target[i] = -target[i]
        error[i] = -error[i]
    error[0] += 1.0
    rotate(pose, nearest_twist(target, error, body_twist), offset)
    rotate(pose, body_twist[0:3], hand_twist[0:3])
    rotate(pose, body_twist[3:6], hand_twist[3:6])
    d = offset[0], offset[1], offset[2]
    status = solve_pose_rate(pose, twist_jacobian, hand_twist, preferred, d, inverse, rest, out)
    if status != ELSEWHERE:
        return status
    for i in range(8):
        target[i] = -target[i]
    matrix = rest[0 : 8 * n].reshape(8, n)
    error_jacobian(pose_jacobian, desired, sign, matrix)
    return solve(matrix, target, preferred, inverse, rest[8 * n :], out)
