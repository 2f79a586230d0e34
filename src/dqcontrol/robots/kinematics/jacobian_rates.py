"""Rates of a chain's Jacobians as it moves, compiled."""

from __future__ import annotations

from dqcontrol.algebra.dual_quaternion_kernels import half_twist_product
from dqcontrol.compiled.compile import INPUT, NOT_FINITE, OK, READ2, STATUS, WRITE, WRITE2, WRONG_SIZE, kernel
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix, caller
from dqcontrol.robots.kinematics.kinematics_kernels import HEADING, SIDEWAYS, all_kinematics, split

RATES = STATUS(READ2, INPUT, INPUT, WRITE)
BATCH = STATUS(ADDRESS, READ2, READ2, READ2, WRITE2)

_call_rates = caller(RATES)


@kernel(RATES)
def jacobian_rates(chain, q, speed, out):
    """Write what `kinematics` does, then d/dt of the pose Jacobian (8 × m) and of the twist Jacobian (6 × m).

    Column j of dJ_w/dt is ξⱼ × column j, where ξⱼ is the twist of what carries its axis: of the inputs before it, and
    for the v of a drive also of its ω, which turns the heading. Of dJ/dt, with ẋ = ½ξx, it is
    ½(dJ_w/dt)ⱼ x + ½(J_w)ⱼ ẋ.
    """
    n = chain.shape[0] - 1
    m = n - int(chain[n, 7])
    if speed.shape[0] != m or out.shape[0] != 8 + 28 * m:
        return WRONG_SIZE
    pose, pose_jacobian, twist_jacobian = split(out[: 8 + 14 * m])
    status = all_kinematics(chain, q, pose, pose_jacobian, twist_jacobian)
    if status != OK:
        return status
    pose_rate = as_matrix(out[8 + 14 * m : 8 + 22 * m], 8, m)
    twist_rate = as_matrix(out[8 + 22 * m :], 6, m)
    wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    check = 0.0
    j = 0
    for i in range(n):
        kind = chain[i, 7]
        if kind == SIDEWAYS:
            continue
        a, b, c = twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j]
        d, e, f = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
        if kind == HEADING:  # a slide: of the twist that carries it only the rotation counts
            u = speed[j + 1]
            ox = wx + u * twist_jacobian[0, j + 1]
            oy = wy + u * twist_jacobian[1, j + 1]
            oz = wz + u * twist_jacobian[2, j + 1]
        else:
            ox, oy, oz = wx, wy, wz
        twist_rate[0, j] = oy * c - oz * b
        twist_rate[1, j] = oz * a - ox * c
        twist_rate[2, j] = ox * b - oy * a
        twist_rate[3, j] = oy * f - oz * e + vy * c - vz * b
        twist_rate[4, j] = oz * d - ox * f + vz * a - vx * c
        twist_rate[5, j] = ox * e - oy * d + vx * b - vy * a
        u = speed[j]
        check += 0.0 * u
        wx, wy, wz, vx, vy, vz = wx + u * a, wy + u * b, wz + u * c, vx + u * d, vy + u * e, vz + u * f
        j += 1
    w, x, y, z = 0.5 * pose[0], 0.5 * pose[1], 0.5 * pose[2], 0.5 * pose[3]
    dw, dx, dy, dz = 0.5 * pose[4], 0.5 * pose[5], 0.5 * pose[6], 0.5 * pose[7]
    rw, rx, ry, rz, sw, sx, sy, sz = half_twist_product(wx, wy, wz, vx, vy, vz, w, x, y, z, dw, dx, dy, dz)
    rw, rx, ry, rz = 0.5 * rw, 0.5 * rx, 0.5 * ry, 0.5 * rz
    sw, sx, sy, sz = 0.5 * sw, 0.5 * sx, 0.5 * sy, 0.5 * sz
    for j in range(m):
        a, b, c = twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j]
        d, e, f = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
        moved = half_twist_product(a, b, c, d, e, f, rw, rx, ry, rz, sw, sx, sy, sz)
        a, b, c = twist_rate[0, j], twist_rate[1, j], twist_rate[2, j]
        d, e, f = twist_rate[3, j], twist_rate[4, j], twist_rate[5, j]
        turned = half_twist_product(a, b, c, d, e, f, w, x, y, z, dw, dx, dy, dz)
        pose_rate[0, j], pose_rate[1, j] = moved[0] + turned[0], moved[1] + turned[1]
        pose_rate[2, j], pose_rate[3, j] = moved[2] + turned[2], moved[3] + turned[3]
        pose_rate[4, j], pose_rate[5, j] = moved[4] + turned[4], moved[5] + turned[5]
        pose_rate[6, j], pose_rate[7, j] = moved[6] + turned[6], moved[7] + turned[7]
    return OK if check == 0.0 else NOT_FINITE


@kernel(BATCH)
def batch(function, chain, q, speed, out):
    """Call `jacobian_rates` for every row; stop at the first that fails."""
    for i in range(q.shape[0]):
        status = _call_rates(function, chain, q[i], speed[i], out[i])
        if status != OK:
            return status
    return OK
