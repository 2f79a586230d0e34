"""Answers of servos of first and second order, as columns of a least-squares problem, by their own numbers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.logs.servos import lag_response as first, second_order_response as second
from dqcontrol.logs.servos.lag_response import PiecewiseLinear, lag_response
from dqcontrol.logs.servos.second_order_response import second_order_response

LEAST_LAG, MOST_LAG, MOST_DELAY = 2e-4, 2.0, 0.3  # s
_MOST_BANDWIDTH, _LEAST_BANDWIDTH = 2000.0, 0.5  # rad/s
_DAMPINGS = (0.05, 5.0)


class Answer(NamedTuple):
    """To one signal: output (N,), its slopes (N, k) by the k numbers of the servo, and transients (N, order)."""

    output: Array
    slopes: Array
    transients: Array


class ServoOrder(Protocol):
    """A kind of servo with k numbers, the last of which is its delay.

    Attributes
    ----------
    order
        1 or 2.
    lower, upper
        Bounds of its numbers, shape (k,).
    scale
        By which numbers of these are about 1, shape (k,).
    """

    order: int
    lower: Array
    upper: Array
    scale: Array

    def answer(self, signal: PiecewiseLinear, values: Array, times: Array, *, delayed: bool = True) -> Answer:
        """Return what it answers to a signal; without its delay where a load pulls at the joint itself."""
        ...

    def lag(self, values: Array) -> tuple[float, Array]:
        """Return by how much it is late for slow motions besides its delay, s, and the slopes of that (k,)."""
        ...


class _LagServo:
    """A lag τ: numbers τ and D, s."""

    order = 1
    lower, upper, scale = (
        np.array([LEAST_LAG, 0.0]),
        np.array([MOST_LAG, MOST_DELAY]),
        np.array([0.02, 0.005]),
    )

    def answer(self, signal: PiecewiseLinear, values: Array, times: Array, *, delayed: bool = True) -> Answer:
        found = lag_response(signal, float(values[1]) if delayed else 0.0, float(values[0]), times)
        slopes = found[:, first.BY_LAG : first.BY_DELAY + 1]
        if not delayed:
            slopes = np.column_stack([slopes[:, 0], np.zeros(len(times))])
        return Answer(found[:, first.OUTPUT], slopes, found[:, first.TRANSIENT :])

    def lag(self, values: Array) -> tuple[float, Array]:
        return float(values[0]), np.array([1.0, 0.0])


class _SecondOrderServo:
    """ω, rad/s, and damping ratio ζ: numbers ω, ζ and D."""

    order = 2
    lower = np.array([_LEAST_BANDWIDTH, _DAMPINGS[0], 0.0])
    upper = np.array([_MOST_BANDWIDTH, _DAMPINGS[1], MOST_DELAY])
    scale = np.array([10.0, 0.3, 0.005])

    def answer(self, signal: PiecewiseLinear, values: Array, times: Array, *, delayed: bool = True) -> Answer:
        bandwidth, damping, delay = (float(value) for value in values)
        delay = delay if delayed else 0.0
        found = second_order_response(signal, delay, bandwidth, damping, times)
        slopes = found[:, second.BY_BANDWIDTH : second.BY_DELAY + 1]
        if not delayed:
            slopes[:, -1] = 0.0
        return Answer(found[:, second.OUTPUT], slopes, found[:, second.POSITION_TRANSIENT :])

    def lag(self, values: Array) -> tuple[float, Array]:
        bandwidth, damping = float(values[0]), float(values[1])
        return 2 * damping / bandwidth, np.array([-2 * damping / bandwidth**2, 2 / bandwidth, 0.0])


FIRST_ORDER: ServoOrder = _LagServo()
SECOND_ORDER: ServoOrder = _SecondOrderServo()
