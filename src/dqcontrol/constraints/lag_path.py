"""The way that joints make to targets which they follow late: the points of it that keep constraints.

A joint with time constant τᵢ and delay Dᵢ goes, as long as its target zᵢ stands, from yᵢ to it:
yᵢ + (1 − e^(−r/τᵢ)) (zᵢ − yᵢ). The way of all is that curve, from where they are to where all targets are, by the share
s = 1 − e^(−r/τ) that the slowest joint, τ, has made. What keeps its distance on the whole way keeps it if no command
comes any more; and a command that leaves the new way clear leaves the period clear that follows, which is the first
part of that way. So distances of the way, not those of targets, are what a law keeps.

Things that move are met where they are then: a way that targets lead along with something moves with it, and its point
s meets what is there D + T s/(1 − e^(−T/τ)) later. Joints without lag are the way of one point, their target.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.robots.robot import Lag

_POINTS = 4  # how far the way bends off the chords between them is found and kept beside
_BETWEEN = 200  # instants between two points at which a way is compared with the line between them


class WayToTargets(NamedTuple):
    """Points of the way, the last of which is the target.

    Attributes
    ----------
    shares
        How far each coordinate has come at each point, shape (points, n).
    meets
        Of each point how much later it meets what moves, s, and the share s: shape (points, 2).
    bent
        By which share of its way each coordinate is off the lines between points at most, shape (n,).
    early
        How much earlier than said something may be met, s.
    apart
        How much less than the longest delay each coordinate has, s, shape (n,).
    late
        How much later the target meets what moves, s.
    """

    shares: Array
    meets: Array
    bent: Array
    early: float
    apart: Array
    late: float


def lag_path(lag: Lag, n: int, period: float) -> WayToTargets:
    """Return the points of the way of n joints with a lag."""
    times, delays = np.array(lag.times or np.zeros(n)), np.array(lag.delays or np.zeros(n))
    slowest, delay = float(times.max(initial=0.0)), float(delays.max(initial=0.0))
    if slowest == 0.0:
        return WayToTargets(
            np.ones((1, n)), np.array([[delay, 1.0]]), np.zeros(n), 0.0, delay - delays, delay
        )
    first = -math.expm1(-period / slowest)  # the share of the period that follows
    follows = period / first
    points = np.arange(1, _POINTS + 1) / _POINTS
    if (times == 0).any():  # what has no lag stands still after the period
        points = np.unique([*points, first])
    ends = np.concatenate([[0.0], points])
    bent = np.zeros(n)
    for low, high in pairwise(ends.tolist()):
        line = np.linspace(0.0, 1.0, _BETWEEN)[:, None]
        at_ends = _shares(np.array([low, high]), times, slowest, period)
        between = _shares(low + (high - low) * line[:, 0], times, slowest, period)
        bent = np.maximum(bent, np.abs(between - at_ends[0] - line * (at_ends[1] - at_ends[0])).max(axis=0))
    return WayToTargets(
        _shares(points, times, slowest, period),
        np.column_stack([delay + (follows - period) * points, points]),
        bent,
        follows - slowest - slowest * math.log(follows / slowest),
        delay - delays,
        delay + follows,
    )


def _shares(slow: Array, times: Array, slowest: float, period: float) -> Array:
    """Return how far each coordinate has come where the slowest has made these shares, shape (shares, n)."""
    with np.errstate(divide="ignore"):
        instants = -slowest * np.log1p(-slow)[:, None]
        lagging = -np.expm1(-instants / np.where(times > 0, times, 1.0))
    return np.where(times > 0, lagging, np.minimum(instants / period, 1.0))
