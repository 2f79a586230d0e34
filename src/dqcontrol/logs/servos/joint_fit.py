"""Lag, delay, gain, offset and sag of one joint by separable least squares.

y(t) = g F[r(t − D)] + b + c₀ exp(−t/τ) − s F[τ_g], F a first-order lag τ: for each (τ, D) all others are linear
(variable projection; the Jacobian is Kaufman's). Intervals are those of the sandwich with Bartlett weights, as
residuals of encoders and of models that are a little wrong are not white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from dqcontrol.arrays import Array
from dqcontrol.logs.servos.lag_response import (
    BY_DELAY,
    BY_LAG,
    OUTPUT,
    TRANSIENT,
    PiecewiseLinear,
    lag_response,
)

LEAST_LAG, MOST_LAG, MOST_DELAY = 2e-4, 2.0, 0.3  # s
NORMAL_95 = 1.96
_GRID_LAGS = np.geomspace(2e-3, 0.8, 11)
_GRID_DELAYS = np.linspace(0.0, MOST_DELAY, 31)
_GRID_SAMPLES, _START_SAMPLES = 1200, 5000
_STARTS = 3


class Segment(NamedTuple):
    """Part of a log of one joint without a break: what it was told, and what it did at which times.

    ``torque`` is the gravity torque at each of ``times``, N·m or N; None without sag.
    """

    target: PiecewiseLinear
    times: Array
    positions: Array
    torque: PiecewiseLinear | None

    def chosen(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Segment:
        """Return it with some of its samples only."""
        return self._replace(times=self.times[rows], positions=self.positions[rows])


@dataclass(frozen=True)
class Fit:
    """What was found. Covariance in the order lag, delay, gain, then sag if there is one, then offsets."""

    lag: float
    delay: float
    gain: float
    sag: float
    offset: float
    covariance: Array
    residual: Array
    output: Array

    @property
    def rms(self) -> float:
        """Of the residual, rad or m."""
        return float(np.sqrt(np.mean(self.residual**2)))

    def error(self, which: int) -> float:
        """Return a standard error."""
        return math.sqrt(max(self.covariance[which, which], 0.0))

    @property
    def correlation(self) -> float:
        """Of lag and delay."""
        sizes = self.error(0) * self.error(1)
        return float(self.covariance[0, 1] / sizes) if sizes else 0.0


class _Linear(NamedTuple):
    """The columns (N, p) at some lag and delay, by these (N,), the factors of the columns, and what is left."""

    columns: Array
    by_lag: Array
    by_delay: Array
    basis: Array
    factors: Array
    residual: Array


def fit(segments: list[Segment], period: float, near: Fit | None = None) -> Fit:
    """Return the best first-order servo of some segments, with its uncertainty.

    Parameters
    ----------
    segments
        One or more, with motion.
    period
        Median time between commands, s: minima may hide beside whole periods.
    near
        A fit of almost the same: the search begins there.
    """
    lag, delay = (near.lag, near.delay) if near is not None else _searched(segments)
    found = [_descend(segments, lag, begin) for begin in (delay, delay - period / 2, delay + period / 2)]
    _, lag, delay = min(found)
    return fit_at(segments, lag, delay)


def _searched(segments: list[Segment]) -> tuple[float, float]:
    """Return the lag and delay of the best minimum that a grid leads to."""
    coarse, middle = _thinned(segments, _GRID_SAMPLES), _thinned(segments, _START_SAMPLES)
    costs = [
        (float(np.sum(_solve(coarse, lag, delay).residual ** 2)), lag, delay)
        for lag in _GRID_LAGS
        for delay in _GRID_DELAYS
    ]
    found = [_descend(middle, lag, delay) for _, lag, delay in sorted(costs)[:_STARTS]]
    return min(found)[1:]


def squares_at(segments: list[Segment], lag: float, delays: Array) -> float:
    """Return the least sum of squares that a lag leaves with one of some delays."""
    return min(float(np.sum(_solve(segments, lag, delay).residual ** 2)) for delay in delays.tolist())


def fit_at(segments: list[Segment], lag: float, delay: float) -> Fit:
    """Return the fit at a given lag and delay, with its uncertainty as if these had been fitted."""
    found = _solve(segments, lag, delay)
    jacobian = np.column_stack([found.by_lag, found.by_delay, found.columns])
    has_sag = segments[0].torque is not None
    covariance = _sandwich(jacobian, found.residual)
    gain, sag = found.factors[0], found.factors[1] if has_sag else 0.0
    positions = np.concatenate([each.positions for each in segments])
    output = positions - found.residual
    moved = found.columns[:, 0]
    offset = float(np.mean(output - moved + (sag * -found.columns[:, 1] if has_sag else 0.0)))
    return Fit(lag, delay, float(gain), float(sag), offset, covariance, found.residual, output)


def predicted(fitted: Fit, segment: Segment) -> Array:
    """Return what a fit says of a segment, from its first sample on, but for its offset."""
    answer = lag_response(segment.target, fitted.delay, fitted.lag, segment.times)
    output = fitted.gain * answer[:, OUTPUT]
    if segment.torque is not None:
        output -= fitted.sag * lag_response(segment.torque, 0.0, fitted.lag, segment.times)[:, OUTPUT]
    return output


def _thinned(segments: list[Segment], most: int) -> list[Segment]:
    total = sum(len(each.times) for each in segments)
    step = max(1, total // most)
    return [each.chosen(np.arange(0, len(each.times), step)) for each in segments]


def _solve(segments: list[Segment], lag: float, delay: float) -> _Linear:
    """Solve for all that is linear."""
    has_sag, count = segments[0].torque is not None, len(segments)
    total = sum(len(each.times) for each in segments)
    shared = 1 + has_sag
    columns = np.zeros((total, shared + 2 * count))
    by_lag, by_delay = np.zeros_like(columns), np.zeros(total)
    first = 0
    for k, each in enumerate(segments):
        rows = slice(first, first + len(each.times))
        first = rows.stop
        answer = lag_response(each.target, delay, lag, each.times)
        columns[rows, 0], by_lag[rows, 0], by_delay[rows] = (
            answer[:, OUTPUT],
            answer[:, BY_LAG],
            answer[:, BY_DELAY],
        )
        if each.torque is not None:
            sagging = lag_response(each.torque, 0.0, lag, each.times)
            columns[rows, 1], by_lag[rows, 1] = -sagging[:, OUTPUT], -sagging[:, BY_LAG]
        columns[rows, shared + 2 * k] = 1.0
        columns[rows, shared + 2 * k + 1] = answer[:, TRANSIENT]
    positions = np.concatenate([each.positions for each in segments])
    basis, triangle = np.linalg.qr(columns)
    small = np.abs(np.diag(triangle)) < 1e-9 * np.abs(np.diag(triangle)).max()
    projected = basis.T @ positions
    if small.any():  # as a transient that is over before the second sample
        factors = np.asarray(np.linalg.lstsq(triangle, projected, rcond=1e-9)[0], dtype=np.float64)
    else:
        factors = np.asarray(np.linalg.solve(triangle, projected), dtype=np.float64)
    residual = positions - columns @ factors
    return _Linear(columns, by_lag @ factors, by_delay * factors[0], basis, factors, residual)


def _descend(segments: list[Segment], lag: float, delay: float) -> tuple[float, float, float]:
    """Return the sum of squares and the lag and delay of the minimum near a start."""
    last: dict[bytes, _Linear] = {}

    def solved(point: Array) -> _Linear:
        key = point.tobytes()
        if key not in last:
            last.clear()
            last[key] = _solve(segments, float(point[0]), float(point[1]))
        return last[key]

    def jacobian(point: Array) -> Array:
        found = solved(point)
        slopes = np.column_stack([found.by_lag, found.by_delay])
        return -(slopes - found.basis @ (found.basis.T @ slopes))

    start = np.clip([lag, delay], [1.01 * LEAST_LAG, 1e-6], [0.99 * MOST_LAG, 0.999 * MOST_DELAY])
    scale = max(float(np.std(np.concatenate([each.positions for each in segments]))), 1e-9)
    done = least_squares(
        lambda point: solved(point).residual / scale,
        start,
        jac=cast("Any", lambda point: jacobian(point) / scale),
        bounds=([LEAST_LAG, 0.0], [MOST_LAG, MOST_DELAY]),
        x_scale=[0.02, 0.005],
        xtol=1e-9,
        ftol=1e-11,
        gtol=1e-12,
        max_nfev=60,
    )
    return float(done.cost) * scale**2, float(done.x[0]), float(done.x[1])


def _sandwich(jacobian: Array, residual: Array) -> Array:
    """Return the covariance of the parameters (Newey and West 1987), bandwidth by Andrews (1991) for AR(1)."""
    count = len(residual)
    sizes = np.linalg.norm(jacobian, axis=0)
    sizes[sizes == 0] = 1.0
    scaled = jacobian / sizes
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    along = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    along = min(max(along, -0.97), 0.97)
    ratio = 4 * along**2 / ((1 - along) ** 2 * (1 + along) ** 2)
    width = int(min(math.ceil(1.1447 * (ratio * count) ** (1 / 3)), count // 4))
    scores = scaled * residual[:, None]
    middle = scores.T @ scores
    for late in range(1, width + 1):
        part = scores[:-late].T @ scores[late:]
        middle += (1 - late / (width + 1)) * (part + part.T)
    covariance = inverse @ middle @ inverse * count / max(count - jacobian.shape[1], 1)
    return covariance / np.outer(sizes, sizes)
