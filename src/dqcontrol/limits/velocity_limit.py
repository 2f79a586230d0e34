"""Velocity limits of joints, bases and wheels: the whole command is scaled, so that the hand keeps its direction."""

from __future__ import annotations

from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.robots.driving import drive_speeds

# q, parameters, command
LIMIT = STATUS(INPUT, READ, WRITE)


@kernel(LIMIT)
def unlimited(q, parameters, command):
    """Leave the command as it is."""
    return OK


@inline
def velocity_scale(q, parameters, command):
    """Return min(1, min u_max/|u|), wheel rims among the u.

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
    return scale


@inline
def scale_down(q, parameters, command):
    """Scale the whole command to its limits: it keeps its direction."""
    scale = velocity_scale(q, parameters, command)
    for i in range(command.shape[0]):
        command[i] *= scale


@kernel(LIMIT)
def scale_velocity(q, parameters, command):
    """Scale the command to the velocity limits."""
    scale_down(q, parameters, command)
    return OK
