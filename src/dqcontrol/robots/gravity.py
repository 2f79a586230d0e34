"""Gravity torque of a chain, compiled.

A body table has a row ``[mass, centre (3)]`` (kg, m) for each joint: the body that the joint moves, in the
joint's frame after its screw.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compile import NOT_FINITE, OK, READ, READ2, STATUS, WRITE2, WRONG_SIZE, inlined, kernel
from dqcontrol.robots.kernels import REVOLUTE, _axis, _fixed, _half, _screw
from dqcontrol.robots.limits import Inertia

BATCH_GRAVITY = STATUS(READ2, READ2, READ2, READ, WRITE2)


def body_table(inertia: Inertia) -> NDArray[np.float64]:
    """Return the body table of an arm, shape (n, 4)."""
    return np.column_stack([inertia.mass, inertia.center])


@inlined
def gravity_torque(chain, bodies, q, gravity, out):
    """Write the n torques τ_g = ∂U/∂q that hold the arm still; gravity (3,) is in the base frame.

    With M and S the mass and first moment of all bodies from joint i on: τ_i = −g · (z × (S − M o)), or
    −M g · z if prismatic. The first pass sums up all bodies, the second takes them off: no scratch memory.
    """
    n = chain.shape[0] - 1
    if q.shape[0] != n or bodies.shape[0] != n or out.shape[0] != n:
        return WRONG_SIZE
    gx, gy, gz = gravity[0], gravity[1], gravity[2]
    mass, sx, sy, sz = 0.0, 0.0, 0.0, 0.0
    check = 0.0
    for taking in range(2):
        w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            w, x, y, z, px, py, pz = _fixed(w, x, y, z, px, py, pz, chain[i])
            zx, zy, zz = _axis(w, x, y, z)
            if taking:
                if chain[i, 7] != REVOLUTE:
                    out[i] = -mass * (gx * zx + gy * zy + gz * zz)
                else:
                    rx, ry, rz = sx - mass * px, sy - mass * py, sz - mass * pz
                    out[i] = gx * (ry * zz - rz * zy) + gy * (rz * zx - rx * zz) + gz * (rx * zy - ry * zx)
            sine, cosine = _half(q[i])
            w, x, y, z, px, py, pz = _screw(
                w, x, y, z, px, py, pz, zx, zy, zz, chain[i, 7], q[i], sine, cosine
            )
            m, cx, cy, cz = bodies[i, 0], bodies[i, 1], bodies[i, 2], bodies[i, 3]
            tx, ty, tz = 2.0 * (y * cz - z * cy), 2.0 * (z * cx - x * cz), 2.0 * (x * cy - y * cx)
            sign = -m if taking else m
            mass += sign
            sx += sign * (px + cx + w * tx + y * tz - z * ty)
            sy += sign * (py + cy + w * ty + z * tx - x * tz)
            sz += sign * (pz + cz + w * tz + x * ty - y * tx)
            check += 0.0 * q[i]
    return OK if check == 0.0 else NOT_FINITE


@kernel(BATCH_GRAVITY)
def gravity_torques(chain, bodies, q, gravity, out):
    """Write the gravity torque for every row of q; stop at the first that fails."""
    for i in range(q.shape[0]):
        status = gravity_torque(chain, bodies, q[i], gravity, out[i])
        if status != OK:
            return status
    return OK
