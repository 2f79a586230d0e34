"""Bounds on the end effector: distance from singularities, workspace box, speed and acceleration.

What only some supervisors do, or only near a limit, is a function `apart`, which takes the two arrays as they are.
"""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import translation
from dqcontrol.algebra.symmetric import smallest_singular_value
from dqcontrol.compiled.compile import OK, apart, inline
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.limits.rates import braked, largest_share
from dqcontrol.robots.kinematics.kinematics_kernels import call_chain, hand_jacobian, joint_frames
from dqcontrol.robots.kinematics.pose_task_kernels import place_tree
from dqcontrol.robots.kinematics.singular_bound import exceeds
from dqcontrol.supervisor import interventions as reason, supervisor_layout as layout

_FAR = 1.1  # share of the singular value that slows: further away it is not computed
# Whoever brakes longer than that goes no faster: 2 s at 1 ms. Each step takes the kinematics of all links; those of
# a base alone, in `supervisor_step`, do not, and are ten times as many.
_BRAKING_STEPS = 2000
_ROUNDING = 1e-9  # share of a limit
# A hand that turns goes a chord: scaled once it would be a little too fast, and `_stays_safe` would halve its rates.
# Each time leaves a hundredth of that or less, as long as the hand turns by less than 0.3 rad a period.
_SCALINGS = 6
_AT_SIDE = 1e-12  # m: who brakes to the side of the box is beyond it by rounding, some 1e-16 m a joint
_LEAST_SHARE = 0.2  # of what is wanted beyond full braking
_BRAKING_HAND = 1.1  # share of the end effector's speed limit while braking: joints stop at different times


@inline
def _write_hand_jacobian(scratch):
    """Write the Jacobian of the end effector's [ω ; ṗ], from what kinematics wrote."""
    buffer, hand, m = scratch.buffer, scratch.hand, scratch.rates.shape[0]
    translation(buffer[0:8], hand)
    twist_jacobian = as_matrix(buffer[8 + 8 * m : 8 + 14 * m], 6, m)
    hand_jacobian((hand[0], hand[1], hand[2]), twist_jacobian, scratch.jacobian)


@inline
def avoid_singularity(kinematics, known, memory, state, parts):
    """Slow the rates, or hold, where they lead towards a singularity; return which."""
    kept, scratch = parts.memory, parts.scratch
    if known == 0.0 and call_chain(kinematics, parts.table, kept.good, scratch.buffer) != OK:
        return 0
    _write_hand_jacobian(scratch)
    if exceeds(scratch.jacobian, _FAR * parts.bounds.head[layout.SLOW]):
        kept.numbers[layout.HOLDING] = 0.0
        return 0
    return _slow_down(kinematics, memory, state)


@apart
def _slow_down(kinematics, memory, state):
    """Do what `avoid_singularity` does where a singularity may be near."""
    table, _, bounds, kept, scratch = layout.taken_apart(memory, state)
    good, rates, input_coordinates, is_joint = kept.good, scratch.rates, bounds.coordinate, bounds.is_joint
    n, m, config = good.shape[0], rates.shape[0], scratch.config
    slow, hold = bounds.head[layout.SLOW], bounds.head[layout.HOLD]
    here, ahead = 0.0, 0.0
    for look in range(2):
        if look == 1:
            fastest = 0.0
            for i in range(m):
                if is_joint[i] != 0.0:
                    fastest = max(fastest, abs(rates[i]))
            if fastest == 0.0:
                return 0
            for i in range(n):
                config[i] = good[i]
            for i in range(m):
                if is_joint[i] != 0.0:
                    config[int(input_coordinates[i])] += 1e-3 * rates[i] / fastest
            if call_chain(kinematics, table, config, scratch.buffer) != OK:
                return 0
            _write_hand_jacobian(scratch)
        value = smallest_singular_value(scratch.jacobian, scratch.gram, scratch.vectors)
        if look == 0:
            here = value
            if here > 0.5 * (slow + hold):
                kept.numbers[layout.HOLDING] = 0.0
            if here >= slow:
                return 0
        else:
            ahead = value
    if ahead >= here:
        return 0
    if here <= hold:
        kept.numbers[layout.HOLDING] = 1.0
    scale = (here - hold) / (slow - hold) if slow > hold and kept.numbers[layout.HOLDING] == 0.0 else 0.0
    for i in range(m):
        rates[i] *= scale
    return reason.SLOWED if scale > 0.0 else reason.HELD


@apart
def place_robot(table, tree, config, frames):
    """Write the poses of all joints, then of the end effectors."""
    if tree.shape[0] > 0:
        return place_tree(tree, config, frames)
    return joint_frames(table, config, frames)


@inline
def is_inside(robot, config, bounds, tolerance, frames, hand):
    """Write where each end effector is, m; return whether all of them, and all points to be kept, are in the box."""
    if place_robot(robot.table, robot.tree, config, frames) != OK:
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
            inside = (
                inside and head[layout.BOX + i] - tolerance <= hand[i] <= head[layout.BOX + 3 + i] + tolerance
            )
    for k in range(int(head[layout.HANDS])):
        at = frames.shape[0] - 8 * (int(head[layout.HANDS]) - k)
        place = hand[3 * k : 3 * k + 3]
        translation(frames[at : at + 8], place)
        for i in range(3):
            inside = (
                inside
                and head[layout.BOX + i] - tolerance <= place[i] <= head[layout.BOX + 3 + i] + tolerance
            )
    return inside or head[layout.BOXED] == 0.0


@apart
def measured_outside(memory, state):
    """Return whether an end effector or a point of a link is measured outside the box, by more than is tolerated."""
    parts = layout.taken_apart(memory, state)
    bounds, kept, scratch = parts.bounds, parts.memory, parts.scratch
    tolerance = bounds.head[layout.HAND_TOLERANCE]
    return not is_inside(parts, kept.good, bounds, tolerance, scratch.frames, scratch.ahead)


@apart
def take_off_payload(memory, state):
    """Take off a wrench at the end effector, in its axes, what gravity exerts there on the payload.

    With R the end effector's rotation, W the payload's weight and c its centre the force −W Rᵀe_z and the torque c ×
    that.
    """
    table, tree, bounds, kept, scratch = layout.taken_apart(memory, state)
    frames, contact = scratch.frames, scratch.column
    place_robot(table, tree, kept.good, frames)
    hand, head = frames[frames.shape[0] - 8 :], bounds.head
    w, x, y, z, weight = hand[0], hand[1], hand[2], hand[3], head[layout.PAYLOAD_WEIGHT]
    a, b, c = head[layout.PAYLOAD_CENTER], head[layout.PAYLOAD_CENTER + 1], head[layout.PAYLOAD_CENTER + 2]
    fx = -2.0 * weight * (x * z - w * y)
    fy = -2.0 * weight * (y * z + w * x)
    fz = -weight * (1.0 - 2.0 * (x * x + y * y))
    contact[0] -= fx
    contact[1] -= fy
    contact[2] -= fz
    contact[3] -= b * fz - c * fy
    contact[4] -= c * fx - a * fz
    contact[5] -= a * fy - b * fx


@apart
def _commanded_hand(memory, state, ahead, hand):
    """Write where each end effector is commanded, m, ``ahead`` s later at the rates."""
    parts = layout.taken_apart(memory, state)
    bounds, kept, scratch = parts.bounds, parts.memory, parts.scratch
    config = scratch.config
    for i in range(config.shape[0]):
        config[i] = kept.good[i]
    for i in range(scratch.rates.shape[0]):
        if bounds.is_joint[i] != 0.0:
            config[int(bounds.coordinate[i])] = kept.sent[i] + ahead * scratch.rates[i]
    is_inside(parts, config, bounds, 0.0, scratch.frames, hand)


@inline
def _distance(head, a, b):
    """Return how far the end effector is from where it was, of several the farthest."""
    farthest = 0.0
    for k in range(0, 3 * int(head[layout.HANDS]), 3):
        away = math.sqrt((a[k] - b[k]) ** 2 + (a[k + 1] - b[k + 1]) ** 2 + (a[k + 2] - b[k + 2]) ** 2)
        farthest = max(farthest, away) if away == away else away
    return farthest


@apart
def limit_hand_speed(memory, state, is_bounded):
    """Write where end effectors are commanded; if ``is_bounded``, scale the rates so that they keep their speed.

    Return what was done.
    """
    _, _, bounds, kept, scratch = layout.taken_apart(memory, state)
    numbers, hand, ahead, rates = kept.numbers, scratch.hand, scratch.ahead, scratch.rates
    _commanded_hand(memory, state, 0.0, hand)
    if numbers[layout.STARTED] == 0.0:
        for i in range(3 * layout.MOST_HANDS):
            numbers[layout.HAND_BEFORE + i] = hand[i]
    limit, period = bounds.head[layout.HAND_SPEED_LIMIT], bounds.head[layout.DT]
    if not is_bounded or not limit < math.inf:
        return 0
    done = 0
    for _ in range(_SCALINGS):
        _commanded_hand(memory, state, period, ahead)
        speed = _distance(bounds.head, ahead, hand) / period
        if not speed > limit * (1.0 + 0.5 * _ROUNDING):
            break
        for i in range(rates.shape[0]):
            rates[i] *= limit / speed
        done = reason.HAND_SPEED
    return done


@apart
def limit_hand_acceleration(memory, state):
    """Take as much of the change of the rates as keeps the commanded end effector's acceleration; return what was done.

    With the share s of the change the end effector's acceleration is c + s d to first order in T: the largest s in 0 …
    1 with
    |c + s d| ≤ limit, or the s of the smallest acceleration if none keeps it (a bend that is run through too fast). Of
    several end effectors the least share.
    """
    _, _, bounds, kept, scratch = layout.taken_apart(memory, state)
    m, period = scratch.rates.shape[0], bounds.head[layout.DT]
    limit = bounds.head[layout.HAND_ACCELERATION_LIMIT]
    rates, rate, trial = scratch.rates, kept.rate, scratch.trial
    hands = int(bounds.head[layout.HANDS])
    _commanded_hand(memory, state, period, scratch.ahead)
    for i in range(3 * hands):  # the column holds x with all of the change, as it is overwritten below
        scratch.column[i] = scratch.ahead[i]
    for i in range(m):
        trial[i], rates[i] = rates[i], rate[i]
    _commanded_hand(memory, state, period, scratch.ahead)
    least = 1.0
    for k in range(hands):
        cc, cd, dd = 0.0, 0.0, 0.0
        for i in range(3 * k, 3 * k + 3):
            c = (scratch.ahead[i] - 2.0 * scratch.hand[i] + kept.numbers[layout.HAND_BEFORE + i]) / (
                period * period
            )
            d = (scratch.column[i] - scratch.ahead[i]) / (period * period)
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
    return reason.HAND_ACCELERATION if least < 1.0 else 0


@inline
def _decayed(rate, change):
    """Return a rate that has been braked by so much."""
    return math.copysign(max(abs(rate) - change, 0.0), rate)


@inline
def _stays_safe(parts, share):
    """Return whether commanded end effectors keep box and speed after these rates, and in each period of braking.

    The rates are those of full braking, and a share of what is wanted beyond. What is looked at is what is sent, after
    smoothing: rates from before still come out of its window when all joints brake.
    """
    bounds, memory, scratch = parts.bounds, parts.memory, parts.scratch
    head, past = bounds.head, memory.past
    m, period, window = scratch.rates.shape[0], head[layout.DT], int(head[layout.WINDOW])
    look, trial, sums, config = scratch.look, scratch.trial, scratch.sums, scratch.config
    for i in range(config.shape[0]):
        config[i] = memory.good[i]
    for i in range(m):
        safe = braked(memory.rate[i], bounds.acceleration[i] * period)
        scratch.asked[i] = trial[i] = safe + share * (scratch.rates[i] - safe)
        look[i], sums[i] = memory.sent[i], 0.0
        for k in range(window):
            sums[i] += past[k, i]
    for k in range(3 * int(head[layout.HANDS])):
        scratch.column[k] = scratch.hand[k]
    row, quiet = int(memory.numbers[layout.INDEX]), 0
    for step in range(_BRAKING_STEPS + 2 * window):
        moving = False
        for i in range(m):
            change = bounds.acceleration[i] * period
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
                look[i] += period * sums[i] / window
                config[int(bounds.coordinate[i])] = look[i]
                trial[i] = braked(trial[i], change)
                moving = moving or trial[i] != 0.0
        if not is_inside(parts, config, bounds, _AT_SIDE, scratch.frames, scratch.ahead):
            return False
        share_of_speed = _BRAKING_HAND if step else 1.0 + _ROUNDING
        limit = head[layout.HAND_SPEED_LIMIT] * period * share_of_speed
        if not _distance(head, scratch.ahead, scratch.column) <= limit:
            return False
        for k in range(3 * int(head[layout.HANDS])):
            scratch.column[k] = scratch.ahead[k]
        quiet = 0 if moving else quiet + 1
        if quiet >= window:
            return True
    return False


@apart
def keep_safe(memory, state):
    """Mix the rates with full braking until the end effectors keep box and speed; return what was done."""
    parts = layout.taken_apart(memory, state)
    bounds, kept, scratch = parts.bounds, parts.memory, parts.scratch
    share, is_safe = largest_share(_stays_safe, parts, _LEAST_SHARE)
    if share == 1.0:
        return 0
    for i in range(scratch.rates.shape[0]):
        safe = braked(kept.rate[i], bounds.acceleration[i] * bounds.head[layout.DT])
        scratch.rates[i] = safe + share * (scratch.rates[i] - safe)
    done = reason.WORKSPACE if bounds.head[layout.BOXED] != 0.0 else reason.HAND_SPEED
    return done if is_safe else done | reason.IMPOSSIBLE
