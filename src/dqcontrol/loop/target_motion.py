"""Motion of streamed targets, compiled: towards a pose, or as a twist leads, within bounds; in Python and in C."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import (
    exp_quaternion,
    half_turn,
    position,
    quaternion_product,
    rotate,
    set_pose,
)
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, STATUS, WRITE, inline, kernel, types
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.references.sample import SAMPLE_SIZE

# How far the desired pose may be ahead of the end effector before it goes no farther: one that is held must not jump
# when let go. It then begins with k times that: 0.25 m/s, the reduced speed of ISO 10218-1, at k = 5 1/s.
_LEAD, _ANGULAR_LEAD = 0.05, 0.3  # m, rad
_TINY = 1e-12  # against a division by 0

# pose of the end effector, time since the start (s), what is asked (empty: nothing), speeds, the target's memory
TARGET_MOTION = STATUS(READ, types.float64, READ, READ, WRITE)


class MovingSample(NamedTuple):
    """Memory of a moving target.

    Attributes
    ----------
    pose, twist, twist_rate, time
        Its sample.
    last
        Time of its last step, s.
    linear, angular
        How fast it moves, inertial axes, m/s and rad/s.
    is_held, held
        Whether a goal has become too old, and where the end effector was then.
    turn, way
        Scratch.
    """

    pose: Annotated[Array, 8]
    twist: Annotated[Array, 6]
    twist_rate: Annotated[Array, 6]
    time: Annotated[Array, 1]
    last: Annotated[Array, 1]
    linear: Annotated[Array, 3]
    angular: Annotated[Array, 3]
    is_held: Annotated[Array, 1]
    held: Annotated[Array, 8]
    turn: Annotated[Array, 4]
    way: Annotated[Array, 3]


class TargetSpeeds(NamedTuple):
    """Bounds on how fast a target moves, m/s and rad/s, the age from which it no longer counts, s, and m/s²."""

    linear: float
    angular: float
    timeout: float
    acceleration: float


class AskedPose(NamedTuple):
    """A pose that is asked for, NaN where it is none, and when it was, s."""

    pose: Annotated[Array, 8]
    time: float


class AskedTwist(NamedTuple):
    """A twist that is asked for, when it was, s, and whether it is in the axes of the end effector."""

    angular: Annotated[Array, 3]
    linear: Annotated[Array, 3]
    time: float
    of_hand: float


moving_sample: MemoryLayout[MovingSample] = MemoryLayout(MovingSample)
target_speeds: MemoryLayout[TargetSpeeds] = MemoryLayout(TargetSpeeds)
asked_pose: MemoryLayout[AskedPose] = MemoryLayout(AskedPose)
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
def _time_to_move(time, moving):
    """Rest at this time; return the time since the last, s."""
    passed = max(time - moving.last[0], 0.0)
    moving.last[0] = moving.time[0] = time
    for i in range(6):
        moving.twist[i] = 0.0
    return passed


@inline
def _kept_share(velocity, ahead, far):
    """Take from a velocity (3) what leads on ahead (3), so far; return which share of it is left."""
    x, y, z = velocity[0], velocity[1], velocity[2]
    farther = (x * ahead[0] + y * ahead[1] + z * ahead[2]) / (far * far)
    if farther <= 0.0:
        return 1.0
    for i in range(3):
        velocity[i] -= farther * ahead[i]
    left = math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1] + velocity[2] * velocity[2])
    return left / math.sqrt(x * x + y * y + z * z)


@inline
def _keep_near(pose, moving):
    """Lead no farther ahead of the end effector, in place or turn, where the target is too far ahead; back is free.

    Way and turn still take the same time: what is taken from one slows the other.
    """
    w, v, ahead = moving.angular, moving.linear, moving.way
    way, angle = _apart(pose, moving.pose)
    kept_way = kept_turn = 1.0
    if way > _LEAD:
        (px, py, pz), (tx, ty, tz) = position(pose), position(moving.pose)
        ahead[0], ahead[1], ahead[2] = tx - px, ty - py, tz - pz
        kept_way = _kept_share(v, ahead, way)
    if angle > _ANGULAR_LEAD:
        half_turn(pose, moving.pose, moving.turn, ahead)
        kept_turn = _kept_share(w, ahead, 0.5 * angle)
    for i in range(3):
        w[i] *= kept_way
        v[i] *= kept_turn


@inline
def _approach(present, wanted, most):
    """Change a velocity (3) towards a wanted one, by so much at most."""
    x, y, z = wanted[0] - present[0], wanted[1] - present[1], wanted[2] - present[2]
    share = min(1.0, most / max(math.sqrt(x * x + y * y + z * z), _TINY))
    present[0] += share * x
    present[1] += share * y
    present[2] += share * z


@inline
def _advance(passed, moving):
    """Move the pose as it moves, and write its twist."""
    present, turn, w, v = moving.pose, moving.turn, moving.angular, moving.linear
    half = 0.5 * passed
    exp_quaternion((half * w[0], half * w[1], half * w[2]), turn)
    now = present[0], present[1], present[2], present[3]
    quaternion_product((turn[0], turn[1], turn[2], turn[3]), now, turn)
    px, py, pz = position(present)
    px, py, pz = px + passed * v[0], py + passed * v[1], pz + passed * v[2]
    _place((turn[0], turn[1], turn[2], turn[3]), (px, py, pz), present)
    for i in range(3):
        moving.twist[i] = w[i]
    moving.twist[3] = v[0] + (py * w[2] - pz * w[1])
    moving.twist[4] = v[1] + (pz * w[0] - px * w[2])
    moving.twist[5] = v[2] + (px * w[1] - py * w[0])


@inline
def _place(r, p, out):
    """Write a pose from a rotation, nearly of norm 1, and a position."""
    norm = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3])
    set_pose((r[0] / norm, r[1] / norm, r[2] / norm, r[3] / norm), p, out)


@inline
def _is_held(pose, time, given, bounds, moving):
    """Return whether a goal is too old, or none: then the goal is where the end effector was at first."""
    is_none = given.pose[0] != given.pose[0] or time - given.time > bounds.timeout
    if is_none and moving.is_held[0] == 0.0:
        for i in range(8):
            moving.held[i] = pose[i]
    moving.is_held[0] = 1.0 if is_none else 0.0
    return is_none


@inline
def _goal(pose, time, asked, bounds, moving):
    """Return the time to move, s, and the goal to move to; no time where nothing was asked for."""
    passed = _time_to_move(time, moving)
    if asked.shape[0] == 0:
        return 0.0, moving.held
    given = asked_pose(asked)
    is_none = _is_held(pose, time, given, bounds, moving)
    return passed, moving.held if is_none else given.pose


@kernel(TARGET_MOTION)
def move_with_pose(pose, time, asked, speeds, memory):
    """Be at a goal (of `asked_pose`) as soon as speeds allow, with the twist that takes it there: a hand leads it.

    A goal that is too old, or none, is where the end effector is then.
    """
    moving, bounds = moving_sample(memory), target_speeds(speeds)
    passed, goal = _goal(pose, time, asked, bounds, moving)
    if passed == 0.0:
        return OK
    present, w, v = moving.pose, moving.angular, moving.linear
    way, angle = _apart(present, goal)
    pace = 1.0 / max(passed, way / bounds.linear, angle / bounds.angular)
    half_turn(present, goal, moving.turn, moving.way)
    for i in range(3):
        w[i] = 2.0 * pace * moving.way[i]
    (px, py, pz), (gx, gy, gz) = position(present), position(goal)
    v[0], v[1], v[2] = pace * (gx - px), pace * (gy - py), pace * (gz - pz)
    _keep_near(pose, moving)
    _advance(passed, moving)
    return OK


@kernel(TARGET_MOTION)
def move_to_pose(pose, time, asked, speeds, memory):
    """Move on straight towards a goal (of `asked_pose`), turning about one axis, with bounded speeds and accelerations.

    Way and turn take the same time. A goal that is too old, or none, is where the end effector is then.
    """
    moving, bounds = moving_sample(memory), target_speeds(speeds)
    passed, goal = _goal(pose, time, asked, bounds, moving)
    if passed == 0.0:
        return OK
    present, w, v = moving.pose, moving.angular, moving.linear
    way, angle = _apart(present, goal)
    time_left = max(way / bounds.linear, angle / bounds.angular)  # at full speed
    rate = bounds.acceleration / bounds.linear
    slower = rate * passed  # in a period; from the pace below, the target comes to rest at its goal
    linear = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) / bounds.linear
    before = max(linear, math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) / bounds.angular)
    stopping = math.sqrt(0.25 * slower * slower + 2.0 * rate * time_left) - 0.5 * slower
    pace = min(1.0, before + slower, stopping, time_left / passed) / max(time_left, _TINY)
    px, py, pz = position(present)
    gx, gy, gz = position(goal)
    _approach(v, (pace * (gx - px), pace * (gy - py), pace * (gz - pz)), bounds.acceleration * passed)
    half_turn(present, goal, moving.turn, moving.way)
    twice, most = 2.0 * pace, slower * bounds.angular
    _approach(w, (twice * moving.way[0], twice * moving.way[1], twice * moving.way[2]), most)
    _keep_near(pose, moving)
    _advance(passed, moving)
    for i in range(6):
        moving.twist[i] = 0.0  # poses that somebody streams are followed, not foreseen
    return OK


@kernel(TARGET_MOTION)
def move_by_twist(pose, time, asked, speeds, memory):
    """Move on as a twist leads (of `asked_twist`), within accelerations, until it is too old: then stop."""
    moving, bounds = moving_sample(memory), target_speeds(speeds)
    passed = _time_to_move(time, moving)
    if passed == 0.0 or asked.shape[0] == 0:
        return OK
    given = asked_twist(asked)
    w, v = moving.turn, moving.way
    for i in range(3):
        w[i] = v[i] = 0.0
    if not time - given.time > bounds.timeout:
        for i in range(3):
            w[i], v[i] = given.angular[i], given.linear[i]
        if given.of_hand != 0.0:
            rotate(moving.pose, given.angular, w)
            rotate(moving.pose, given.linear, v)
    most = bounds.acceleration * passed
    _approach(moving.linear, v, most)
    _approach(moving.angular, w, most * bounds.angular / bounds.linear)
    _keep_near(pose, moving)
    _advance(passed, moving)
    return OK
