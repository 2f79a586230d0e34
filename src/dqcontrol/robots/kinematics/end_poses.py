"""End poses of several configurations at once, in loops that compilers turn into vector instructions.

Eight at a time take a third of the time of one after the other: a chain is one long dependence, eight chains are not.
"""

from __future__ import annotations

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.compiled.compile import OK, inline
from dqcontrol.robots.kinematics.kinematics_kernels import REVOLUTE, call_chain, joint_frames
from dqcontrol.robots.kinematics.sin_cos import FARTHEST, sine_cosine

LANES = 8
WORK = 9 * LANES + 8
"""Numbers that `end_poses` works in; the first 7 × `LANES` are the poses."""

_HALF, _LARGEST, _POSE = 7 * LANES, 8 * LANES, 9 * LANES


@inline
def all_turn(chain):
    """Return whether all joints of a chain turn."""
    turning = True
    for i in range(chain.shape[0] - 1):
        turning = turning and chain[i, 7] == REVOLUTE
    return turning


@inline
def end_poses(chain, turning, q, first, work):
    """Write the end poses of `LANES` rows of q: unit quaternions and positions, each number of all rows side by side.

    Rows behind the last are the last one again. ``turning`` is what `all_turn` says.
    """
    n, last = chain.shape[0] - 1, q.shape[0] - 1
    if turning:
        for lane in range(LANES):
            work[lane], work[_LARGEST + lane] = 1.0, 0.0
        for place in range(LANES, 7 * LANES):
            work[place] = 0.0
        for i in range(n + 1):
            fw, fx, fy, fz = chain[i, 0], chain[i, 1], chain[i, 2], chain[i, 3]
            tx, ty, tz = chain[i, 4], chain[i, 5], chain[i, 6]
            for lane in range(LANES):
                work[_HALF + lane] = 0.5 * q[min(first + lane, last), i] if i < n else 0.0
            # `compose_fixed` and `move_joint`, written out so that they are vectorised
            for lane in range(LANES):
                w, x = work[lane], work[LANES + lane]
                y, z = work[2 * LANES + lane], work[3 * LANES + lane]
                half = work[_HALF + lane]
                work[_LARGEST + lane] = max(work[_LARGEST + lane], abs(half))
                cx = 2.0 * (y * tz - z * ty)
                cy = 2.0 * (z * tx - x * tz)
                cz = 2.0 * (x * ty - y * tx)
                work[4 * LANES + lane] += tx + w * cx + y * cz - z * cy
                work[5 * LANES + lane] += ty + w * cy + z * cx - x * cz
                work[6 * LANES + lane] += tz + w * cz + x * cy - y * cx
                tw = w * fw - x * fx - y * fy - z * fz
                ux = w * fx + x * fw + y * fz - z * fy
                uy = w * fy - x * fz + y * fw + z * fx
                uz = w * fz + x * fy - y * fx + z * fw
                sine, cosine = sine_cosine(half)
                work[lane] = tw * cosine - uz * sine
                work[LANES + lane] = ux * cosine + uy * sine
                work[2 * LANES + lane] = uy * cosine - ux * sine
                work[3 * LANES + lane] = uz * cosine + tw * sine
        largest = 0.0
        for lane in range(LANES):
            largest = max(largest, work[_LARGEST + lane])
        if largest <= FARTHEST:
            return OK
    for lane in range(LANES):
        pose = work[_POSE : _POSE + 8]
        status = joint_frames(chain, q[min(first + lane, last)], pose)
        if status != OK:
            return status
        _put(pose, lane, work)
    return OK


@inline
def task_poses(forward, table, q, first, work):
    """Do what `end_poses` does with the forward kinematics of a robot's own, which `call_chain` calls."""
    last = q.shape[0] - 1
    for lane in range(LANES):
        pose = work[_POSE : _POSE + 8]
        status = call_chain(forward, table, q[min(first + lane, last)], pose)
        if status != OK:
            return status
        _put(pose, lane, work)
    return OK


@inline
def _put(pose, lane, work):
    """Write a pose (8,) beside the others."""
    for part in range(4):
        work[part * LANES + lane] = pose[part]
    x, y, z = position(pose)
    work[4 * LANES + lane], work[5 * LANES + lane], work[6 * LANES + lane] = x, y, z
