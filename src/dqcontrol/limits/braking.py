"""Rates from which a joint can still stop in time, exactly in samples."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

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
