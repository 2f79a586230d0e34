"""Forward kinematics of a chain, its Jacobians and their rates, compiled.

A chain of n coordinates is a table of n + 1 rows ``[r (4), p (3), kind]``: a fixed pose (unit quaternion and position),
then a screw about its z axis, revolute (kind 0) or prismatic (the other kinds). The last row is the tool; in place of a
kind it has the number of coordinates without an input of their own, n − m. Jacobians have a column for each of the m
inputs.

A differential drive has three rows, x, y and φ. Its inputs are v and ω: x has kind 2, a slide whose input v moves
the base along its heading, (ẋ, ẏ) = v (cos φ, sin φ), and y has kind 3, a slide without input. The x axis of the frame
of x is the z axis of the frame of y. [S17 4.21]
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dqcontrol.algebra.dual_quaternion_kernels import half_twist_product, position, set_pose
from dqcontrol.compiled.compile import (
    INPUT,
    NOT_FINITE,
    OK,
    READ2,
    STATUS,
    WRITE,
    WRITE2,
    WRONG_SIZE,
    inline,
    kernel,
)
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix, as_row, caller
from dqcontrol.robots.kinematics.sin_cos import FARTHEST, sine_cosine, sines_cosines

REVOLUTE, PRISMATIC, HEADING, SIDEWAYS = 0.0, 1.0, 2.0, 3.0

CHAIN = STATUS(READ2, INPUT, WRITE)
RATES = STATUS(READ2, INPUT, INPUT, WRITE)

call_chain: Callable[..., Any] = caller(CHAIN)
_call_rates: Callable[..., Any] = caller(RATES)


@inline
def compose_fixed(w, x, y, z, px, py, pz, row):
    """Compose a frame with the fixed pose of a table row."""
    fw, fx, fy, fz, tx, ty, tz = row[0], row[1], row[2], row[3], row[4], row[5], row[6]
    cx = 2.0 * (y * tz - z * ty)
    cy = 2.0 * (z * tx - x * tz)
    cz = 2.0 * (x * ty - y * tx)
    px += tx + w * cx + y * cz - z * cy
    py += ty + w * cy + z * cx - x * cz
    pz += tz + w * cz + x * cy - y * cx
    return (
        w * fw - x * fx - y * fy - z * fz,
        w * fx + x * fw + y * fz - z * fy,
        w * fy - x * fz + y * fw + z * fx,
        w * fz + x * fy - y * fx + z * fw,
        px,
        py,
        pz,
    )


@inline
def z_axis(w, x, y, z):
    """Return the z axis of a frame."""
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@inline
def half_sine_cosine(angle):
    """Return sin and cos of half an angle."""
    half = 0.5 * angle
    return sine_cosine(half) if abs(half) <= FARTHEST else (math.sin(half), math.cos(half))


@inline
def move_joint(w, x, y, z, px, py, pz, zx, zy, zz, kind, angle, sine, cosine):
    """Move a frame along or about its z axis, given sine and cosine of half the angle."""
    if kind != REVOLUTE:
        return w, x, y, z, px + zx * angle, py + zy * angle, pz + zz * angle
    return (
        w * cosine - z * sine,
        x * cosine + y * sine,
        y * cosine - x * sine,
        z * cosine + w * sine,
        px,
        py,
        pz,
    )


@inline
def moved(w, x, y, z, px, py, pz, kind, angle):
    """Return a frame after a screw about its z axis."""
    zx, zy, zz = z_axis(w, x, y, z)
    sine, cosine = half_sine_cosine(angle)
    return move_joint(w, x, y, z, px, py, pz, zx, zy, zz, kind, angle, sine, cosine)


@inline
def halves(q, workspace):
    """Write sines, then cosines, of all half angles; return the cosines, and NaN unless q is finite."""
    n = q.shape[0]
    padded = (n + 3) // 4 * 4 if n > 3 else n  # three times this fits into a pose Jacobian
    check, farthest = 0.0, 0.0
    cosines, half = as_row(workspace, padded, padded), as_row(workspace, 2 * padded, padded)
    for i in range(n):
        half[i] = 0.5 * q[i]
        check += 0.0 * q[i]
        farthest = max(farthest, abs(half[i]))
    for i in range(n, padded):
        half[i] = 0.0
    if farthest <= FARTHEST:
        sines_cosines(half, padded, workspace)
    else:
        for i in range(n):
            workspace[i], cosines[i] = math.sin(half[i]), math.cos(half[i])
    return cosines, check


@inline
def heading_axis(w, x, y, z, zx, zy, zz, angle):
    """Return the heading of a base in the frame of its x: z cos φ + x sin φ."""
    c, s = math.cos(angle), math.sin(angle)
    return (
        c * zx + s * (1.0 - 2.0 * (y * y + z * z)),
        c * zy + s * 2.0 * (x * y + w * z),
        c * zz + s * 2.0 * (x * z - w * y),
    )


@inline
def joint_frames(chain, q, out):
    """Write the end pose (8), or with more room all joint frames after their screws and the end pose (8 (n + 1))."""
    n = chain.shape[0] - 1
    if q.shape[0] != n:
        return WRONG_SIZE
    every = out.shape[0] > 8
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    check = 0.0
    for i in range(n):
        angle = q[i]
        check += 0.0 * angle
        w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[i])
        w, x, y, z, px, py, pz = moved(w, x, y, z, px, py, pz, chain[i, 7], angle)
        if every:
            set_pose((w, x, y, z), (px, py, pz), out[8 * i : 8 * i + 8])
    w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[n])
    set_pose((w, x, y, z), (px, py, pz), out[out.shape[0] - 8 :])
    return OK if check == 0.0 else NOT_FINITE


@kernel(CHAIN)
def forward(chain, q, out):
    """Write what `joint_frames` does."""
    return joint_frames(chain, q, out)


@inline
def _twist_kinematics(chain, q, pose, twist_jacobian, workspace):
    """Write end pose and twist Jacobian; the workspace has the size of a pose Jacobian."""
    n = chain.shape[0] - 1
    m = n - int(chain[n, 7])
    if q.shape[0] != n or twist_jacobian.shape[1] != m:
        return WRONG_SIZE
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    cosines, check = halves(q, workspace)
    j = 0
    for i in range(n):
        w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[i])
        zx, zy, zz = z_axis(w, x, y, z)
        kind = chain[i, 7]
        if kind == REVOLUTE:
            twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j] = zx, zy, zz
            twist_jacobian[3, j] = py * zz - pz * zy
            twist_jacobian[4, j] = pz * zx - px * zz
            twist_jacobian[5, j] = px * zy - py * zx
        else:
            twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j] = 0.0, 0.0, 0.0
            twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j] = zx, zy, zz
            if kind == HEADING:
                hx, hy, hz = heading_axis(w, x, y, z, zx, zy, zz, q[i + 2])
                twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j] = hx, hy, hz
            elif kind == SIDEWAYS:
                j -= 1  # the column of φ takes its place
        j += 1
        sine, cosine = workspace[i], cosines[i]
        w, x, y, z, px, py, pz = move_joint(w, x, y, z, px, py, pz, zx, zy, zz, kind, q[i], sine, cosine)
    w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[n])
    set_pose((w, x, y, z), (px, py, pz), pose)
    return OK if check == 0.0 else NOT_FINITE


@inline
def fill_pose_jacobian(pose, twist_jacobian, out):
    """Write the pose Jacobian: column i is ½ξᵢx, ξᵢ that of the twist Jacobian."""
    w, x, y, z = 0.5 * pose[0], 0.5 * pose[1], 0.5 * pose[2], 0.5 * pose[3]
    dw, dx, dy, dz = 0.5 * pose[4], 0.5 * pose[5], 0.5 * pose[6], 0.5 * pose[7]
    for i in range(out.shape[1]):
        a, b, c = twist_jacobian[0, i], twist_jacobian[1, i], twist_jacobian[2, i]
        d, e, f = twist_jacobian[3, i], twist_jacobian[4, i], twist_jacobian[5, i]
        out[0, i] = -a * x - b * y - c * z
        out[1, i] = a * w + b * z - c * y
        out[2, i] = b * w + c * x - a * z
        out[3, i] = c * w + a * y - b * x
        out[4, i] = -a * dx - b * dy - c * dz - d * x - e * y - f * z
        out[5, i] = a * dw + b * dz - c * dy + d * w + e * z - f * y
        out[6, i] = b * dw + c * dx - a * dz + e * w + f * x - d * z
        out[7, i] = c * dw + a * dy - b * dx + f * w + d * y - e * x


@inline
def all_kinematics(chain, q, pose, pose_jacobian, twist_jacobian):
    """Write end pose and both Jacobians."""
    m = twist_jacobian.shape[1]
    if pose_jacobian.shape[1] != m:
        return WRONG_SIZE
    status = _twist_kinematics(chain, q, pose, twist_jacobian, as_matrix(pose_jacobian, 1, 8 * m)[0])
    fill_pose_jacobian(pose, twist_jacobian, pose_jacobian)
    return status


@inline
def split(out):
    """Return the parts of a row as `kinematics` writes it: pose (8), pose Jacobian (8 × m), twist Jacobian (6 × m)."""
    m = (out.shape[0] - 8) // 14
    return (
        as_row(out, 0, 8),
        as_matrix(as_row(out, 8, 8 * m), 8, m),
        as_matrix(as_row(out, 8 + 8 * m, 6 * m), 6, m),
    )


@kernel(CHAIN)
def kinematics(chain, q, out):
    """Write the end pose (8), the pose Jacobian (8 × m) and the twist Jacobian (6 × m), one after the other."""
    pose, pose_jacobian, twist_jacobian = split(out)
    return all_kinematics(chain, q, pose, pose_jacobian, twist_jacobian)


@kernel(CHAIN)
def twist_kinematics(chain, q, out):
    """Write what `kinematics` does; the block of the pose Jacobian is scratch and undefined afterwards."""
    pose, pose_jacobian, twist_jacobian = split(out)
    workspace = as_matrix(pose_jacobian, 1, 8 * pose_jacobian.shape[1])[0]
    return _twist_kinematics(chain, q, pose, twist_jacobian, workspace)


@kernel(CHAIN)
def given(chain, q, out):
    """Leave what was found before."""
    return OK


@kernel(STATUS(READ2, INPUT, WRITE, WRITE2, WRITE2))
def kinematics_apart(chain, q, pose, pose_jacobian, twist_jacobian):
    """Write `kinematics` into three arrays."""
    return all_kinematics(chain, q, pose, pose_jacobian, twist_jacobian)


@inline
def hand_jacobian(position, twist_jacobian, out):
    """Write the Jacobian (6 × m) of [ω ; ṗ]: the twist Jacobian moved to the end effector's position."""
    # One loop: with the rows of ṗ in a kernel of their own the last bits are others, and S17's law [3.13] is chaotic.
    px, py, pz = position
    for c in range(twist_jacobian.shape[1]):
        x, y, z = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        out[0, c], out[1, c], out[2, c] = x, y, z
        out[3, c] = twist_jacobian[3, c] - (py * z - pz * y)
        out[4, c] = twist_jacobian[4, c] - (pz * x - px * z)
        out[5, c] = twist_jacobian[5, c] - (px * y - py * x)


@kernel(CHAIN)
def hand_kinematics(chain, q, out):
    """Write the end pose (8), the pose Jacobian (8 × m) and the Jacobian (6 × m) of the end effector's [ω ; ṗ]."""
    pose, pose_jacobian, jacobian = split(out)
    status = all_kinematics(chain, q, pose, pose_jacobian, jacobian)
    hand_jacobian(position(pose), jacobian, jacobian)
    return status


@kernel(STATUS(ADDRESS, READ2, READ2, WRITE2))
def batch(function, chain, q, out):
    """Call a chain function for every row of q; stop at the first that fails."""
    for i in range(q.shape[0]):
        status = call_chain(function, chain, q[i], out[i])
        if status != OK:
            return status
    return OK


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


@kernel(STATUS(ADDRESS, READ2, READ2, READ2, WRITE2))
def batch_rates(function, chain, q, speed, out):
    """Call `jacobian_rates` for every row; stop at the first that fails."""
    for i in range(q.shape[0]):
        status = _call_rates(function, chain, q[i], speed[i], out[i])
        if status != OK:
            return status
    return OK
