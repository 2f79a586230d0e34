"""One step of the supervisor, compiled: what leaves of what a law wants, and how far bases keep from zones."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import OK, STATUS, WRITE, WRONG_SIZE, apart, inline, kernel
from dqcontrol.limits.rates import (
    SpeedLimits,
    braking_share,
    fastest_stoppable,
    largest_share,
    scale_down,
    scale_down_rollers,
    surely_stops,
)
from dqcontrol.robots.kinematics.driving import RIM_LEVER, advance, drive_speeds, rim_load, steer
from dqcontrol.supervisor import interventions as reason, supervisor_geometry, supervisor_layout as layout
from dqcontrol.supervisor.supervisor_watch import judge

_BRAKING_STEPS = 20_000  # whoever brakes longer than that goes no faster; see `supervisor_geometry`
_LEAST_SHARE = 0.1  # of what is wanted beyond full braking


@inline
def clearance(zones, x, y):
    """Return how far a point is from the nearest zone, m; negative inside one.

    A row is an edge of a polygon, or the middle of a disc twice; its radius; and 1 if it is the last of its zone.
    """
    least, holds, inside = math.inf, False, False
    for k in range(zones.shape[0]):
        ax, ay, bx, by = zones[k, 0], zones[k, 1], zones[k, 2], zones[k, 3]
        dx, dy, px, py = bx - ax, by - ay, x - ax, y - ay
        length = dx * dx + dy * dy
        share = min(max((px * dx + py * dy) / length, 0.0), 1.0) if length > 0.0 else 0.0
        least = min(least, math.sqrt((px - share * dx) ** 2 + (py - share * dy) ** 2) - zones[k, 4])
        if (ay > y) != (by > y) and px < py / dy * dx:
            holds = not holds
        if zones[k, 5] != 0.0:
            inside, holds = inside or holds, False
    return -abs(least) if inside else least


@inline
def _braking_shares(bounds, rate, out):
    """Write the share of each of the base's inputs that one period of braking takes.

    A drive brakes on its arc, a base on rollers along its way: so none of their rims becomes faster.
    """
    period = bounds.head[layout.DT]
    for i in range(out.shape[0]):
        out[i] = braking_share(rate[i], bounds.acceleration[i] * period)
    if bounds.drives.shape[0] > 0:
        out[0] = out[1] = min(out[0], out[1])
    if bounds.rollers.shape[0] > 0:
        out[0] = out[1] = out[2] = min(out[0], out[1], out[2])


@inline
def _stays_clear(parts, share):
    """Return whether the base keeps clear after these rates, and in each period of braking from them.

    The rates are those of full braking, and a share of what is wanted beyond; what is looked at is what is sent, after
    smoothing. On an arc of length w that turns by φ, a distance that is d at its ends is at least d − w²/(8d) − wφ/8
    between them. A base that is too near already is clear of what it comes no nearer to.
    """
    bounds, memory, scratch = parts.bounds, parts.memory, parts.scratch
    head, past, rates = bounds.head, memory.past, scratch.rates
    m, period, window = rates.shape[0], head[layout.DT], int(head[layout.WINDOW])
    config, sent, asked, sums = scratch.config, scratch.look, scratch.asked, scratch.sums
    inputs = 2 if m < config.shape[0] else 3
    shares, kept = scratch.column[0:inputs], head[layout.FOOTPRINT] + head[layout.KEEP_OUT_MARGIN]
    for i in range(config.shape[0]):
        config[i] = memory.good[i]
    for i in range(m):
        sent[i] = 0.0
    _braking_shares(bounds, memory.rate, shares)
    for i in range(inputs):
        safe = memory.rate[i] * (1.0 - shares[i])
        asked[i] = safe + share * (rates[i] - safe)
        sums[i] = 0.0
        for k in range(window):
            sums[i] += past[k, i]
    _braking_shares(bounds, asked, shares)
    row, quiet = int(memory.numbers[layout.INDEX]), 0
    before = clearance(bounds.zones, config[0], config[1])
    for step in range(_BRAKING_STEPS + 2 * window):
        moving = False
        for i in range(inputs):
            now = asked[i] * max(1.0 - step * shares[i], 0.0)
            then = past[(row + step) % window, i]
            if step >= window:
                then = asked[i] * max(1.0 - (step - window) * shares[i], 0.0)
            sums[i] += now - then
            sent[i] = sums[i] / window
            moving = moving or now != 0.0
        x, y, heading = config[0], config[1], config[2]
        advance(bounds.drives, sent, period, config)
        way = math.sqrt((config[0] - x) ** 2 + (config[1] - y) ** 2)
        between = 0.125 * way * (way / kept + abs(config[2] - heading))
        nearest = before - way  # at worst; the distance itself takes longer
        if nearest < kept + between:
            nearest = clearance(bounds.zones, config[0], config[1])
            if nearest < kept + between and (before >= kept + between or nearest < before):
                return False
        before = nearest
        quiet = 0 if moving else quiet + 1
        if quiet > window:
            return True
    return False


@apart
def keep_out(memory, state):
    """Mix the base's rates with full braking until it keeps clear of all zones; return what was done."""
    parts = layout.taken_apart(memory, state)
    bounds, scratch = parts.bounds, parts.scratch
    share, is_clear = largest_share(_stays_clear, parts, _LEAST_SHARE)
    if share == 1.0:
        return 0
    rates, inputs = scratch.rates, 2 if scratch.rates.shape[0] < scratch.config.shape[0] else 3
    for i in range(inputs):
        rates[i] = scratch.asked[i]
    if inputs == 2:
        steer(bounds.drives, rates)
    return reason.KEEP_OUT if is_clear else reason.KEEP_OUT | reason.IMPOSSIBLE


_MOST = 1e9  # of wanted rates: beyond that only the direction matters
_ROUNDING = 1e-9  # relative

# memory, state
START = STATUS(WRITE, WRITE)


@inline
def _want(wanted, following, wrong, bounds, memory, rates):
    """Write the rates that law, return or stop want."""
    head, numbers, period = bounds.head, memory.numbers, bounds.head[layout.DT]
    for i in range(rates.shape[0]):
        goal = memory.good[int(bounds.coordinate[i])]
        rates[i] = 0.0
        if following:
            rates[i] = wanted[i]
            if head[layout.FROM_MEASURED] != 0.0 and bounds.is_joint[i] != 0.0:
                rates[i] += (goal - memory.position[i]) / period
            rates[i] = min(max(rates[i], -_MOST), _MOST) * numbers[layout.SCALE]
        elif numbers[layout.MODE] == layout.RETURNING and not wrong and bounds.is_joint[i] != 0.0:
            room = abs(goal - memory.position[i])
            rates[i] = math.copysign(
                min(fastest_stoppable(room, bounds.acceleration[i], period), _MOST), goal - memory.position[i]
            )


@inline
def _accelerate(bounds, memory, rates):
    """Bring both inputs of each drive within reach by the same share, so that the rims keep their limit."""
    done, rate = 0, memory.rate
    for k in range(bounds.drives.shape[0]):
        first = int(bounds.drives[k, 0]) - k
        share = 1.0
        for i in range(first, first + 2):
            change, step = abs(rates[i] - rate[i]), bounds.acceleration[i] * bounds.head[layout.DT]
            if change * share > step:
                share = step / change
        if share < 1.0:
            done |= reason.ACCELERATION
            for i in range(first, first + 2):
                rates[i] = rate[i] + share * (rates[i] - rate[i])
    return done


@inline
def _keep(bounds, memory, rates, inwards):
    """Bring rates within reach of the present ones, and to those from which joints stop within their limits.

    A joint that is outside, because it started there or its limits moved, is brought in by a share ``inwards`` of what
    it can stop from. Where not all is possible together, the acceleration is kept.
    """
    done, period = 0, bounds.head[layout.DT]
    for i in range(rates.shape[0]):
        rate, step = memory.rate[i], bounds.acceleration[i] * period
        low, high = -bounds.velocity[i], bounds.velocity[i]
        below, above = memory.position[i] - bounds.lower[i], bounds.upper[i] - memory.position[i]
        is_free = surely_stops(min(below, above), high, bounds.acceleration[i], period)
        if bounds.is_joint[i] != 0.0 and not is_free:
            least = -fastest_stoppable(below, bounds.acceleration[i], period)
            most = fastest_stoppable(above, bounds.acceleration[i], period)
            if below < 0.0:
                least = inwards * fastest_stoppable(-below, bounds.acceleration[i], period)
            if above < 0.0:
                most = -inwards * fastest_stoppable(-above, bounds.acceleration[i], period)
            low, high = min(max(low, least), bounds.velocity[i]), max(min(high, most), -bounds.velocity[i])
            if low > high:
                low, high = 0.0, 0.0
            if rates[i] < least or rates[i] > most:
                done |= reason.POSITION
        reached = min(max(rates[i], low), high)
        kept = min(max(reached, rate - step), rate + step)
        if abs(kept - reached) > _ROUNDING:
            done |= reason.ACCELERATION
        rates[i] = kept
    return done


@inline
def _keep_rims(bounds, memory, rates):
    """Mix the rates of each base on rollers with braking it along its way, until each rim keeps its limit.

    Both are within reach of the present rates, and so is all between them; a rim's speed is linear in the share.
    """
    done, rollers, rate, period = 0, bounds.rollers, memory.rate, bounds.head[layout.DT]
    for k in range(rollers.shape[0]):
        first, load = int(rollers[k, 0]), rim_load(rollers, k, memory.good, rates)
        if abs(load) <= 1.0:
            continue
        left = 1.0
        for i in range(first, first + 3):
            left = min(left, braking_share(rate[i], bounds.acceleration[i] * period))
        left = 1.0 - left
        safe = left * rim_load(rollers, k, memory.good, rate)
        share = 0.0
        if abs(safe) < 1.0:
            share = (math.copysign(1.0, load) - safe) / (load - safe)
        for i in range(first, first + 3):
            rates[i] = left * rate[i] + share * (rates[i] - left * rate[i])
        done |= reason.VELOCITY
    return done


@inline
def _breaks_bounds(bounds, memory):
    """Return whether what leaves is beyond a limit of position or speed, which moved or was exceeded at the start."""
    found = False
    m, n = memory.sent.shape[0], memory.good.shape[0]
    for i in range(m):
        sent, lower, upper = memory.sent[i], bounds.lower[i], bounds.upper[i]
        found = found or abs(memory.sent_rate[i]) > bounds.velocity[i] * (1.0 + _ROUNDING)
        if bounds.is_joint[i] != 0.0 and not lower <= sent <= upper:
            slack = _ROUNDING * max(1.0, abs(sent))
            found = found or sent < lower - slack or sent > upper + slack
    for k in range(bounds.drives.shape[0]):
        v, omega = drive_speeds(bounds.drives, k, memory.sent_rate, memory.good)
        fastest = bounds.velocity[int(bounds.drives[k, 0]) - (k if m < n else 0)]
        found = found or abs(v) + bounds.drives[k, RIM_LEVER] * abs(omega) > fastest * (1.0 + _ROUNDING)
    for k in range(bounds.rollers.shape[0]):
        found = found or abs(rim_load(bounds.rollers, k, memory.good, memory.sent_rate)) > 1.0 + _ROUNDING
    return found


@inline
def _moved(position, way, lower, upper):
    """Return a position after a way; what ends beyond a limit by rounding alone ends on it."""
    after = position + way
    if lower <= after <= upper:
        return after
    slack = _ROUNDING * max(1.0, abs(after))
    if position <= upper < after <= upper + slack:
        return upper
    if position >= lower > after >= lower - slack:
        return lower
    return after


@inline
def _commit(bounds, memory, rates):
    """Move the position command, smoothed over the window; return whether all is at rest."""
    numbers, past, period = memory.numbers, memory.past, bounds.head[layout.DT]
    window = past.shape[0]
    row = int(numbers[layout.INDEX])
    numbers[layout.INDEX] = float((row + 1) % window)
    still = True
    for i in range(rates.shape[0]):
        lower, upper = bounds.lower[i], bounds.upper[i]
        memory.rate[i] = past[row, i] = rates[i]
        memory.position[i] = _moved(memory.position[i], period * rates[i], lower, upper)
        total = 0.0
        for k in range(window):
            total += past[k, i]
        mean = total / window
        if abs(mean) <= bounds.velocity[i] * (1.0 + _ROUNDING):
            mean = min(max(mean, -bounds.velocity[i]), bounds.velocity[i])
        memory.sent_rate[i] = mean
        memory.sent[i] = _moved(memory.sent[i], period * mean, lower, upper)
        still = still and mean == 0.0
    return still


@kernel(START)
def check_start(memory, state):
    """Return OK if a robot may start as its state says: end effectors and points in their box, its base in no zone."""
    parts = layout.taken_apart(memory, state)
    bounds, kept, scratch = parts.bounds, parts.memory, parts.scratch
    if not supervisor_geometry.is_inside(parts, kept.good, bounds, 0.0, scratch.frames, scratch.ahead):
        return layout.OUTSIDE_BOX
    room = clearance(bounds.zones, kept.good[0], kept.good[1]) if bounds.zones.shape[0] > 0 else math.inf
    return layout.IN_ZONE if room < bounds.head[layout.FOOTPRINT] else OK


@kernel(layout.SUPERVISOR)
def supervise(kinematics, memory, moment, measured, wanted, effort, wrench, state, out):
    """Write the inputs that leave, and move the position command in the state; return AT_REST once stopped.

    Effort and wrench are arrays of their own, as the robot's driver hands them over: to copy them takes longer.
    """
    sizes, parts = layout.sizes_of(memory[layout.SIZES : layout.HEAD]), layout.taken_apart(memory, state)
    n, m = sizes.coordinates, sizes.inputs
    bounds, kept, scratch = parts.bounds, parts.memory, parts.scratch
    if (
        measured.shape[0] != n
        or wanted.shape[0] != m
        or out.shape[0] != m
        or kept.past.shape[0] != int(memory[layout.WINDOW])
        or (effort.shape[0] != 0 and effort.shape[0] != m)
        or (wrench.shape[0] != 0 and wrench.shape[0] != 6)
    ):
        return WRONG_SIZE
    head, numbers, rates = bounds.head, kept.numbers, scratch.rates

    at_rest = True
    for i in range(m):
        at_rest = at_rest and kept.sent_rate[i] == 0.0
    said = layout.moment_layout(moment)
    wrong = judge(memory, state, parts, said, measured, wanted, effort, wrench, at_rest)
    now = wrong
    aim = 1.0 if numbers[layout.MODE] == layout.RUNNING and numbers[layout.ENDING] == 0.0 else 0.0
    numbers[layout.SCALE] = min(
        max(aim, numbers[layout.SCALE] - head[layout.RAMP]), numbers[layout.SCALE] + head[layout.RAMP]
    )

    following = numbers[layout.MODE] == layout.RUNNING and not wrong
    returning = numbers[layout.MODE] == layout.RETURNING and not wrong
    _want(wanted, following, wrong, bounds, kept, rates)
    if numbers[layout.ENDING] != 0.0 and numbers[layout.MODE] == layout.RUNNING:
        now |= reason.SOFT_STOP
    if numbers[layout.MODE] == layout.RETURNING:
        now |= reason.REJOINING
    if following and head[layout.SLOW] > 0.0:
        now |= supervisor_geometry.avoid_singularity(
            kinematics, said.known, memory, state, parts
        )  # good is measured: nothing was wrong
    for i in range(m):
        scratch.asked[i] = rates[i]
    if bounds.rollers.shape[0] > 0:
        scale_down_rollers(kept.good, bounds.rollers, rates)
    scale_down(kept.good, SpeedLimits(bounds.velocity, bounds.drives), rates)
    for i in range(m):
        if rates[i] != scratch.asked[i] and following:
            now |= reason.VELOCITY
        rates[i] = min(max(rates[i], -bounds.velocity[i]), bounds.velocity[i])
    looks_at_hand = (
        head[layout.HAND_SPEED_LIMIT] < math.inf or head[layout.HAND_ACCELERATION_LIMIT] < math.inf
    )
    if looks_at_hand:
        now |= supervisor_geometry.limit_hand_speed(memory, state, following or returning)
    done = _accelerate(bounds, kept, rates)
    if following and head[layout.HAND_ACCELERATION_LIMIT] < math.inf:
        now |= supervisor_geometry.limit_hand_acceleration(memory, state)
    inwards = numbers[layout.SCALE] if following else (1.0 if returning else 0.0)
    done |= _keep(bounds, kept, rates, inwards)
    if m < n:
        steer(bounds.drives, rates)
    if head[layout.BOXED] != 0.0 or head[layout.HAND_SPEED_LIMIT] < math.inf:
        now |= supervisor_geometry.keep_safe(memory, state)
    done |= _keep_rims(bounds, kept, rates)
    if following:
        now |= done
    if sizes.zones > 0:
        now |= keep_out(memory, state)
    if looks_at_hand:
        numbers[layout.STARTED] = 1.0
        for i in range(3 * layout.MOST_HANDS):
            numbers[layout.HAND_BEFORE + i] = scratch.hand[i]
    still = _commit(bounds, kept, rates)
    if _breaks_bounds(bounds, kept):
        now |= reason.IMPOSSIBLE
    for i in range(m):
        out[i] = kept.sent_rate[i]
        if head[layout.FROM_MEASURED] != 0.0 and bounds.is_joint[i] != 0.0:
            out[i] = (kept.sent[i] - kept.good[int(bounds.coordinate[i])]) / head[layout.DT]
    if numbers[layout.MODE] == layout.STOPPED:
        now |= int(numbers[layout.FAULT])
    numbers[layout.NOW] = float(now)
    return layout.AT_REST if numbers[layout.MODE] == layout.STOPPED and still else OK
