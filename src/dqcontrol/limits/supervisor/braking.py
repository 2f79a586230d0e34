"""Rates from which a joint can still stop in time, exactly in samples."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

_MORE = 1.01
_SMOOTH = 1e12  # steps² of braking from which on sampling no longer matters


@inline
def fastest_stoppable(distance, acceleration, dt):
    """Return the largest rate v ≥ 0 that can be held for one period and braked to 0 within a room.

    Braking by aT a period from v covers T (v + (v − aT) + (v − 2aT) + …) = T (N v − aT N (N − 1)/2), N = ⌈v/(aT)⌉;
    N is the smallest integer with aT² N (N + 1)/2 ≥ room.
    """
    if distance <= 0.0 or acceleration <= 0.0:
        return 0.0
    if distance == math.inf:
        return math.inf
    if acceleration == math.inf:
        return distance / dt
    step = acceleration * dt
    ratio = distance / (step * dt)
    if not ratio < _SMOOTH:
        return math.sqrt(2.0 * acceleration) * math.sqrt(distance) * (1.0 - 1e-6)
    count = max(math.ceil(0.5 * (math.sqrt(1.0 + 8.0 * ratio) - 1.0)), 1.0)
    return (distance / dt + 0.5 * step * count * (count - 1.0)) / count


@inline
def surely_stops(room, rate, acceleration, dt):
    """Return True only if `fastest_stoppable` is at least this rate: without what that takes to find out.

    From v a joint stops within v²/(2a) + vT; a hundredth more is more than all rounding.
    """
    return 2.0 * acceleration * room > _MORE * (rate * (rate + 2.0 * acceleration * dt))


@inline
def braked(rate, step):
    """Return a rate after one period of braking by at most ``step``."""
    return rate - min(max(rate, -step), step)
