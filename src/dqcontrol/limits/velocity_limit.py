"""Velocity limits of joints, bases and wheels: commands are scaled, so that the end effector keeps its direction."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.kinematics.driving import (
    DRIVE_COLUMNS,
    RIM_LEVER,
    ROLLER_COLUMNS,
    drive_speeds,
    rim_load,
    steer,
)

# q, parameters, command
LIMIT = STATUS(INPUT, READ, WRITE)


class SpeedLimits(NamedTuple):
    """The velocity limit of each input, and the robot's drives, whose rims have limits too."""

    fastest: Annotated[Array, "m"]
    drives: Annotated[Array, ..., DRIVE_COLUMNS]


class RollerSpeedLimits(NamedTuple):
    """`SpeedLimits` of a robot that has wheels with rollers too, see `dqcontrol.robots.kinematics.driving`."""

    fastest: Annotated[Array, "m"]
    drive_count: float
    drives: Annotated[Array, "drives", DRIVE_COLUMNS]
    rollers: Annotated[Array, ..., ROLLER_COLUMNS]


speed_limits: MemoryLayout[SpeedLimits] = MemoryLayout(SpeedLimits, "m")
roller_speed_limits: MemoryLayout[RollerSpeedLimits] = MemoryLayout(RollerSpeedLimits, "m", "drives")


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
        rim = abs(v) + drives[k, RIM_LEVER] * abs(omega)
        fastest = limits[int(drives[k, 0]) - (k if m < q.shape[0] else 0)]
        if rim * scale > fastest:
            scale = fastest / rim
    return scale


@inline
def scale_down(q, speed_limits, command):
    """Scale the whole command to its limits: it keeps its direction, but for turns that no wheel can be steered to."""
    scale = velocity_scale(q, speed_limits, command)
    for i in range(command.shape[0]):
        command[i] *= scale
    if command.shape[0] < q.shape[0]:
        steer(speed_limits.drives, command)


@inline
def scale_down_rollers(q, rollers, command):
    """Scale the whole command so that no rim of a wheel with rollers is too fast."""
    share = 1.0
    for k in range(rollers.shape[0]):
        share = max(share, abs(rim_load(rollers, k, q, command)))
    for i in range(command.shape[0]):
        command[i] /= share


@kernel(LIMIT)
def scale_velocity(q, parameters, command):
    """Scale the command to the velocity limits."""
    scale_down(q, speed_limits(parameters, command.shape[0]), command)
    return OK


@kernel(LIMIT)
def scale_velocity_on_rollers(q, parameters, command):
    """Scale the command to the velocity limits, those of wheels with rollers among them."""
    m = command.shape[0]
    given = roller_speed_limits(parameters, m, int(parameters[m]))
    scale_down_rollers(q, given.rollers, command)
    scale_down(q, SpeedLimits(given.fastest, given.drives), command)
    return OK
