"""Servos of first and second order: exact answers to any targets, at any times, with their slopes and transients."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE2, Kernel, inline, kernel, types
from dqcontrol.plants.servo.servo_step import free_response

LEAST_LAG, MOST_LAG, MOST_DELAY = 2e-4, 2.0, 0.3  # s
_MOST_BANDWIDTH, _LEAST_BANDWIDTH = 2000.0, 0.5  # rad/s
_DAMPINGS = (0.05, 5.0)  # it rings 3 periods down to 1/e; one pole is 98 times as fast as the other
_OVER = 1e-14  # of a transient, what is nothing
_NEARLY_CRITICAL = 1e-3  # (ω_d h)² below which differences cancel


class PiecewiseLinear(NamedTuple):
    """A signal over time: straight lines with steps between them.

    From ``begins[k]`` (s) on it is ``values[k]`` and changes by ``slopes[k]`` a second; before the first it rests.
    """

    begins: Array
    values: Array
    slopes: Array


def held(times: Array, values: Array) -> PiecewiseLinear:
    """Return a signal that keeps each value until the next."""
    return PiecewiseLinear(np.ascontiguousarray(times), np.ascontiguousarray(values), np.zeros(len(times)))


def joined(times: Array, values: Array) -> PiecewiseLinear:
    """Return a signal that joins values by straight lines."""
    slopes = np.append(np.diff(values) / np.diff(times), 0.0)
    return PiecewiseLinear(np.ascontiguousarray(times), np.ascontiguousarray(values), slopes)


class Answer(NamedTuple):
    """To one signal: output (N,), its slopes (N, k) by the k numbers of the servo, and transients (N, order).

    Transients are what an initial position and, of second order, an initial speed leave. The slope by the delay is that
    of an answer that begins later as well; what that changes at the begin is in the span of the transients.
    """

    output: Array
    slopes: Array
    transients: Array


@dataclass(frozen=True, eq=False)
class ServoOrder:
    """A kind of servo with k numbers: τ and D, s; or ω, rad/s, damping ratio ζ and D.

    Attributes
    ----------
    order
        1 or 2.
    lower, upper
        Bounds of its numbers, shape (k,).
    scale
        By which numbers of these are about 1, shape (k,).
    follow
        Writes the columns of an answer.

    Examples
    --------
    >>> step = PiecewiseLinear(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros(2))
    >>> times = np.array([1.2, 1.25, 1.35])
    >>> FIRST_ORDER.answer(step, np.array([0.1, 0.25]), times).output.round(6).tolist()
    [0.0, 0.0, 0.632121]
    >>> answer = SECOND_ORDER.answer(step, np.array([20.0, 1.0, 0.25]), times)
    >>> answer.output.round(6).tolist()  # 1 − (1 + 2) exp(−2)
    [0.0, 0.0, 0.593994]
    """

    order: int
    lower: Array
    upper: Array
    scale: Array
    follow: Kernel

    def answer(self, signal: PiecewiseLinear, values: Array, times: Array, *, delayed: bool = True) -> Answer:
        """Return what it answers to a signal; without its delay where a load pulls at the joint itself."""
        *numbers, delay = values.tolist()
        out = np.empty((len(times), 1 + len(values) + self.order))
        self.follow(*signal, delay if delayed else 0.0, *numbers, np.ascontiguousarray(times), out)
        output, slopes, transients = np.split(out, [1, 1 + len(values)], axis=1)
        if not delayed:
            slopes[:, -1] = 0.0
        return Answer(output[:, 0], slopes, transients)

    def lag(self, values: Array) -> tuple[float, Array]:
        """Return by how much it is late for slow motions besides its delay, s, and the slopes of that (k,)."""
        first, second = values[:2].tolist()
        if self.order == 1:
            return first, np.array([1.0, 0.0])
        return 2 * second / first, np.array([-2 * second / first**2, 2 / first, 0.0])


@kernel(types.void(READ, READ, READ, types.float64, types.float64, READ, WRITE2))
def _follow_first_order(begins, values, slopes, delay, lag, times, out):
    """Write x of lag x' = v(t − delay) − x at each time, and its derivatives; x begins at v.

    Over h, with v at its begin and slope m: x⁺ = v + m h − m τ + (x − v + m τ) E, E = exp(−h/τ). By the delay: where v
    steps from a to b, ∂x/∂D grows by (a − b)/τ.
    """
    count, last = begins.shape[0], -1
    time = times[0]
    while last + 1 < count and begins[last + 1] + delay <= time:
        last += 1
    x = values[0] if last < 0 else values[last] + slopes[last] * (time - delay - begins[last])
    by_lag, by_delay, transient = 0.0, 0.0, 1.0
    for j in range(times.shape[0]):
        while True:
            is_step = last + 1 < count and begins[last + 1] + delay <= times[j]
            until = begins[last + 1] + delay if is_step else times[j]
            h = until - time
            v = values[0] if last < 0 else values[last] + slopes[last] * (time - delay - begins[last])
            m = 0.0 if last < 0 else slopes[last]
            if h > 0.0:
                decay = math.exp(-h / lag)
                rate = (v - x) / lag
                by_lag = by_lag * decay - m * (1.0 - decay) - (rate - m) * (h / lag) * decay
                by_delay = -m + (by_delay + m) * decay
                x = v + m * h - m * lag + (x - v + m * lag) * decay
                transient *= decay
                time = until
            if not is_step:
                break
            before = v + m * h
            last += 1
            by_delay += (before - values[last]) / lag
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = x, by_lag, by_delay, transient


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
    grown = damping * second + drag * second_by_bandwidth
    first_by_bandwidth = grown - damping * h * cosine - h * half * second
    half = -bandwidth * bandwidth * damping
    second_by_damping = half * bend - bandwidth * h * second
    grown = bandwidth * second + drag * second_by_damping
    first_by_damping = grown - bandwidth * h * cosine - h * half * second
    return first_by_bandwidth, second_by_bandwidth, first_by_damping, second_by_damping


@kernel(types.void(READ, READ, READ, types.float64, types.float64, types.float64, READ, WRITE2))
def _follow_second_order(begins, values, slopes, delay, bandwidth, damping, times, out):
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
                next_slope = moved + slope[0] * away + slope[1] * faster + first * apart
                next_slope += second * speed_by_bandwidth
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
                next_slope = moved + slope[2] * away + slope[3] * faster + first * apart
                next_slope += second * speed_by_damping
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
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = x, by_bandwidth, by_damping, -speed
        out[j, 4], out[j, 5] = transient


FIRST_ORDER = ServoOrder(
    1,
    lower=np.array([LEAST_LAG, 0.0]),
    upper=np.array([MOST_LAG, MOST_DELAY]),
    scale=np.array([0.02, 0.005]),
    follow=_follow_first_order,
)
SECOND_ORDER = ServoOrder(
    2,
    lower=np.array([_LEAST_BANDWIDTH, _DAMPINGS[0], 0.0]),
    upper=np.array([_MOST_BANDWIDTH, _DAMPINGS[1], MOST_DELAY]),
    scale=np.array([10.0, 0.3, 0.005]),
    follow=_follow_second_order,
)
