"""What a supervisor keeps of the hand: its distance from singularities, its box, its speed and acceleration."""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import translation
from dqcontrol.compiled.compile import OK, inline
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.limits.supervisor.braking import braked
from dqcontrol.limits.supervisor.interventions import HAND_ACCELERATION, HELD, SLOWED
from dqcontrol.limits.supervisor.supervisor_layout import (
    BOX,
    BOXED,
    DT,
    HAND_ACCELERATION_LIMIT,
    HAND_BEFORE,
    HAND_SPEED_LIMIT,
    HANDS,
    HOLD,
    HOLDING,
    INDEX,
    SLOW,
    WINDOW,
)
from dqcontrol.robots.dexterity_step import smallest_singular_value
from dqcontrol.robots.kinematics_kernels import call_chain, hand_jacobian, joint_frames
from dqcontrol.robots.pose_task_kernels import place_tree

_BRAKING_STEPS = 2000  # whoever brakes longer than that goes no faster
_ROUNDING = 1e-9  # share of a limit
_BRAKING_HAND = 1.1  # share of the hand's speed limit while braking: joints stop at different times


@inline
def avoid_singularity(kinematics, robot, bounds, memory, scratch):
    """Slow the rates, or hold, where they lead towards a singularity; return which."""
    good, rates, input_coordinates, is_joint = memory.good, scratch.rates, bounds.coordinate, bounds.is_joint
    n, m = good.shape[0], rates.shape[0]
    buffer, jacobian, config = scratch.buffer, scratch.jacobian, scratch.config
    hand = scratch.hand
    slow, hold = bounds.head[SLOW], bounds.head[HOLD]
    fastest = 0.0
    for i in range(m):
        if is_joint[i] != 0.0:
            fastest = max(fastest, abs(rates[i]))
    here, ahead = 0.0, 0.0
    for look in range(2):
        for i in range(n):
            config[i] = good[i]
        if look == 1:
            if fastest == 0.0:
                return 0
            for i in range(m):
                if is_joint[i] != 0.0:
                    config[int(input_coordinates[i])] += 1e-3 * rates[i] / fastest
        if call_chain(kinematics, robot.table, config, buffer) != OK:
            return 0
        twist_jacobian = as_matrix(buffer[8 + 8 * m : 8 + 14 * m], 6, m)
        translation(buffer[0:8], hand)
        hand_jacobian((hand[0], hand[1], hand[2]), twist_jacobian, jacobian)
        value = smallest_singular_value(jacobian, 2.0 * slow, scratch.gram, scratch.vectors, scratch.column)
        if look == 0:
            here = value
            if here > 0.5 * (slow + hold):
                memory.numbers[HOLDING] = 0.0
            if here >= slow:
                return 0
        else:
            ahead = value
    if ahead >= here:
        return 0
    if here <= hold:
        memory.numbers[HOLDING] = 1.0
    scale = (here - hold) / (slow - hold) if slow > hold and memory.numbers[HOLDING] == 0.0 else 0.0
    for i in range(m):
        rates[i] *= scale
    return SLOWED if scale > 0.0 else HELD


@inline
def place_robot(robot, config, frames):
    """Write the poses of all joints, then of the hands."""
    if robot.tree.shape[0] > 0:
        return place_tree(robot.tree, config, frames)
    return joint_frames(robot.table, config, frames)


@inline
def is_inside(robot, config, bounds, tolerance, frames, hand):
    """Write where each hand is, m; return whether all of them, and all points to be kept inside, are in the box."""
    if place_robot(robot, config, frames) != OK:
        return False
    head, points = bounds.head, bounds.points
    inside = True
    for k in range(points.shape[0]):
        at = 8 * int(points[k, 0])
        frame = frames[at : at + 8]
        translation(frame, hand)
        w, x, y, z = frame[0], frame[1], frame[2], frame[3]
        a, b, c = points[k, 1], points[k, 2], points[k, 3]
        ta, tb, tc = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        hand[0] += a + w * ta + y * tc - z * tb
        hand[1] += b + w * tb + z * ta - x * tc
        hand[2] += c + w * tc + x * tb - y * ta
        for i in range(3):
            inside = inside and head[BOX + i] - tolerance <= hand[i] <= head[BOX + 3 + i] + tolerance
    for k in range(int(head[HANDS])):
        at = frames.shape[0] - 8 * (int(head[HANDS]) - k)
        place = hand[3 * k : 3 * k + 3]
        translation(frames[at : at + 8], place)
        for i in range(3):
            inside = inside and head[BOX + i] - tolerance <= place[i] <= head[BOX + 3 + i] + tolerance
    return inside or head[BOXED] == 0.0


@inline
def commanded_hand(robot, bounds, memory, scratch, ahead, hand):
    """Write where each hand is commanded, m, ``ahead`` s later at the rates; return whether all is in the box."""
    config = scratch.config
    for i in range(config.shape[0]):
        config[i] = memory.good[i]
    for i in range(scratch.rates.shape[0]):
        if bounds.is_joint[i] != 0.0:
            config[int(bounds.coordinate[i])] = memory.sent[i] + ahead * scratch.rates[i]
    return is_inside(robot, config, bounds, 0.0, scratch.frames, hand)


@inline
def _distance(head, a, b):
    """Return how far the hand is from where it was, of several the farthest."""
    farthest = 0.0
    for k in range(0, 3 * int(head[HANDS]), 3):
        away = math.sqrt((a[k] - b[k]) ** 2 + (a[k + 1] - b[k + 1]) ** 2 + (a[k + 2] - b[k + 2]) ** 2)
        farthest = max(farthest, away) if away == away else away
    return farthest


@inline
def scale_hand_speed(robot, bounds, memory, scratch):
    """Scale the rates so that the commanded hands, at ``hand`` now, keep their speed; return whether they did not."""
    dt = bounds.head[DT]
    commanded_hand(robot, bounds, memory, scratch, dt, scratch.ahead)
    speed = _distance(bounds.head, scratch.ahead, scratch.hand) / dt
    limit = bounds.head[HAND_SPEED_LIMIT]
    if not speed > limit:
        return False
    for i in range(scratch.rates.shape[0]):
        scratch.rates[i] *= limit / speed
    return True


@inline
def limit_hand_acceleration(robot, bounds, memory, scratch):
    """Take as much of the change of the rates as keeps the commanded hand's acceleration; return what was done.

    With the share s of the change the hand's acceleration is c + s d to first order in T: the largest s in 0 … 1 with
    |c + s d| ≤ limit, or the s of the smallest acceleration if none keeps it (a bend that is run through too fast). Of
    several hands the least share.
    """
    m, dt, limit = scratch.rates.shape[0], bounds.head[DT], bounds.head[HAND_ACCELERATION_LIMIT]
    rates, rate, trial = scratch.rates, memory.rate, scratch.trial
    hands = int(bounds.head[HANDS])
    commanded_hand(robot, bounds, memory, scratch, dt, scratch.ahead)
    for i in range(3 * hands):  # the column holds x with all of the change, as it is overwritten below
        scratch.column[i] = scratch.ahead[i]
    for i in range(m):
        trial[i], rates[i] = rates[i], rate[i]
    commanded_hand(robot, bounds, memory, scratch, dt, scratch.ahead)
    least = 1.0
    for k in range(hands):
        cc, cd, dd = 0.0, 0.0, 0.0
        for i in range(3 * k, 3 * k + 3):
            c = (scratch.ahead[i] - 2.0 * scratch.hand[i] + memory.numbers[HAND_BEFORE + i]) / (dt * dt)
            d = (scratch.column[i] - scratch.ahead[i]) / (dt * dt)
            cc, cd, dd = cc + c * c, cd + c * d, dd + d * d
        share = 1.0
        if cc + 2.0 * cd + dd > limit * limit:
            share = 0.0
            if dd > 0.0:
                inner = cd * cd - dd * (cc - limit * limit)
                share = min(max((math.sqrt(max(inner, 0.0)) - cd) / dd, 0.0), 1.0)
        least = min(least, share)
    for i in range(m):
        rates[i] = rate[i] + least * (trial[i] - rate[i])
    return HAND_ACCELERATION if least < 1.0 else 0


@inline
def _decayed(rate, change):
    """Return a rate that has been braked by so much."""
    return math.copysign(max(abs(rate) - change, 0.0), rate)


@inline
def stays_safe(robot, bounds, memory, scratch, share):
    """Return whether the commanded hands keep box and speed after these rates, and in each period of braking from them.

    The rates are those of full braking, and a share of what is wanted beyond. What is looked at is what is sent, after
    smoothing: rates from before still come out of its window when all joints brake.
    """
    head, past = bounds.head, memory.past
    m, dt, window = scratch.rates.shape[0], head[DT], int(head[WINDOW])
    look, trial, sums, config = scratch.look, scratch.trial, scratch.sums, scratch.config
    for i in range(config.shape[0]):
        config[i] = memory.good[i]
    for i in range(m):
        safe = braked(memory.rate[i], bounds.acceleration[i] * dt)
        scratch.asked[i] = trial[i] = safe + share * (scratch.rates[i] - safe)
        look[i], sums[i] = memory.sent[i], 0.0
        for k in range(window):
            sums[i] += past[k, i]
    for k in range(3 * int(head[HANDS])):
        scratch.column[k] = scratch.hand[k]
    row, quiet = int(memory.numbers[INDEX]), 0
    for step in range(_BRAKING_STEPS + 2 * window):
        moving = False
        for i in range(m):
            change = bounds.acceleration[i] * dt
            if step < window:
                dropped = past[(row + step) % window, i]
            else:
                dropped = (
                    _decayed(scratch.asked[i], (step - window) * change)
                    if step > window
                    else scratch.asked[i]
                )
            sums[i] += trial[i] - dropped
            if bounds.is_joint[i] != 0.0:
                look[i] += dt * sums[i] / window
                config[int(bounds.coordinate[i])] = look[i]
                trial[i] = braked(trial[i], change)
                moving = moving or trial[i] != 0.0
        if not is_inside(robot, config, bounds, 0.0, scratch.frames, scratch.ahead):
            return False
        share_of_speed = _BRAKING_HAND if step else 1.0 + _ROUNDING
        limit = head[HAND_SPEED_LIMIT] * dt * share_of_speed
        if not _distance(bounds.head, scratch.ahead, scratch.column) <= limit:
            return False
        for k in range(3 * int(head[HANDS])):
            scratch.column[k] = scratch.ahead[k]
        quiet = 0 if moving else quiet + 1
        if quiet >= window:
            return True
    return False
