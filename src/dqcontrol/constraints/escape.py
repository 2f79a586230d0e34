"""Recovery from a deadlock, compiled: joints go to postures spread over their ranges, one a try.

A hand that is held at the end of a joint's range, or in its turning, is not freed by moving it aside: another posture
of the arm is. From there the law goes on towards its goal.
"""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline, shared

_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_MIDDLE = 0.7  # share of a range that postures are in
_RATE = 4.0  # 1/s
_NEAR = 0.1  # rad or m
_AT_BOUND = 1e-6  # rad/s or m/s: of a solution, less is rounding


@shared
def range_ends_pressed(limits, box, wish, u):
    """Return how many joints a command would move beyond their range, or too fast to stop at its end."""
    count = 0
    for j in range(u.shape[0]):
        up, down = box.rough_high[j], box.rough_low[j]
        if up < limits.velocity[j] and u[j] > up - _AT_BOUND and wish[j] > up:
            count += 1
        if down > -limits.velocity[j] and u[j] < down + _AT_BOUND and wish[j] < down:
            count += 1
    return count


@inline
def _place_in_range(number, j):
    """Return where in its range joint j is in a posture, 0 to 1: the middle at first, then spread evenly."""
    shift = 0.5 + number * (j + 1.0) * _GOLDEN
    return 0.5 + _MIDDLE * (shift - math.floor(shift) - 0.5)


@shared
def go_to_posture(limits, coordinate, config, number, u):
    """Write speeds towards a posture, the fastest joint at its limit of velocity; return whether it is near.

    Inputs without both limits rest.
    """
    farthest, share = 0.0, 1.0
    for j in range(u.shape[0]):
        u[j] = 0.0
        span = limits.upper[j] - limits.lower[j]
        if span < math.inf:
            place = limits.lower[j] + span * _place_in_range(number, j)
            away = place - config[int(coordinate[j])]
            farthest = max(farthest, abs(away))
            u[j] = _RATE * away
            if abs(u[j]) > limits.velocity[j]:
                share = min(share, limits.velocity[j] / abs(u[j]))
    for j in range(u.shape[0]):
        u[j] *= share
    return farthest < _NEAR
