"""Limits on what a law may command: velocities of joints, bases and wheels, joint positions."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, Kernel, inlined, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.errors import ValueRangeError
from dqcontrol.limits.clamping import ModifiedClamping, OriginalClamping
from dqcontrol.limits.weighted_least_norm import WeightedLeastNorm
from dqcontrol.robots.driving import drive_speeds
from dqcontrol.robots.robot import Robot

AnyPositionLimit = ModifiedClamping | OriginalClamping | WeightedLeastNorm

# q, parameters, command
LIMIT = STATUS(INPUT, READ, WRITE)


@kernel(LIMIT)
def unlimited(q, parameters, command):
    """Leave the command as it is."""
    return OK


@inlined
def scale_down(q, parameters, command):
    """Scale the whole command by min(1, min u_max/|u|), wheel rims among the u: it keeps its direction.

    Parameters: the velocity limit of each input, then the drives.
    """
    m = command.shape[0]
    scale = 1.0
    for i in range(m):
        if abs(command[i]) * scale > parameters[i]:
            scale = parameters[i] / abs(command[i])
    drives = as_matrix(parameters[m:], (parameters.shape[0] - m) // 4, 4)
    for k in range(drives.shape[0]):
        v, omega = drive_speeds(drives, k, command, q)
        rim = abs(v) + drives[k, 3] * abs(omega)
        fastest = parameters[int(drives[k, 0]) - (k if m < q.shape[0] else 0)]
        if rim * scale > fastest:
            scale = fastest / rim
    for i in range(m):
        command[i] *= scale


@kernel(LIMIT)
def scale_velocity(q, parameters, command):
    """Scale the command to the velocity limits."""
    scale_down(q, parameters, command)
    return OK


class CommandLimits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is done to a law's command before it leaves.

    Parameters
    ----------
    velocity
        True: where an input exceeds the robot's velocity limit, or the rim of a drive's wheel its rim speed, the whole
        command is scaled down, so that the hand keeps its direction and only slows. If omitted, the plant decides (see
        `dqcontrol.plants.limits_before`); a law prepared without a plant leaves the command as it is.
    position
        How joints are kept within their position limits, before that; not at all if omitted.
    """

    velocity: Annotated[bool | None, Meta(description="scale commands to the velocity limits")] = None
    position: AnyPositionLimit | None = None

    def prepare(self, robot: Robot) -> tuple[Kernel, NDArray[np.float64]]:
        """Return the kernel that keeps the velocity limits, and its parameters.

        Raises
        ------
        ValueRangeError
            If the robot has no velocity limits to keep.
        """
        if not self.velocity:
            return unlimited, np.zeros(0)
        if not np.isfinite(robot.limits.velocity).any():
            raise ValueRangeError(f"limits.velocity: {robot.name} has no velocity limits to keep")
        return scale_velocity, np.concatenate([robot.limits.velocity, robot.drives.ravel()])
