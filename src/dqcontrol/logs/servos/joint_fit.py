"""The servo of one joint by separable least squares.

y(t) = g F[r(t − D)] + b + transients − s F[τ_g], F of first order (τ) or second (ω, ζ): for each of these numbers all
others are linear (variable projection; the Jacobian is Kaufman's), and Levenberg and Marquardt's steps find the rest.
Intervals are those of the sandwich with Bartlett weights, as residuals of encoders and of models that are a little
wrong are not white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.logs.servos.servo_orders import (
    FIRST_ORDER,
    MOST_DELAY,
    SECOND_ORDER,
    PiecewiseLinear,
    ServoOrder,
)

_MULTIPLE = 0.06  # of a step: RMS by which differences may miss whole numbers of steps
_LEAST_LEVELS = 4  # two gaps between three agree by chance
_MOST_LEVELS = 20_000  # finer encoders fit like exact ones
_ROUNDING = 1e-9  # rad or m; finer steps are digits of the file
_NORMAL = 0.6745  # median of |x| of a standard normal x
QUANTUM = 1 / math.sqrt(12)
"""Standard deviation that rounding adds, in steps."""


def resolution_of(values: Array) -> float:
    """Return the step of an encoder, rad or m; 0 if its values are not all multiples of one.

    Examples
    --------
    >>> round(resolution_of(0.002 * np.round(0.1 * np.sin(np.arange(500)) / 0.002)), 9)
    0.002
    """
    levels = np.unique(values)
    if not _LEAST_LEVELS <= len(levels) <= _MOST_LEVELS or len(levels) > 0.5 * len(values):
        return 0.0
    gaps = np.diff(levels)
    gaps = gaps[gaps > _ROUNDING]
    if len(gaps) < _LEAST_LEVELS - 1:
        return 0.0
    step = float(gaps.min())
    for _ in range(3):
        counts = np.round(gaps / step)
        step = float(counts @ gaps / (counts @ counts))
    missed = float(np.sqrt(np.mean((gaps / step - np.round(gaps / step)) ** 2)))
    return step if missed < _MULTIPLE else 0.0


def noise_of(residual: Array, resolution: float) -> float:
    """Return the standard deviation of what is not smooth in a residual, rad or m: noise of the encoder and its steps.

    Of second differences, by their median, which neither outliers nor a model that is slowly wrong change.
    """
    if len(residual) < 5:
        return resolution * QUANTUM
    rough = float(np.median(np.abs(np.diff(residual, n=2)))) / (_NORMAL * math.sqrt(6))
    return max(rough, resolution * QUANTUM)


NORMAL_95 = 1.96  # standard deviations: 95 % of a normal distribution
# s, each 1.8 times the one before: all that `LEAST_LAG` … allow is near one
_GRID_LAGS = np.geomspace(2e-3, 0.8, 11)
_GRID_DELAYS = np.linspace(0.0, MOST_DELAY, 31)
# most that a grid of 341 models and a descent from a start look at; the last descent takes all samples
_GRID_SAMPLES, _START_SAMPLES = 800, 3000
_STARTS = 3  # the best points of the grid, from which the fit descends
_ITERATIONS = 60  # ends by itself at `_PRECISE`
# of the sum of squares, a gain that is none: for choosing among minima, and at the end
_ROUGH, _PRECISE = 1e-5, 1e-9
_CLOSE = 1.02  # times the least sum of squares of a part of the samples, one that may be less of all
# of lag and delay of a fit of first order, that a second-order fit begins with as 2ζ/ω
_SHARES = (0.3, 0.6, 0.9)
_VALLEY = 0.9  # correlation of lag and delay
_BEGIN_DAMPINGS = (0.5, 1.0)  # one that rings, one that just does not


class Segment(NamedTuple):
    """Part of a log of one joint without a break: what it was told, and what it did at which times.

    ``torque`` is the gravity torque over time, N·m or N; None without sag.
    """

    target: PiecewiseLinear
    times: Array
    positions: Array
    torque: PiecewiseLinear | None

    def chosen(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Segment:
        """Return it with some of its samples only."""
        return self._replace(times=self.times[rows], positions=self.positions[rows])


def positions_of(segments: list[Segment]) -> Array:
    """Return the positions of all segments, one behind the other."""
    return np.concatenate([each.positions for each in segments])


def by_segment(segments: list[Segment], values: NDArray[Any]) -> list[NDArray[Any]]:
    """Return the parts of values at all samples, one a segment, as views."""
    return np.split(values, np.cumsum([len(each.times) for each in segments])[:-1])


@dataclass(frozen=True)
class Fit:
    """What was found.

    Attributes
    ----------
    kind
        Of the servo.
    values
        Its numbers, see `ServoOrder`.
    gain, sag, offset
        g, s and b, that of all segments on average.
    factors
        Of all columns.
    covariance
        Of the values, then of the factors: gain, sag if there is one, offsets and transients.
    residual, output
        At all samples.
    likelihood
        Logarithm of it, if the fit is by `encoder_cells`.
    """

    kind: ServoOrder
    values: Array
    gain: float
    sag: float
    offset: float
    factors: Array
    covariance: Array
    residual: Array
    output: Array
    likelihood: float = math.nan

    @property
    def rms(self) -> float:
        """Of the residual, rad or m."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def lag(self) -> float:
        """τ, or 2ζ/ω, s."""
        return self.kind.lag(self.values)[0]

    @property
    def delay(self) -> float:
        """D, s."""
        return float(self.values[-1])

    def error(self, which: int) -> float:
        """Return the standard error of a number, or of a factor after these."""
        return math.sqrt(max(self.covariance[which, which], 0.0))

    @cached_property
    def _of_lag(self) -> tuple[float, float]:
        """Return the standard error of the lag, and its covariance with the delay."""
        k, slopes = len(self.values), self.kind.lag(self.values)[1]
        part = self.covariance[:k, :k]
        return math.sqrt(max(float(slopes @ part @ slopes), 0.0)), float(slopes @ part[:, -1])

    @property
    def lag_error(self) -> float:
        """Standard error, s."""
        return self._of_lag[0]

    @property
    def delay_error(self) -> float:
        """Standard error, s."""
        return self.error(len(self.values) - 1)

    @property
    def gain_error(self) -> float:
        """Standard error."""
        return self.error(len(self.values))

    @property
    def sag_error(self) -> float:
        """Standard error; of segments with torques."""
        return self.error(len(self.values) + 1)

    @property
    def correlation(self) -> float:
        """Of lag and delay."""
        sizes = self.lag_error * self.delay_error
        return self._of_lag[1] / sizes if sizes else 0.0


class Columns(NamedTuple):
    """The linear problem at some numbers: columns (N, p), slopes (N, k) of the output, factors (p,), residual (N,)."""

    columns: Array
    slopes: Array
    basis: Array
    factors: Array
    residual: Array

    @property
    def jacobian(self) -> Array:
        """Slopes by all numbers and factors, shape (N, k + p)."""
        return np.column_stack([self.slopes, self.columns])

    @property
    def squares(self) -> float:
        """Sum of squares that is left."""
        return float(self.residual @ self.residual)


def fit(segments: list[Segment], period: float, near: Fit | None = None) -> Fit:
    """Return the best first-order servo of some segments, with its uncertainty.

    Parameters
    ----------
    segments
        One or more, with motion.
    period
        Median time between commands, s: minima may hide beside whole periods.
    near
        A fit of almost the same, perhaps of second order: the search begins there.
    """
    if near is not None:
        return fit_at(segments, near.kind, _descend(segments, near.kind, near.values)[1])
    values = _searched(segments)
    starts = [values + np.array([0.0, late]) for late in (0.0, -period / 2, period / 2)]
    found = fit_at(segments, FIRST_ORDER, _descended(segments, FIRST_ORDER, starts))
    if abs(found.correlation) < _VALLEY:
        return found
    # a long valley with a bend at each whole period: from other places in it, too
    both = found.lag + found.delay
    starts = [found.values, *(np.array([share * both, (1 - share) * both]) for share in _SHARES)]
    return fit_at(segments, FIRST_ORDER, _descended(segments, FIRST_ORDER, starts))


def second_order_fit(segments: list[Segment], found: Fit) -> Fit:
    """Return the best second-order servo, beginning at what a fit of first order says of lag and delay together."""
    both = found.lag + found.delay
    starts = [
        np.array([2 * damping / (share * both), damping, (1 - share) * both])
        for share in _SHARES
        for damping in _BEGIN_DAMPINGS
    ]
    return fit_at(segments, SECOND_ORDER, _descended(segments, SECOND_ORDER, starts))


def fit_at(segments: list[Segment], kind: ServoOrder, values: Array) -> Fit:
    """Return the fit at given numbers of the servo, with its uncertainty as if these had been fitted."""
    found = solved(segments, kind, values)
    return fit_of(segments, kind, values, found, sandwich(found.jacobian, found.residual))


def fit_of(
    segments: list[Segment], kind: ServoOrder, values: Array, found: Columns, covariance: Array
) -> Fit:
    """Return a fit from the columns and factors at its numbers."""
    has_sag = segments[0].torque is not None
    gain, sag = found.factors[0], found.factors[1] if has_sag else 0.0
    output = positions_of(segments) - found.residual
    pulled = sag * -found.columns[:, 1] if has_sag else 0.0
    offset = float(np.mean(output - found.columns[:, 0] + pulled))
    numbers = float(gain), float(sag), offset
    return Fit(kind, values, *numbers, found.factors, covariance, found.residual, output)


def squares_at(segments: list[Segment], lag: float, delays: Array) -> float:
    """Return the least sum of squares that a lag leaves with one of some delays."""
    return min(solved(segments, FIRST_ORDER, np.array([lag, delay])).squares for delay in delays.tolist())


def predicted(fitted: Fit, segment: Segment) -> Array:
    """Return what a fit says of a segment, from its first sample on, but for its offset."""
    output = fitted.gain * fitted.kind.answer(segment.target, fitted.values, segment.times).output
    if segment.torque is not None:
        pull = fitted.kind.answer(segment.torque, fitted.values, segment.times, delayed=False).output
        output = output - fitted.sag * pull
    return output


def columns_at(segments: list[Segment], kind: ServoOrder, values: Array) -> tuple[Array, Array, Array | None]:
    """Return the columns (N, p) at some numbers, and the slopes (N, k) of the first and, with sag, of the second."""
    has_sag, count, order = segments[0].torque is not None, len(segments), kind.order
    total, shared = sum(len(each.times) for each in segments), 1 + has_sag
    columns = np.zeros((total, shared + (1 + order) * count))
    slopes, pulls = np.zeros((total, len(values))), np.zeros((total, len(values)))
    parts = (by_segment(segments, each) for each in (columns, slopes, pulls))
    for k, (each, column, slope, pull) in enumerate(zip(segments, *parts, strict=True)):
        answer = kind.answer(each.target, values, each.times)
        column[:, 0], slope[:] = answer.output, answer.slopes
        if each.torque is not None:
            sagging = kind.answer(each.torque, values, each.times, delayed=False)
            column[:, 1], pull[:] = -sagging.output, -sagging.slopes
        own = shared + (1 + order) * k
        column[:, own] = 1.0
        column[:, own + 1 : own + 1 + order] = answer.transients
    return columns, slopes, pulls if has_sag else None


def slopes_by_values(factors: Array, slopes: Array, pulls: Array | None) -> Array:
    """Return the slopes of the whole output by the servo's numbers."""
    return factors[0] * slopes if pulls is None else factors[0] * slopes + factors[1] * pulls


def solved(segments: list[Segment], kind: ServoOrder, values: Array) -> Columns:
    """Solve for all that is linear."""
    columns, slopes, pulls = columns_at(segments, kind, values)
    positions = positions_of(segments)
    basis, triangle = np.linalg.qr(columns)
    small = np.abs(np.diag(triangle)) < 1e-9 * np.abs(np.diag(triangle)).max()
    projected = basis.T @ positions
    if small.any():  # as a transient that is over before the second sample
        factors = np.asarray(np.linalg.lstsq(triangle, projected, rcond=1e-9)[0], dtype=np.float64)
    else:
        factors = np.asarray(np.linalg.solve(triangle, projected), dtype=np.float64)
    residual = positions - columns @ factors
    return Columns(columns, slopes_by_values(factors, slopes, pulls), basis, factors, residual)


def _searched(segments: list[Segment]) -> Array:
    """Return the lag and delay of the best minimum that a grid leads to."""
    coarse, middle = thinned(segments, _GRID_SAMPLES), thinned(segments, _START_SAMPLES)
    costs = np.array([_squares_by_delay(coarse, lag) for lag in _GRID_LAGS])
    best = np.argsort(costs, axis=None, kind="stable")[:_STARTS]
    lags, delays = np.unravel_index(best, costs.shape)
    starts = np.column_stack([_GRID_LAGS[lags], _GRID_DELAYS[delays]])
    return min((_descend(middle, FIRST_ORDER, each, _ROUGH) for each in starts), key=lambda each: each[0])[1]


def _squares_by_delay(segments: list[Segment], lag: float) -> Array:
    """Return the least sum of squares that a lag leaves with each delay of the grid: of one answer, shifted."""
    columns = columns_at(segments, FIRST_ORDER, np.array([lag, 0.0]))[0]
    shifted = np.tile(columns, (len(_GRID_DELAYS), 1, 1))
    for each, part in zip(segments, by_segment(segments, shifted.swapaxes(0, 1)), strict=True):
        seen, places = np.unique(each.times - _GRID_DELAYS[:, None], return_inverse=True)
        answer = FIRST_ORDER.answer(each.target, np.array([lag, 0.0]), seen).output
        part[:, :, 0] = answer[places].reshape(len(_GRID_DELAYS), -1).T
    positions = positions_of(segments)
    basis = np.linalg.qr(shifted)[0]
    left = positions - np.einsum("dnp,dp->dn", basis, np.einsum("dnp,n->dp", basis, positions))
    return np.asarray(np.sum(left**2, axis=1), dtype=np.float64)


def _descended(segments: list[Segment], kind: ServoOrder, starts: list[Array]) -> Array:
    """Return the numbers of the best minimum near some starts: first of a part of the samples, then of all."""
    middle = thinned(segments, _START_SAMPLES)
    found = sorted((_descend(middle, kind, each, _ROUGH) for each in starts), key=lambda each: each[0])
    good = [values for squares, values in found if squares <= _CLOSE * found[0][0]]
    different = [good[0]]
    for values in good[1:]:
        if all((np.abs(values - each) > 0.05 * kind.scale).any() for each in different):
            different.append(values)
    return min((_descend(segments, kind, each) for each in different), key=lambda each: each[0])[1]


def thinned(segments: list[Segment], most: int) -> list[Segment]:
    """Return every so manyth sample, as many as asked for or up to twice as many."""
    total = sum(len(each.times) for each in segments)
    step = total // most
    if step < 2:
        return segments
    return [each.chosen(np.arange(0, len(each.times), step)) for each in segments]


def _descend(
    segments: list[Segment], kind: ServoOrder, start: Array, progress: float | None = None
) -> tuple[float, Array]:
    """Return the sum of squares and the numbers of the minimum near a start."""
    lower, upper = kind.lower, kind.upper
    values = np.clip(start, lower + 1e-3 * kind.scale, upper - 1e-3 * kind.scale)
    found, damping = solved(segments, kind, values), 1e-3
    if progress is None:
        progress = _PRECISE / len(found.residual)
    for _ in range(_ITERATIONS):
        slopes = (found.slopes - found.basis @ (found.basis.T @ found.slopes)) * kind.scale
        normal, gradient = slopes.T @ slopes, slopes.T @ found.residual
        floor = 1e-12 * max(float(np.trace(normal)), 1e-300)
        for _ in range(8):
            step = np.linalg.solve(normal + np.diag(damping * np.diag(normal) + floor), gradient)
            tried = np.clip(values + step * kind.scale, lower, upper)
            trial = solved(segments, kind, tried)
            if trial.squares <= found.squares:
                break
            damping *= 6
        else:
            break
        moved = float(np.abs((tried - values) / kind.scale).max())
        gained = found.squares - trial.squares
        values, found, damping = tried, trial, max(damping / 10, 1e-9)
        if moved < 1e-7 or gained < progress * found.squares:
            break
    return found.squares, values


def sandwich(jacobian: Array, residual: Array, scores: Array | None = None) -> Array:
    """Return the covariance of the parameters (Newey and West 1987), bandwidth by Andrews (1991) for AR(1).

    Parameters
    ----------
    jacobian
        Shape (N, p), each row times the root of its weight.
    residual
        Shape (N,), times the same.
    scores
        What each sample pulls with, where that is not the residual.
    """
    count = len(residual)
    sizes = np.linalg.norm(jacobian, axis=0)
    sizes[sizes == 0] = 1.0
    scaled = jacobian / sizes
    inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-13)
    pulled = scaled * residual[:, None] if scores is None else scores / sizes
    along = float(residual[1:] @ residual[:-1]) / max(float(residual @ residual), 1e-300)
    along = min(max(along, -0.97), 0.97)
    ratio = 4 * along**2 / ((1 - along) ** 2 * (1 + along) ** 2)
    width = int(min(math.ceil(1.1447 * (ratio * count) ** (1 / 3)), count // 4))
    # Bartlett's weights are those of sums over windows of width + 1 samples, which go one by one over the log.
    sums = np.zeros((count + 2 * width + 1, pulled.shape[1]))
    sums[width + 1 : width + 1 + count] = np.cumsum(pulled, axis=0)
    sums[width + 1 + count :] = sums[width + count]
    windows = sums[width + 1 :] - sums[: -width - 1]
    middle = windows.T @ windows / (width + 1)
    covariance = inverse @ middle @ inverse * count / max(count - jacobian.shape[1], 1)
    return covariance / np.outer(sizes, sizes)
