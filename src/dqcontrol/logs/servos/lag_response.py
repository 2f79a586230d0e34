"""Answer of a first-order lag behind a delay to any targets, at any times, exactly, with its derivatives."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE2, kernel, types

OUTPUT, BY_LAG, BY_DELAY, TRANSIENT = range(4)
"""Columns of an answer: x, ∂x/∂τ, ∂x/∂D, exp(−(t − t₀)/τ)."""


class PiecewiseLinear(NamedTuple):
    """A signal over time: straight lines with steps between them.

    From ``begins[k]`` (s) on it is ``values[k]`` and changes by ``slopes[k]`` a second; before the first it rests.
    """

    begins: Array
    values: Array
    slopes: Array


@kernel(types.void(READ, READ, READ, types.float64, types.float64, READ, WRITE2))
def _respond(begins, values, slopes, delay, lag, times, out):
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
        out[j, OUTPUT], out[j, BY_LAG], out[j, BY_DELAY] = x, by_lag, by_delay
        out[j, TRANSIENT] = transient


def lag_response(signal: PiecewiseLinear, delay: float, lag: float, times: Array) -> Array:
    """Return the answer to a signal at the given times, shape (N, 4): see `OUTPUT` and the names beside it.

    Parameters
    ----------
    signal
        What is followed.
    delay, lag
        s; the lag above 0.
    times
        Shape (N,), s, increasing.

    Examples
    --------
    >>> step = PiecewiseLinear(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros(2))
    >>> answer = lag_response(step, 0.25, 0.1, np.array([1.2, 1.25, 1.35]))
    >>> answer[:, OUTPUT].round(6).tolist()
    [0.0, 0.0, 0.632121]
    """
    out = np.zeros((len(times), 4))
    _respond(signal.begins, signal.values, signal.slopes, delay, lag, np.ascontiguousarray(times), out)
    return out


def held(times: Array, values: Array) -> PiecewiseLinear:
    """Return a signal that keeps each value until the next."""
    return PiecewiseLinear(np.ascontiguousarray(times), np.ascontiguousarray(values), np.zeros(len(times)))


def joined(times: Array, values: Array) -> PiecewiseLinear:
    """Return a signal that joins values by straight lines."""
    slopes = np.append(np.diff(values) / np.diff(times), 0.0)
    return PiecewiseLinear(np.ascontiguousarray(times), np.ascontiguousarray(values), slopes)
