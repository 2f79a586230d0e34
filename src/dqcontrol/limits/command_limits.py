"""Limits on what a law may command: joint velocities and positions."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from dqcontrol.compile import OK, READ, STATUS, WRITE, Kernel, kernel
from dqcontrol.errors import ValueRangeError
from dqcontrol.limits.clamping import ModifiedClamping, OriginalClamping
from dqcontrol.limits.weighted_least_norm import WeightedLeastNorm
from dqcontrol.robots.robot import Robot

AnyPositionLimit = ModifiedClamping | OriginalClamping | WeightedLeastNorm

# q, parameters, command
LIMIT = STATUS(READ, READ, WRITE)


@kernel(LIMIT)
def unlimited(q, parameters, command):
    """Leave the command as it is."""
    return OK


@kernel(LIMIT)
def scale_velocity(q, parameters, command):
    """Scale the whole command by min(1, min u_max/|u|): it keeps its direction."""
    scale = 1.0
    for i in range(command.shape[0]):
        if abs(command[i]) * scale > parameters[i]:
            scale = parameters[i] / abs(command[i])
    for i in range(command.shape[0]):
        command[i] *= scale
    return OK


class CommandLimits(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is done to a law's command before it leaves.

    Parameters
    ----------
    velocity
        True: where an input exceeds the robot's velocity limit, the whole command is scaled down, so that the hand
        keeps its direction and only slows.
    position
        How joints are kept within their position limits, before that; not at all if omitted.
    """

    velocity: Annotated[bool, Meta(description="scale commands to the velocity limits")] = False
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
        return scale_velocity, np.ascontiguousarray(robot.limits.velocity)
