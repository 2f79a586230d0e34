"""Disturbances that move a robot: through its joints, before the plant's own step."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position, rotated
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, Kernel, kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import DivergedError
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_work
from dqcontrol.laws.inverses import FilteredInverse, inverse_parameters
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, advance
from dqcontrol.robots.kinematics.kinematics_kernels import call_chain, split
from dqcontrol.robots.robot import Robot

# A robot that is pushed knows nothing of the law's weight between angles and positions, nor of its thresholds: these
# are those of feedback linearisation, whose V measures twists in the same way (docs/laws.md).
_INVERSE = FilteredInverse(threshold=0.02, damping=0.05, characteristic_length=1.0)
ROW = 12  # of a disturbance: inertial twist, then twist of the hand in its own axes

# kinematics, chain, row, parameters, work, q, realised inertial twist
DISTURBANCE = STATUS(ADDRESS, READ2, READ, READ, WRITE, WRITE, WRITE)


class DisturbanceParameters(NamedTuple):
    """What compiled code knows of a disturbed robot."""

    period: float
    inverse: Annotated[Array, inverse_parameters.size()]
    drives: Annotated[Array, ..., DRIVE_COLUMNS]


class DisturbanceWork(NamedTuple):
    """Scratch; nothing is preferred."""

    kinematics: Annotated[Array, "8 + 14 * m"]
    velocity: Annotated[Array, "m"]
    preferred: Annotated[Array, "m"]
    hand: Annotated[Array, 6]
    solver: Annotated[Array, twist_work.sized("m")]


disturbance_parameters: MemoryLayout[DisturbanceParameters] = MemoryLayout(DisturbanceParameters)
disturbance_work: MemoryLayout[DisturbanceWork] = MemoryLayout(DisturbanceWork, "m")


@kernel(DISTURBANCE)
def disturb(kinematics, chain, row, parameters, work, q, realised):
    """Let u = J_h⁺ t act for T with t = [ω ; ṗ] of v_w + Ad(x) w, and write the twist J_w J_h⁺ t that comes of it."""
    n = q.shape[0] - int(chain[q.shape[0], 7])  # inputs
    given = disturbance_parameters(parameters)
    own = disturbance_work(work, n)
    buffer, velocity, hand = own.kinematics, own.velocity, own.hand
    status = call_chain(kinematics, chain, q, buffer)
    if status != OK:
        return status
    pose, _, twist_jacobian = split(buffer)
    px, py, pz = position(buffer)
    ax, ay, az = rotated(buffer, row[6:9])
    vx, vy, vz = rotated(buffer, row[9:12])
    hand[0], hand[1], hand[2] = row[0] + ax, row[1] + ay, row[2] + az
    hand[3] = row[3] - (py * row[2] - pz * row[1]) + vx
    hand[4] = row[4] - (pz * row[0] - px * row[2]) + vy
    hand[5] = row[5] - (px * row[1] - py * row[0]) + vz
    status = solve_hand_twist(
        pose, twist_jacobian, hand, NO_ERROR, own.preferred, given.inverse, own.solver, velocity
    )
    if status != OK:
        return status
    for i in range(6):
        realised[i] = 0.0
        for k in range(n):
            realised[i] += twist_jacobian[i, k] * velocity[k]
    advance(given.drives, velocity, given.period, q)
    return OK


class RunningDisturbance:
    """A disturbance at work on one robot; made by `Disturbance.start`.

    Attributes
    ----------
    kernel
        Compiled function of signature `DISTURBANCE`.
    rows
        One a period, or one for all, shape (N, 12): inertial twist, then twist of the hand in its own axes.
    """

    def __init__(self, kernel: Kernel, rows: Array, period: float, input_size: int, drives: Array) -> None:
        self.kernel = kernel
        self.rows: Array = np.ascontiguousarray(rows)
        self.parameters: Array = disturbance_parameters.pack(
            period=period, inverse=_INVERSE.parameters(), drives=drives
        )
        self.work: Array = np.zeros(disturbance_work.size(input_size))

    def step(self, robot: Robot, k: int, q: Array, realised: Array) -> None:
        """Move q, shape (n,), by what acts in period k; write the inertial twist that this gives, shape (6,).

        Raises
        ------
        DivergedError
            If q is not finite.
        """
        row = self.rows[min(k, len(self.rows) - 1)]
        kinematics = robot.kernels.twist_kinematics.pointer
        if self.kernel(kinematics, robot.table, row, self.parameters, self.work, q, realised):
            raise DivergedError("the plant produced NaN or infinity")
