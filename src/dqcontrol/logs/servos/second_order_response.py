"""What a second-order servo behind a delay answers to any targets, at any times, exactly."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE2, kernel, types
from dqcontrol.logs.servos.lag_response import PiecewiseLinear
from dqcontrol.plants.servo.free_response import free_response

OUTPUT, POSITION_TRANSIENT, SPEED_TRANSIENT = range(3)
"""Columns of an answer: y; what an initial position and an initial speed leave of it."""


@kernel(types.void(READ, READ, READ, types.float64, types.float64, types.float64, READ, WRITE2))
def _respond(begins, values, slopes, delay, bandwidth, damping, times, out):
    """Write y of y'' + 2ζω y' + ω² (y − v(t − delay)) = 0 at each time; y begins at rest at v.

    With v + m t from some event on, y − (v + m t − 2ζ m/ω) answers as without a target.
    """
    count, last = begins.shape[0], -1
    time, start = times[0], times[0]
    while last + 1 < count and begins[last + 1] + delay <= time:
        last += 1
    x = values[0] if last < 0 else values[last] + slopes[last] * (time - delay - begins[last])
    speed = 0.0
    square, drag = bandwidth * bandwidth, 2.0 * damping * bandwidth
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
                away, faster = x - behind, speed - m
                x = behind + m * h + first * away + second * faster
                speed = m - square * second * away + (first - drag * second) * faster
                time = until
            if not is_step:
                break
            last += 1
        out[j, OUTPUT] = x
        out[j, POSITION_TRANSIENT], out[j, SPEED_TRANSIENT] = free_response(
            times[j] - start, bandwidth, damping
        )


def second_order_response(
    signal: PiecewiseLinear, delay: float, bandwidth: float, damping: float, times: Array
) -> Array:
    """Return the answer to a signal at the given times, shape (N, 3): see `OUTPUT` and the names beside it.

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
    out = np.zeros((len(times), 3))
    begins, values, slopes = signal
    _respond(begins, values, slopes, delay, bandwidth, damping, np.ascontiguousarray(times), out)
    return out
