"""Mass matrix and joint forces of chains and trees, compiled.

Of each joint a row `RigidBody`, parents first. All vectors have the axes of the base and are taken about its origin: a
twist is (ω, v) with v the speed of the point that is there now, a screw z + ε(p × z) as in the twist Jacobian, a
wrench (m, f). So what bodies hand to their parents is a sum, without a change of frame. Formulas: Featherstone,
*Rigid Body Dynamics Algorithms*, 2008, tables 5.1 (recursive Newton-Euler) and 6.2 (composite rigid body).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import (
    NOT_FINITE,
    OK,
    READ,
    READ2,
    STATUS,
    WRITE,
    WRITE2,
    WRONG_SIZE,
    inline,
    kernel,
)
from dqcontrol.compiled.intrinsics import as_matrix, as_row
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.kinematics.kinematics_kernels import REVOLUTE, compose_fixed, move_joint, z_axis
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS, COORDINATE, MULTIPLIER, OFFSET, PARENT
from dqcontrol.robots.kinematics.sin_cos import FARTHEST, sines_cosines

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


class RigidBody(NamedTuple):
    """A joint and the body that it moves.

    Attributes
    ----------
    pose
        Fixed, of the joint's frame before its screw in its parent's: [r (4), p (3)].
    kind
        Of the screw about or along the z axis, as in ``kinematics_kernels``; of bases all are slides and turns here.
    coordinate, multiplier, offset
        The screw moves by multiplier · q[coordinate] + offset.
    parent
        Row of the joint that carries it; −1: the base.
    mass, center
        kg and m, in the joint's frame after its screw.
    tensor
        Inertia about the centre in the same axes: xx, yy, zz, xy, xz, yz, kg m².
    """

    pose: Annotated[Array, 7]
    kind: float
    coordinate: float
    multiplier: float
    offset: float
    parent: float
    mass: float
    center: Annotated[Array, 3]
    tensor: Annotated[Array, 6]


_body = MemoryLayout(RigidBody, unchecked=True)

# numbers a joint: pose and screw; composite; twist and its rate
MOVED, _INERTIA, RATES, _WRENCH = 13, 10, 12, 6


def rigid_bodies(robot: Robot) -> Array:
    """Return the table of a robot with inertias, a row `RigidBody` a joint."""
    bodies, table = robot.inertia, robot.inertia_chain
    assert bodies is not None
    count = len(bodies.mass)
    if table.shape[1] == COLUMNS:
        joints = table[1 : count + 1]
        columns = [joints[:, at] for at in (COORDINATE, MULTIPLIER, OFFSET, PARENT)]
    else:
        joints, index = table[:count], np.arange(count, dtype=np.float64)
        columns = [index, np.ones(count), np.zeros(count), index - 1.0]
    return _body.pack(
        pose=joints[:, :7],
        kind=joints[:, 7],
        **dict(zip(("coordinate", "multiplier", "offset", "parent"), columns, strict=True)),
        mass=bodies.mass,
        center=bodies.center,
        tensor=np.stack(
            [bodies.tensor[:, i, k] for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=-1
        ),
    )


def work_size(count: int) -> int:
    """Return the scratch that the functions below need for so many joints."""
    padded = (count + 3) // 4 * 4
    return 3 * padded + (MOVED + RATES + _WRENCH) * count


@inline
def place_bodies(bodies, q, moved, halves):
    """Write pose (7) and screw (6) of each joint; return 0, or NaN unless q is finite."""
    count = bodies.shape[0]
    padded = (count + 3) // 4 * 4
    half, farthest, check = as_row(halves, 2 * padded, padded), 0.0, 0.0
    for i in range(padded):
        half[i] = 0.0
    for i in range(count):
        angle = bodies[i, 9] * q[int(bodies[i, 8])] + bodies[i, 10]
        half[i] = 0.5 * angle
        check += 0.0 * angle
        farthest = max(farthest, abs(half[i]))
    if farthest <= FARTHEST:
        sines_cosines(half, padded, halves)
    else:
        for i in range(count):
            halves[i], halves[padded + i] = math.sin(half[i]), math.cos(half[i])
    for i in range(count):
        row, parent, angle = bodies[i], int(bodies[i, 11]), 2.0 * half[i]
        w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if parent >= 0:
            at = moved[parent]
            w, x, y, z, px, py, pz = at[0], at[1], at[2], at[3], at[4], at[5], at[6]
        w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, row)
        zx, zy, zz = z_axis(w, x, y, z)
        w, x, y, z, px, py, pz = move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, row[7], angle, halves[i], halves[padded + i]
        )
        at = moved[i]
        at[0], at[1], at[2], at[3], at[4], at[5], at[6] = w, x, y, z, px, py, pz
        if row[7] == REVOLUTE:
            at[7], at[8], at[9] = zx, zy, zz
            at[10], at[11], at[12] = py * zz - pz * zy, pz * zx - px * zz, px * zy - py * zx
        else:
            at[7], at[8], at[9] = 0.0, 0.0, 0.0
            at[10], at[11], at[12] = zx, zy, zz
    return check


@inline
def _axes(at):
    """Return the rotation matrix of a pose, row by row."""
    w, x, y, z = at[0], at[1], at[2], at[3]
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@inline
def fill_mass_matrix(bodies, q, out, work):
    """Write the mass matrix (n, n), by composite rigid bodies."""
    count, n = bodies.shape[0], out.shape[0]
    if q.shape[0] != n or out.shape[1] != n:
        return WRONG_SIZE
    padded = (count + 3) // 4 * 4
    moved = as_matrix(as_row(work, 3 * padded, MOVED * count), count, MOVED)
    composite = as_matrix(as_row(work, 3 * padded + MOVED * count, _INERTIA * count), count, _INERTIA)
    check = place_bodies(bodies, q, moved, work)
    for i in range(count):
        body, at = _body(bodies[i]), moved[i]
        a, b, c, d, e, f, g, h, k = _axes(at)
        m, center, tensor = body.mass, body.center, body.tensor
        x = at[4] + a * center[0] + b * center[1] + c * center[2]
        y = at[5] + d * center[0] + e * center[1] + f * center[2]
        z = at[6] + g * center[0] + h * center[1] + k * center[2]
        xx, yy, zz, xy, xz, yz = tensor[0], tensor[1], tensor[2], tensor[3], tensor[4], tensor[5]
        ax, ay, az = a * xx + b * xy + c * xz, a * xy + b * yy + c * yz, a * xz + b * yz + c * zz
        dx, dy, dz = d * xx + e * xy + f * xz, d * xy + e * yy + f * yz, d * xz + e * yz + f * zz
        gx, gy, gz = g * xx + h * xy + k * xz, g * xy + h * yy + k * yz, g * xz + h * yz + k * zz
        own = composite[i]
        own[0], own[1], own[2], own[3] = m, m * x, m * y, m * z
        own[4] = ax * a + ay * b + az * c + m * (y * y + z * z)
        own[5] = dx * d + dy * e + dz * f + m * (x * x + z * z)
        own[6] = gx * g + gy * h + gz * k + m * (x * x + y * y)
        own[7] = ax * d + ay * e + az * f - m * x * y
        own[8] = ax * g + ay * h + az * k - m * x * z
        own[9] = dx * g + dy * h + dz * k - m * y * z
    for i in range(n):
        for j in range(n):
            out[i, j] = 0.0
    for i in range(count - 1, -1, -1):
        parent, at, own = int(bodies[i, 11]), moved[i], composite[i]
        m, sx, sy, sz = own[0], own[1], own[2], own[3]
        wx, wy, wz, vx, vy, vz = at[7], at[8], at[9], at[10], at[11], at[12]
        fx = m * vx + wy * sz - wz * sy
        fy = m * vy + wz * sx - wx * sz
        fz = m * vz + wx * sy - wy * sx
        nx = own[4] * wx + own[7] * wy + own[8] * wz + sy * vz - sz * vy
        ny = own[7] * wx + own[5] * wy + own[9] * wz + sz * vx - sx * vz
        nz = own[8] * wx + own[9] * wy + own[6] * wz + sx * vy - sy * vx
        scale, column = bodies[i, 9], int(bodies[i, 8])
        out[column, column] += scale * scale * (wx * nx + wy * ny + wz * nz + vx * fx + vy * fy + vz * fz)
        j = parent
        while j >= 0:
            to = moved[j]
            shared = to[7] * nx + to[8] * ny + to[9] * nz + to[10] * fx + to[11] * fy + to[12] * fz
            shared *= scale * bodies[j, 9]
            row = int(bodies[j, 8])
            out[row, column] += shared
            out[column, row] += shared
            j = int(bodies[j, 11])
        if parent >= 0:
            for k in range(_INERTIA):
                composite[parent, k] += own[k]
    return OK if check == 0.0 else NOT_FINITE


@inline
def fill_joint_forces(bodies, q, rates, accelerations, gravity, out, work):
    """Write the joint forces (n,) of a motion, M q̈ + C q̇ + g, by recursive Newton-Euler.

    Without accelerations, an empty array, what is left is the bias C q̇ + g.
    """
    count, n = bodies.shape[0], out.shape[0]
    if q.shape[0] != n or rates.shape[0] != n:
        return WRONG_SIZE
    accelerated = accelerations.shape[0] == n
    padded = (count + 3) // 4 * 4
    moved = as_matrix(as_row(work, 3 * padded, MOVED * count), count, MOVED)
    speeds = as_matrix(as_row(work, 3 * padded + MOVED * count, RATES * count), count, RATES)
    place = 3 * padded + (MOVED + RATES) * count
    wrenches = as_matrix(as_row(work, place, _WRENCH * count), count, _WRENCH)
    check = place_bodies(bodies, q, moved, work)
    for i in range(n):
        check += 0.0 * rates[i]
        out[i] = 0.0
    for i in range(count):
        body, at, own, parent = _body(bodies[i]), moved[i], speeds[i], int(bodies[i, 11])
        wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, -gravity[0], -gravity[1], -gravity[2]
        if parent >= 0:
            to = speeds[parent]
            wx, wy, wz, vx, vy, vz = to[0], to[1], to[2], to[3], to[4], to[5]
            ax, ay, az, bx, by, bz = to[6], to[7], to[8], to[9], to[10], to[11]
        column, rate, more = int(body.coordinate), 0.0, 0.0
        rate = body.multiplier * rates[column]
        if accelerated:
            more = body.multiplier * accelerations[column]
        sx, sy, sz, tx, ty, tz = at[7], at[8], at[9], at[10], at[11], at[12]
        ax += sx * more + (wy * sz - wz * sy) * rate
        ay += sy * more + (wz * sx - wx * sz) * rate
        az += sz * more + (wx * sy - wy * sx) * rate
        bx += tx * more + (wy * tz - wz * ty + vy * sz - vz * sy) * rate
        by += ty * more + (wz * tx - wx * tz + vz * sx - vx * sz) * rate
        bz += tz * more + (wx * ty - wy * tx + vx * sy - vy * sx) * rate
        wx, wy, wz = wx + sx * rate, wy + sy * rate, wz + sz * rate
        vx, vy, vz = vx + tx * rate, vy + ty * rate, vz + tz * rate
        own[0], own[1], own[2], own[3], own[4], own[5] = wx, wy, wz, vx, vy, vz
        own[6], own[7], own[8], own[9], own[10], own[11] = ax, ay, az, bx, by, bz
        a, b, c, d, e, f, g, h, k = _axes(at)
        m, center, tensor = body.mass, body.center, body.tensor
        x = at[4] + a * center[0] + b * center[1] + c * center[2]
        y = at[5] + d * center[0] + e * center[1] + f * center[2]
        z = at[6] + g * center[0] + h * center[1] + k * center[2]
        ux, uy, uz = vx + wy * z - wz * y, vy + wz * x - wx * z, vz + wx * y - wy * x  # of the centre
        fx = m * (bx + ay * z - az * y + wy * uz - wz * uy)
        fy = m * (by + az * x - ax * z + wz * ux - wx * uz)
        fz = m * (bz + ax * y - ay * x + wx * uy - wy * ux)
        p, q1, r = a * wx + d * wy + g * wz, b * wx + e * wy + h * wz, c * wx + f * wy + k * wz
        s, t, u = a * ax + d * ay + g * az, b * ax + e * ay + h * az, c * ax + f * ay + k * az
        xx, yy, zz, xy, xz, yz = tensor[0], tensor[1], tensor[2], tensor[3], tensor[4], tensor[5]
        lx, ly, lz = xx * p + xy * q1 + xz * r, xy * p + yy * q1 + yz * r, xz * p + yz * q1 + zz * r
        nx = xx * s + xy * t + xz * u + q1 * lz - r * ly
        ny = xy * s + yy * t + yz * u + r * lx - p * lz
        nz = xz * s + yz * t + zz * u + p * ly - q1 * lx
        wrench = wrenches[i]
        wrench[0] = a * nx + b * ny + c * nz + y * fz - z * fy
        wrench[1] = d * nx + e * ny + f * nz + z * fx - x * fz
        wrench[2] = g * nx + h * ny + k * nz + x * fy - y * fx
        wrench[3], wrench[4], wrench[5] = fx, fy, fz
    for i in range(count - 1, -1, -1):
        at, wrench, parent = moved[i], wrenches[i], int(bodies[i, 11])
        total = 0.0
        for k in range(6):
            total += at[7 + k] * wrench[k]
        out[int(bodies[i, 8])] += bodies[i, 9] * total
        if parent >= 0:
            for k in range(6):
                wrenches[parent, k] += wrench[k]
    return OK if check == 0.0 else NOT_FINITE


@kernel(STATUS(READ2, READ, WRITE2, WRITE))
def mass_matrix(bodies, q, out, work):
    """Write the mass matrix (n, n) at one configuration."""
    return fill_mass_matrix(bodies, q, out, work)


@kernel(STATUS(READ2, READ, READ, READ, WRITE, WRITE))
def bias_force(bodies, q, rates, gravity, out, work):
    """Write the bias forces (n,) at one configuration and its rates."""
    return fill_joint_forces(bodies, q, rates, gravity[0:0], gravity, out, work)


@kernel(STATUS(READ2, READ2, WRITE, WRITE))
def mass_matrices(bodies, q, out, work):
    """Write the mass matrix, n² numbers, for every row of q; stop at the first that fails."""
    n = q.shape[1]
    for i in range(q.shape[0]):
        status = fill_mass_matrix(bodies, q[i], as_matrix(as_row(out, i * n * n, n * n), n, n), work)
        if status != OK:
            return status
    return OK


@kernel(STATUS(READ2, READ2, READ2, READ, WRITE, WRITE))
def bias_forces(bodies, q, rates, gravity, out, work):
    """Write the bias forces, n numbers, for every row of q and rates; stop at the first that fails."""
    n = q.shape[1]
    for i in range(q.shape[0]):
        found = as_row(out, i * n, n)
        status = fill_joint_forces(bodies, q[i], rates[i], gravity[0:0], gravity, found, work)
        if status != OK:
            return status
    return OK
