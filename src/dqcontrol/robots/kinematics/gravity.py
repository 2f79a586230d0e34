"""Gravity torque of a chain or a tree, compiled.

A body table has a row ``[mass, centre (3)]`` (kg, m) for each joint: the body that the joint moves, in the
joint's frame after its screw.
"""

from __future__ import annotations

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
    shared,
)
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.robots.kinematics import kinematics_kernels as chains
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS, COORDINATE, MULTIPLIER, OFFSET, PARENT

GRAVITY_FORCES = STATUS(READ2, READ2, READ, READ, WRITE, WRITE)

WORK = 18  # numbers for each joint; trees need 11


@inline
def gravity_torque(chain, bodies, q, gravity, out, work):
    """Write the n torques τ_g = ∂U/∂q that hold the arm still; gravity (3,) is in the base frame, work is (WORK n,).

    With M and S the mass and first moment of all bodies from joint i on, and o, z its origin and axis:
    τ_i = −g · (z × (S − M o)), or −M g · z if prismatic. On the way out S is what all bodies have, not known yet, less
    that of the bodies before; so τ_i lacks S_all · (z × g), added at the end.
    """
    n = chain.shape[0] - 1
    if q.shape[0] != n or bodies.shape[0] != n or out.shape[0] != n:
        return WRONG_SIZE
    gx, gy, gz = gravity[0], gravity[1], gravity[2]
    cosines, check = chains.halves(q, work)
    levers = as_matrix(work[3 * n + 9 : 6 * n + 9], n, 3)  # z × g
    mass, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        mass += bodies[i, 0]
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, chain[i])
        zx, zy, zz = chains.z_axis(w, x, y, z)
        if chain[i, 7] != chains.REVOLUTE:
            lx, ly, lz = 0.0, 0.0, 0.0
            out[i] = -mass * (gx * zx + gy * zy + gz * zz)
        else:
            lx, ly, lz = zy * gz - zz * gy, zz * gx - zx * gz, zx * gy - zy * gx
            out[i] = -(lx * (sx + mass * px) + ly * (sy + mass * py) + lz * (sz + mass * pz))
        levers[i, 0], levers[i, 1], levers[i, 2] = lx, ly, lz
        sine, cosine = work[i], cosines[i]
        w, x, y, z, px, py, pz = chains.move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, chain[i, 7], q[i], sine, cosine
        )
        m, cx, cy, cz = bodies[i, 0], bodies[i, 1], bodies[i, 2], bodies[i, 3]
        tx, ty, tz = 2.0 * (y * cz - z * cy), 2.0 * (z * cx - x * cz), 2.0 * (x * cy - y * cx)
        mass -= m
        sx += m * (px + cx + w * tx + y * tz - z * ty)
        sy += m * (py + cy + w * ty + z * tx - x * tz)
        sz += m * (pz + cz + w * tz + x * ty - y * tx)
    for i in range(n):
        out[i] += levers[i, 0] * sx + levers[i, 1] * sy + levers[i, 2] * sz
    return OK if check == 0.0 else NOT_FINITE


@shared
def tree_gravity_torque(tree, bodies, q, gravity, out, work):
    """Write the n torques τ_g = ∂U/∂q that hold a tree still; work is (WORK N,) for N joints.

    The tree is a table as in `pose_task_kernels`, its first row and those of its joints. From the last joint to the
    first, each adds mass and first moment of what it carries to its parent's.
    """
    joints = tree.shape[0] - 1
    if bodies.shape[0] != joints or q.shape[0] != out.shape[0] or tree.shape[1] != COLUMNS:
        return WRONG_SIZE
    gx, gy, gz = gravity[0], gravity[1], gravity[2]
    placed = as_matrix(work[0 : 7 * joints], joints, 7)
    carried = as_matrix(work[7 * joints : 11 * joints], joints, 4)  # mass and first moment
    check = 0.0
    for i in range(joints):
        row, parent = tree[i + 1], int(tree[i + 1, PARENT])
        w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        if parent >= 0:
            at = placed[parent]
            w, x, y, z, px, py, pz = at[0], at[1], at[2], at[3], at[4], at[5], at[6]
        angle = row[MULTIPLIER] * q[int(row[COORDINATE])] + row[OFFSET]
        check += 0.0 * angle
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, row)
        w, x, y, z, px, py, pz = chains.moved(w, x, y, z, px, py, pz, row[7], angle)
        at = placed[i]
        at[0], at[1], at[2], at[3], at[4], at[5], at[6] = w, x, y, z, px, py, pz
        m, cx, cy, cz = bodies[i, 0], bodies[i, 1], bodies[i, 2], bodies[i, 3]
        tx, ty, tz = 2.0 * (y * cz - z * cy), 2.0 * (z * cx - x * cz), 2.0 * (x * cy - y * cx)
        carried[i, 0] = m
        carried[i, 1] = m * (px + cx + w * tx + y * tz - z * ty)
        carried[i, 2] = m * (py + cy + w * ty + z * tx - x * tz)
        carried[i, 3] = m * (pz + cz + w * tz + x * ty - y * tx)
    for i in range(out.shape[0]):
        out[i] = 0.0
    for i in range(joints - 1, -1, -1):
        row, parent, at = tree[i + 1], int(tree[i + 1, PARENT]), placed[i]
        m, sx, sy, sz = carried[i, 0], carried[i, 1], carried[i, 2], carried[i, 3]
        zx, zy, zz = chains.z_axis(at[0], at[1], at[2], at[3])
        lift = m * (gx * zx + gy * zy + gz * zz)
        if row[7] == chains.REVOLUTE:
            lx, ly, lz = sx - m * at[4], sy - m * at[5], sz - m * at[6]
            lift = gx * (zy * lz - zz * ly) + gy * (zz * lx - zx * lz) + gz * (zx * ly - zy * lx)
        out[int(row[COORDINATE])] -= row[MULTIPLIER] * lift
        if parent >= 0:
            for k in range(4):
                carried[parent, k] += carried[i, k]
    return OK if check == 0.0 else NOT_FINITE


@inline
def robot_gravity_torque(table, bodies, q, gravity, out, work):
    """Write the gravity torque of a chain, whose table has 8 columns, or of a tree."""
    if table.shape[1] == COLUMNS:
        return tree_gravity_torque(table, bodies, q, gravity, out, work)
    return gravity_torque(table, bodies, q, gravity, out, work)


@kernel(GRAVITY_FORCES)
def gravity_forces(table, bodies, q, gravity, out, work):
    """Write the gravity torque of a chain or a tree at one configuration."""
    return robot_gravity_torque(table, bodies, q, gravity, out, work)


@kernel(STATUS(READ2, READ2, READ2, READ, WRITE2, WRITE))
def gravity_torques(table, bodies, q, gravity, out, work):
    """Write the gravity torque of a chain or a tree for every row of q; stop at the first that fails."""
    for i in range(q.shape[0]):
        status = robot_gravity_torque(table, bodies, q[i], gravity, out[i], work)
        if status != OK:
            return status
    return OK
