"""Distance of a base from zones on the floor, kept in each period and while it brakes."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import apart, inline
from dqcontrol.limits.braking import braking_share, largest_share
from dqcontrol.robots.kinematics.driving import advance, steer
from dqcontrol.supervisor.interventions import IMPOSSIBLE, KEEP_OUT
from dqcontrol.supervisor.supervisor_layout import (
    DT,
    FOOTPRINT,
    INDEX,
    KEEP_OUT_MARGIN,
    WINDOW,
    taken_apart,
)

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
    period = bounds.head[DT]
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
    m, period, window = rates.shape[0], head[DT], int(head[WINDOW])
    config, sent, asked, sums = scratch.config, scratch.look, scratch.asked, scratch.sums
    inputs = 2 if m < config.shape[0] else 3
    shares, kept = scratch.column[0:inputs], head[FOOTPRINT] + head[KEEP_OUT_MARGIN]
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
    row, quiet = int(memory.numbers[INDEX]), 0
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
    parts = taken_apart(memory, state)
    bounds, scratch = parts.bounds, parts.scratch
    share, is_clear = largest_share(_stays_clear, parts, _LEAST_SHARE)
    if share == 1.0:
        return 0
    rates, inputs = scratch.rates, 2 if scratch.rates.shape[0] < scratch.config.shape[0] else 3
    for i in range(inputs):
        rates[i] = scratch.asked[i]
    if inputs == 2:
        steer(bounds.drives, rates)
    return KEEP_OUT if is_clear else KEEP_OUT | IMPOSSIBLE
