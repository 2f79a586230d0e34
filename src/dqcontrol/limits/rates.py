"""Rates that inputs may have: velocity limits of joints, bases and wheels, and rates from which joints still stop.

Commands beyond a velocity limit are scaled, so that the end effector keeps its direction. Stopping is exact in samples.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.kinematics import driving

# q, parameters, command
LIMIT = STATUS(INPUT, READ, WRITE)


class SpeedLimits(NamedTuple):
    """The velocity limit of each input, and the robot's drives, whose rims have limits too."""

    fastest: Annotated[Array, "m"]
    drives: Annotated[Array, ..., driving.DRIVE_COLUMNS]


class RollerSpeedLimits(NamedTuple):
    """`SpeedLimits` of a robot that has wheels with rollers too, see `dqcontrol.robots.kinematics.driving`."""

    fastest: Annotated[Array, "m"]
    drive_count: float
    drives: Annotated[Array, "drives", driving.DRIVE_COLUMNS]
    rollers: Annotated[Array, ..., driving.ROLLER_COLUMNS]


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
        v, omega = driving.drive_speeds(drives, k, command, q)
        rim = abs(v) + drives[k, driving.RIM_LEVER] * abs(omega)
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
        driving.steer(speed_limits.drives, command)


@inline
def scale_down_rollers(q, rollers, command):
    """Scale the whole command so that no rim of a wheel with rollers is too fast."""
    share = 1.0
    for k in range(rollers.shape[0]):
        share = max(share, abs(driving.rim_load(rollers, k, q, command)))
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


_MORE = 1.01  # a hundredth is more than all rounding
_SMOOTH = 1e12  # steps² of braking from which on sampling no longer matters


@inline
def fastest_stoppable(distance, acceleration, period):
    """Return the largest rate v ≥ 0 that can be held for one period and braked to 0 within a room.

    Braking by aT a period from v covers T (v + (v − aT) + (v − 2aT) + …) = T (N v − aT N (N − 1)/2), N = ⌈v/(aT)⌉;
    N is the smallest integer with aT² N (N + 1)/2 ≥ room.
    """
    if distance <= 0.0 or acceleration <= 0.0:
        return 0.0
    if distance == math.inf:
        return math.inf
    if acceleration == math.inf:
        return distance / period
    step = acceleration * period
    ratio = distance / (step * period)
    # v²/(2a) + vT/2 = room: v is less than √(2a room) by 1/(2N) of it, N ≥ √2·10⁶ periods
    if not ratio < _SMOOTH:
        return math.sqrt(2.0 * acceleration) * math.sqrt(distance) * (1.0 - 1e-6)
    count = max(math.ceil(0.5 * (math.sqrt(1.0 + 8.0 * ratio) - 1.0)), 1.0)
    return (distance / period + 0.5 * step * count * (count - 1.0)) / count


@inline
def surely_stops(room, rate, acceleration, period):
    """Return True only if `fastest_stoppable` is at least this rate: without what that takes to find out.

    From v a joint stops within v²/(2a) + vT; a hundredth more is more than all rounding.
    """
    return 2.0 * acceleration * room > _MORE * (rate * (rate + 2.0 * acceleration * period))


@inline
def largest_share(keeps, parts, least):
    """Return which share of what is wanted beyond full braking keeps something, and whether that is kept.

    It is 1, a half, a quarter, … down to the first that is no more than ``least``, then 0; ``keeps`` takes the
    supervisor's parts and a share, and leaves in its scratch what it looked at.
    """
    share = 1.0
    while True:
        is_kept = keeps(parts, share)
        if is_kept or share == 0.0:
            return share, is_kept
        share = 0.5 * share if share > least else 0.0


@inline
def braking_share(rate, step):
    """Return the share of a rate that one period of braking by at most ``step`` takes."""
    return step / abs(rate) if abs(rate) > step else 1.0


@inline
def braked(rate, step):
    """Return a rate after one period of braking by at most ``step``."""
    return rate - min(max(rate, -step), step)
