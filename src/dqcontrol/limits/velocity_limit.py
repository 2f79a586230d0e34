"""Velocity limits of joints, bases and wheels: the whole command is scaled, so that the hand keeps its direction."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.driving import drive_speeds

# q, parameters, command
LIMIT = STATUS(INPUT, READ, WRITE)


class SpeedLimits(NamedTuple):
    """The velocity limit of each input, and the robot's drives, whose rims have limits too."""

    fastest: Annotated[Array, "m"]
    drives: Annotated[Array, ..., 4]


speed_limits = MemoryLayout(SpeedLimits, "m")


@kernel(LIMIT)
def unlimited(q, parameters, command):
    """Leave the command as it is."""
    return OK


@inline
def velocity_scale(q, speed_limits, command):
    """Return min(1, min u_max/|u|), wheel rims among the u, for `SpeedLimits`."""
    m = command.shape[0]
    limits, drives = speed_limits.fastest, speed_limits.drives
    scale = 1.0
    for i in range(m):
        if abs(command[i]) * scale > limits[i]:
            scale = limits[i] / abs(command[i])
    for k in range(drives.shape[0]):
        v, omega = drive_speeds(drives, k, command, q)
        rim = abs(v) + drives[k, 3] * abs(omega)
        fastest = limits[int(drives[k, 0]) - (k if m < q.shape[0] else 0)]
        if rim * scale > fastest:
            scale = fastest / rim
    return scale


@inline
def scale_down(q, speed_limits, command):
    """Scale the whole command to its limits: it keeps its direction."""
    scale = velocity_scale(q, speed_limits, command)
    for i in range(command.shape[0]):
        command[i] *= scale


@kernel(LIMIT)
def scale_velocity(q, parameters, command):
    """Scale the command to the velocity limits."""
    scale_down(q, speed_limits(parameters, command.shape[0]), command)
    return OK
