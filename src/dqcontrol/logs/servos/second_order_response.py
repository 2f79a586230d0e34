"""Answer of a second-order servo behind a delay to any targets, at any times, exactly."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE2, inline, kernel, types
from dqcontrol.logs.servos.lag_response import PiecewiseLinear
from dqcontrol.plants.servo.servo_step import free_response

OUTPUT, BY_BANDWIDTH, BY_DAMPING, BY_DELAY, POSITION_TRANSIENT, SPEED_TRANSIENT = range(6)
"""Columns of an answer: y, its slopes, what an initial position and an initial speed leave of it.

The slope by the delay is that of an answer that begins later as well; what that changes at the begin is in the span of
the transients.
"""

_OVER = 1e-14  # of a transient, what is nothing
_NEARLY_CRITICAL = 1e-3  # (ω_d h)² below which differences cancel


@inline
def _response_slopes(h, bandwidth, damping, first, second):
    """Return the slopes of φ₁ and φ₂ of `free_response` by ω, then by ζ.

    φ₂ = S and φ₁ = C + ζω S of C = e^(−ζωh) cos ω_d h, S = e^(−ζωh) sin(ω_d h)/ω_d; ω_d² = ω² (1 − ζ²) may be negative.
    """
    drag = damping * bandwidth
    cosine = first - drag * second
    square = bandwidth * bandwidth * (1.0 - damping * damping)
    u = square * h * h
    if -_NEARLY_CRITICAL < u < _NEARLY_CRITICAL:
        bend = second * h * h * (u / 30.0 - 1.0 / 3.0) / (1.0 - u / 6.0)
    else:
        bend = (h * cosine - second) / square
    half = bandwidth * (1.0 - damping * damping)
    second_by_bandwidth = half * bend - damping * h * second
    first_by_bandwidth = (
        damping * second + drag * second_by_bandwidth - damping * h * cosine - h * half * second
    )
    half = -bandwidth * bandwidth * damping
    second_by_damping = half * bend - bandwidth * h * second
    first_by_damping = (
        bandwidth * second + drag * second_by_damping - bandwidth * h * cosine - h * half * second
    )
    return first_by_bandwidth, second_by_bandwidth, first_by_damping, second_by_damping


@kernel(types.void(READ, READ, READ, types.float64, types.float64, types.float64, READ, WRITE2))
def _respond(begins, values, slopes, delay, bandwidth, damping, times, out):
    """Write y of y'' + 2ζω y' + ω² (y − v(t − delay)) = 0 at each time, its slopes and transients; y rests at v first.

    With v + m t from some event on, y − (v + m t − 2ζ m/ω) answers as without a target.
    """
    count, last = begins.shape[0], -1
    time, start = times[0], times[0]
    while last + 1 < count and begins[last + 1] + delay <= time:
        last += 1
    x = values[0] if last < 0 else values[last] + slopes[last] * (time - delay - begins[last])
    speed = 0.0
    by_bandwidth, speed_by_bandwidth, by_damping, speed_by_damping = 0.0, 0.0, 0.0, 0.0
    square, drag = bandwidth * bandwidth, 2.0 * damping * bandwidth
    transient, is_over = (1.0, 0.0), False
    for j in range(times.shape[0]):
        while True:
            is_step = last + 1 < count and begins[last + 1] + delay <= times[j]
            until = begins[last + 1] + delay if is_step else times[j]
            h = until - time
            if h > 0.0:
                v = values[0] if last < 0 else values[last] + slopes[last] * (time - delay - begins[last])
                m = 0.0 if last < 0 else slopes[last]
                behind = v - 2.0 * damping * m / bandwidth
                first, second = free_response(h, bandwidth, damping)
                slope = _response_slopes(h, bandwidth, damping, first, second)
                away, faster = x - behind, speed - m
                kept = first - drag * second
                # by bandwidth
                moved = 2.0 * damping * m / square
                apart = by_bandwidth - moved
                next_slope = (
                    moved + slope[0] * away + slope[1] * faster + first * apart + second * speed_by_bandwidth
                )
                speed_by_bandwidth = (
                    -(2.0 * bandwidth * second + square * slope[1]) * away
                    + (slope[0] - 2.0 * damping * second - drag * slope[1]) * faster
                    - square * second * apart
                    + kept * speed_by_bandwidth
                )
                by_bandwidth = next_slope
                # by damping
                moved = -2.0 * m / bandwidth
                apart = by_damping - moved
                next_slope = (
                    moved + slope[2] * away + slope[3] * faster + first * apart + second * speed_by_damping
                )
                speed_by_damping = (
                    -square * slope[3] * away
                    + (slope[2] - 2.0 * bandwidth * second - drag * slope[3]) * faster
                    - square * second * apart
                    + kept * speed_by_damping
                )
                by_damping = next_slope
                x = behind + m * h + first * away + second * faster
                speed = m - square * second * away + kept * faster
                time = until
            if not is_step:
                break
            last += 1
        if not is_over:
            transient = free_response(times[j] - start, bandwidth, damping)
            is_over = abs(transient[0]) + bandwidth * abs(transient[1]) < _OVER
        out[j, OUTPUT], out[j, BY_BANDWIDTH], out[j, BY_DAMPING] = x, by_bandwidth, by_damping
        out[j, BY_DELAY] = -speed
        out[j, POSITION_TRANSIENT], out[j, SPEED_TRANSIENT] = transient


def second_order_response(
    signal: PiecewiseLinear, delay: float, bandwidth: float, damping: float, times: Array
) -> Array:
    """Return the answer to a signal at the given times, shape (N, 6): see `OUTPUT` and the names beside it.

    Parameters
    ----------
    signal
        What is followed.
    delay
        s.
    bandwidth, damping
        ω, rad/s, above 0; ζ, above 0.
    times
        Shape (N,), s, increasing.

    Examples
    --------
    >>> step = PiecewiseLinear(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros(2))
    >>> answer = second_order_response(step, 0.25, 20.0, 1.0, np.array([1.2, 1.25, 1.35]))
    >>> answer[:, OUTPUT].round(6).tolist()  # 1 − (1 + 2) exp(−2)
    [0.0, 0.0, 0.593994]
    """
    out = np.empty((len(times), 6))
    begins, values, slopes = signal
    _respond(begins, values, slopes, delay, bandwidth, damping, np.ascontiguousarray(times), out)
    return out
