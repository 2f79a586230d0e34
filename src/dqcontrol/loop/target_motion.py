"""How streamed targets move, compiled: towards a pose, or as a twist leads, within bounds; in Python and in C."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import (
    exp_quaternion,
    half_angle,
    position,
    quaternion_product,
    rotate,
    set_pose,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, STATUS, WRITE, inline, kernel, types
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.references.sample import SAMPLE_SIZE

# How far the desired pose may be ahead of the hand before it waits: a hand that is held must not jump when let go.
_LEAD, _ANGULAR_LEAD = 0.05, 0.3  # m, rad
_TINY = 1e-12

# pose of the hand, time since the start (s), what is asked (empty: nothing), speeds, the target's memory
TARGET_MOTION = STATUS(READ, types.float64, READ, READ, WRITE)


class MovingSample(NamedTuple):
    """Memory of a moving target: its pose, twist, twist rate and time, the time of its last step, and scratch."""

    pose: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    twist_rate: Annotated[Array, 6]
    time: Annotated[Array, 1]
    last: Annotated[Array, 1]
    turn: Annotated[Array, 4]
    velocity: Annotated[Array, 3]


class TargetSpeeds(NamedTuple):
    """Bounds on how fast a target moves, m/s and rad/s, and the age at which a twist no longer counts, s."""

    linear: float
    angular: float
    timeout: float


class AskedTwist(NamedTuple):
    """A twist that is asked for, when it was, s, and whether it is in the axes of the hand."""

    angular: Annotated[Array, 3]
    linear: Annotated[Array, 3]
    time: float
    of_hand: float


moving_sample: MemoryLayout[MovingSample] = MemoryLayout(MovingSample)
target_speeds: MemoryLayout[TargetSpeeds] = MemoryLayout(TargetSpeeds)
asked_twist: MemoryLayout[AskedTwist] = MemoryLayout(AskedTwist)
MOVING_SIZE = moving_sample.size()
assert moving_sample.place("last") == SAMPLE_SIZE


@inline
def _apart(a, b):
    """Return how far two poses are apart, m and rad."""
    ax, ay, az = position(a)
    bx, by, bz = position(b)
    cosine = abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3])
    way = math.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2)
    return way, 2.0 * math.acos(min(cosine, 1.0))


@inline
def _time_to_move(pose, time, moving):
    """Rest at this time; return for how long the target may move, s: 0 while it is too far ahead of the hand."""
    passed = max(time - moving.last[0], 0.0)
    moving.last[0] = moving.time[0] = time
    for i in range(6):
        moving.twist[i] = 0.0
    way, turn = _apart(pose, moving.pose)
    return passed if way <= _LEAD and turn <= _ANGULAR_LEAD else 0.0


@inline
def _place(r, p, out):
    """Write a pose from a rotation, nearly of norm 1, and a position."""
    norm = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3])
    set_pose((r[0] / norm, r[1] / norm, r[2] / norm, r[3] / norm), p, out)


@kernel(TARGET_MOTION)
def move_to_pose(pose, time, goal, speeds, memory):
    """Move on straight towards a goal (8), turning about one axis, with bounded speeds."""
    moving, bounds = moving_sample(memory), target_speeds(speeds)
    passed = _time_to_move(pose, time, moving)
    if passed == 0.0 or goal.shape[0] == 0:
        return OK
    present, turn = moving.pose, moving.turn
    way, angle = _apart(present, goal)
    share = min(1.0, bounds.linear / max(way / passed, _TINY), bounds.angular / max(angle / passed, _TINY))
    back = (present[0], -present[1], -present[2], -present[3])
    quaternion_product(back, (goal[0], goal[1], goal[2], goal[3]), turn)
    if turn[0] < 0.0:
        for i in range(4):
            turn[i] = -turn[i]
    half_angle(turn, moving.velocity)
    for i in range(3):
        moving.velocity[i] *= share
    exp_quaternion(moving.velocity, turn)
    quaternion_product(
        (present[0], present[1], present[2], present[3]), (turn[0], turn[1], turn[2], turn[3]), turn
    )
    px, py, pz = position(present)
    gx, gy, gz = position(goal)
    p = (px + share * (gx - px), py + share * (gy - py), pz + share * (gz - pz))
    _place((turn[0], turn[1], turn[2], turn[3]), p, present)
    return OK


@kernel(TARGET_MOTION)
def move_by_twist(pose, time, asked, speeds, memory):
    """Move on as a twist leads (of `asked_twist`), until it is too old."""
    moving, bounds = moving_sample(memory), target_speeds(speeds)
    passed = _time_to_move(pose, time, moving)
    if passed == 0.0 or asked.shape[0] == 0:
        return OK
    given = asked_twist(asked)
    if time - given.time > bounds.timeout:
        return OK
    present, turn, w, v = moving.pose, moving.turn, moving.twist[0:3], moving.velocity
    for i in range(3):
        w[i], v[i] = given.angular[i], given.linear[i]
    if given.of_hand != 0.0:
        rotate(present, given.angular, w)
        rotate(present, given.linear, v)
    half = 0.5 * passed
    exp_quaternion((half * w[0], half * w[1], half * w[2]), turn)
    quaternion_product(
        (turn[0], turn[1], turn[2], turn[3]), (present[0], present[1], present[2], present[3]), turn
    )
    px, py, pz = position(present)
    px, py, pz = px + passed * v[0], py + passed * v[1], pz + passed * v[2]
    _place((turn[0], turn[1], turn[2], turn[3]), (px, py, pz), present)
    moving.twist[3] = v[0] + (py * w[2] - pz * w[1])
    moving.twist[4] = v[1] + (pz * w[0] - px * w[2])
    moving.twist[5] = v[2] + (px * w[1] - py * w[0])
    return OK
