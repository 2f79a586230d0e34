"""The motion preferred in the null space, as laws use it: work begins with z (zeros if there is none)."""

from __future__ import annotations

from dqcontrol.compile import OK, inlined


@inlined
def pose_rate(pose_jacobian, motion, out):
    """Write J z and return True, or return False if z is zero."""
    n = pose_jacobian.shape[1]
    total = 0.0
    for i in range(n):
        total += abs(motion[i])
    if total == 0.0:
        return False
    for k in range(8):
        value = 0.0
        for i in range(n):
            value += pose_jacobian[k, i] * motion[i]
        out[k] = value
    return True


@inlined
def add_preferred(motion, out):
    """Add z to the solution of the task."""
    for i in range(out.shape[0]):
        out[i] += motion[i]
    return OK
