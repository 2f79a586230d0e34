"""How a disturbance moves a robot: through its joints, before the plant's own step."""

from __future__ import annotations

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position, rotated
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, Kernel, kernel
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix
from dqcontrol.errors import DivergedError
from dqcontrol.laws.hand_twist import solve_hand_twist
from dqcontrol.laws.inverses import HEAD, FilteredInverse, work_size
from dqcontrol.robots import kinematics_kernels as kernels
from dqcontrol.robots.driving import advance
from dqcontrol.robots.kinematics_kernels import call_chain

# A robot that is pushed knows nothing of the law's weight between angles and positions, nor of its thresholds.
_INVERSE = FilteredInverse(threshold=0.02, damping=0.05, characteristic_length=1.0)
ROW = 12  # of a disturbance: inertial twist, then twist of the hand in its own axes

# kinematics, chain, row, parameters, work, q, realised inertial twist
DISTURBANCE = STATUS(ADDRESS, READ2, READ, READ, WRITE, WRITE, WRITE)


@kernel(DISTURBANCE)
def disturb(kinematics, chain, row, parameters, work, q, realised):
    """Let u = J_h⁺ t act for T with t = [ω ; ṗ] of v_w + Ad(x) w, and write the twist J_w J_h⁺ t that comes of it."""
    n = q.shape[0] - int(chain[q.shape[0], 7])  # inputs
    buffer = work[0 : 8 + 14 * n]
    velocity = work[8 + 14 * n : 8 + 15 * n]
    no_preference = work[8 + 15 * n : 8 + 16 * n]
    hand = work[8 + 16 * n : 14 + 16 * n]
    rest = work[14 + 16 * n :]
    status = call_chain(kinematics, chain, q, buffer)
    if status != OK:
        return status
    twist_jacobian = as_matrix(buffer[8 + 8 * n : 8 + 14 * n], 6, n)
    px, py, pz = position(buffer)
    ax, ay, az = rotated(buffer, row[6:9])
    vx, vy, vz = rotated(buffer, row[9:12])
    hand[0], hand[1], hand[2] = row[0] + ax, row[1] + ay, row[2] + az
    hand[3] = row[3] - (py * row[2] - pz * row[1]) + vx
    hand[4] = row[4] - (pz * row[0] - px * row[2]) + vy
    hand[5] = row[5] - (px * row[1] - py * row[0]) + vz
    inverse = parameters[1 : 1 + HEAD]
    status = solve_hand_twist(buffer[0:8], twist_jacobian, hand, no_preference, inverse, rest, velocity)
    if status != OK:
        return status
    for i in range(6):
        realised[i] = 0.0
        for k in range(n):
            realised[i] += twist_jacobian[i, k] * velocity[k]
    advance(
        as_matrix(parameters[1 + HEAD :], (parameters.shape[0] - 1 - HEAD) // 4, 4),
        velocity,
        parameters[0],
        q,
    )
    return OK


class LiveDisturbance:
    """A disturbance at work on one robot; made by `Disturbance.start`.

    Attributes
    ----------
    kernel
        Compiled function of signature `DISTURBANCE`.
    rows
        One a period, or one for all, shape (N, 12): inertial twist, then twist of the hand in its own axes.
    """

    def __init__(self, kernel: Kernel, rows: Array, dt: float, input_size: int, drives: Array) -> None:
        self.kernel = kernel
        self.rows: Array = np.ascontiguousarray(rows)
        self.parameters: Array = np.array([dt, *_INVERSE.parameters(), *drives.ravel()])
        self.work: Array = np.zeros(20 + 22 * input_size + work_size())

    def step(self, chain: Array, k: int, q: Array, realised: Array) -> None:
        """Move q, shape (n,), by what acts in period k; write the inertial twist that it gives the hand, shape (6,).

        Raises
        ------
        DivergedError
            If q is not finite.
        """
        row = self.rows[min(k, len(self.rows) - 1)]
        if self.kernel(kernels.twist_kinematics.pointer, chain, row, self.parameters, self.work, q, realised):
            raise DivergedError("the plant produced NaN or infinity")
