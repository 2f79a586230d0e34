"""Jerk-limited progress from rest to rest: the S-curve of seven phases, in closed form.

Jerk is +j, 0, −j while speeding up, 0 while cruising and −j, 0, +j while braking. From rest to rest with
limits that are the same both ways, these seven phases take the least time that the limits allow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dqcontrol.arrays import Array


@dataclass(frozen=True)
class MotionLimits:
    """How fast progress may be made: greatest speed, acceleration and jerk, in units per s, s², s³."""

    speed: float
    acceleration: float
    jerk: float


def phases(length: float, limits: MotionLimits) -> tuple[float, float, float]:
    """Return how long jerk lasts (each of four times), full acceleration (each of two), and cruising, s.

    Parameters
    ----------
    length
        How far to go, > 0.
    limits
        All > 0.

    Examples
    --------
    >>> phases(1.0, MotionLimits(speed=0.5, acceleration=1.0, jerk=4.0))
    (0.25, 0.25, 1.25)
    """
    v, a, j = limits.speed, limits.acceleration, limits.jerk
    ramp = a / j if v * j > a * a else math.sqrt(v / j)
    flat = max(0.0, v / a - ramp)
    if length >= v * (2 * ramp + flat):
        return ramp, flat, length / v - (2 * ramp + flat)
    if length > 2 * a * (a / j) ** 2:  # brakes before it is at full speed, but at full acceleration
        ramp = a / j
        reached = 2 * length / (ramp + math.sqrt(ramp * ramp + 4 * length / a))
        return ramp, max(0.0, reached / a - ramp), 0.0
    return math.cbrt(0.5 * length / j), 0.0, 0.0


def s_curve(length: float, limits: MotionLimits) -> tuple[Array, float]:
    """Return the progress over time as cubic pieces, and how long it takes, s.

    Braking mirrors speeding up and is anchored at its end, so that rest is reached exactly.

    Returns
    -------
    pieces
        Shape (n, 6): start of the piece, s; its anchor, s; there the progress, its rate, acceleration and jerk.
    seconds
        s.
    """
    ramp, flat, cruise = phases(length, limits)
    rise = 2 * ramp + flat
    seconds = 2 * rise + cruise
    rows, time, p, v, a = [], 0.0, 0.0, 0.0, 0.0
    for duration, jerk in ((ramp, limits.jerk), (flat, 0.0), (ramp, -limits.jerk)):
        if duration > 0.0:
            rows.append((time, time, p, v, a, jerk))
        p += duration * (v + duration * (0.5 * a + duration * jerk / 6))
        v += duration * (a + duration * 0.5 * jerk)
        a += duration * jerk
        time += duration
    ends = [row[0] for row in rows[1:]] + [rise]
    braking = [
        (seconds - end, seconds - begin, length - p, v, -a, jerk)
        for (begin, _, p, v, a, jerk), end in zip(reversed(rows), reversed(ends), strict=True)
    ]
    if cruise > 0.0:
        rows.append((rise, rise, p, v, 0.0, 0.0))
    return np.array(rows + braking), seconds


def progress_at(pieces: Array, times: Array) -> tuple[Array, Array, Array]:
    """Return progress, rate and acceleration (N,) of cubic pieces, (N, 6) as of `s_curve`, at times (N,), s."""
    _, anchor, p, v, a, jerk = pieces.T
    t = times - anchor
    return p + t * (v + t * (0.5 * a + t * jerk / 6)), v + t * (a + 0.5 * t * jerk), a + t * jerk
