"""Play between a servo and its joint, or friction that acts like it: the joint stays behind on either side.

Whether there is some is told by the residual of a fit without; how much, by all numbers together: where the joint is
carried along its slopes are those of the servo at that sample, and where it rests those of the last one before.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, kernel, types
from dqcontrol.logs.servos import joint_fit

_TRIED = (0.5, 1.0, 2.0, 4.0)  # of what is left, half widths of a play
_MIN_PLAY_SIGMA = 5.0  # standard errors
_LEAST = 1e-4  # rad or m
_WIDTHS = (0.3, 0.5)  # of the encoder's step and of its noise; less is none
_FARTHEST = 20.0  # times as wide or as narrow as it seemed
_ITERATIONS = 40  # ends by itself at `_PROGRESS`
_MORE_DAMPED = 8  # times 8 each: a step of steepest descent, 10⁷ times as short
_PROGRESS = 1e-7  # of the sum of squares


@kernel(types.void(READ, types.float64, types.float64, WRITE))
def _play_position(values, begin, half_width, out):
    """Write where in a play of ± half_width, whose middle is first at ``begin``, each value is, −1 … 1."""
    middle = begin
    for k in range(values.shape[0]):
        middle = min(max(middle, values[k] - half_width), values[k] + half_width)
        out[k] = (values[k] - middle) / half_width


def half_play(segments: list[joint_fit.Segment], found: joint_fit.Fit, resolution: float) -> float:
    """Return half the width of the play that a fit leaves, roughly; 0 if none is sure.

    What is left is compared with the position of the fitted output in a play, which is a share of a dead band, too.
    """
    usual = max(found.rms, resolution * joint_fit.QUANTUM)
    columns = joint_fit.solved(segments, found.kind, found.values)
    jacobian = columns.jacobian
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    best: tuple[float, float, Array, Array] | None = None
    for half_width in (usual * each for each in _TRIED):
        place = _places(segments, found.output, half_width)
        alone = place - basis @ (basis.T @ place)
        share = float(alone @ alone)
        if share > 1e-6 * len(place):
            factor = float(alone @ columns.residual) / share
            if best is None or factor**2 * share > best[0]:
                best = factor**2 * share, factor, place, alone
    if best is None:
        return 0.0
    _, factor, place, alone = best
    covariance = joint_fit.sandwich(np.column_stack([jacobian, place]), columns.residual - factor * alone)
    # of neighbouring samples
    noise = float(np.median(np.abs(np.diff(columns.residual)))) / (0.6745 * math.sqrt(2))
    least = max(_WIDTHS[0] * resolution, _WIDTHS[1] * noise, _LEAST)
    least = max(_MIN_PLAY_SIGMA * math.sqrt(max(covariance[-1, -1], 0.0)), least)
    return -factor if -factor >= least else 0.0


def fit_with_play(
    segments: list[joint_fit.Segment], found: joint_fit.Fit, half_width: float
) -> tuple[joint_fit.Fit, list[joint_fit.Segment], float]:
    """Return the best servo with a play behind it, the segments without that play, and half its width.

    Parameters
    ----------
    segments
        As for the fit.
    found
        A fit without play.
    half_width
        Of the play, roughly, rad or m.
    """
    positions = joint_fit.positions_of(segments)
    k, kind = len(found.values), found.kind
    lower = np.concatenate([kind.lower, np.full(len(found.factors), -np.inf), [half_width / _FARTHEST]])
    upper = np.concatenate([kind.upper, np.full(len(found.factors), np.inf), [half_width * _FARTHEST]])

    def at(trial: Array) -> tuple[float, Array, Array, Array]:
        columns, slopes, pulls = joint_fit.columns_at(segments, kind, trial[:k])
        factors = trial[k:-1]
        by_values = joint_fit.slopes_by_values(factors, slopes, pulls)
        driven = columns @ factors
        place = _places(segments, driven, float(trial[-1]))
        carried, at_rest = _carried(segments, place)
        slopes = np.column_stack([by_values, columns, -np.ones(len(place))])[carried]
        slopes[:, -1] *= place[carried]
        slopes[at_rest] = 0.0
        residual = positions - driven + trial[-1] * place
        return float(residual @ residual), residual, slopes, place

    point = np.concatenate([found.values, found.factors, [half_width]])
    squares, residual, slopes, place = at(point)
    damping = 1e-4
    for _ in range(_ITERATIONS):
        sizes = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
        scaled = slopes / sizes
        normal, gradient = scaled.T @ scaled, scaled.T @ residual
        for _ in range(_MORE_DAMPED):
            step = np.linalg.lstsq(normal + damping * np.eye(len(normal)), gradient, rcond=1e-13)[0] / sizes
            trial = np.clip(point + step, lower, upper)
            tried = at(trial)
            if tried[0] < squares:
                break
            damping *= 8
        else:
            break
        gained, point = squares - tried[0], trial
        squares, residual, slopes, place = tried
        damping = max(damping / 10, 1e-9)
        if gained < _PROGRESS * squares:
            break
    half_width = float(point[-1])
    parts = zip(segments, joint_fit.by_segment(segments, half_width * place), strict=True)
    mended = [each._replace(positions=each.positions + part) for each, part in parts]
    return joint_fit.fit_at(mended, kind, point[:k]), mended, half_width


def _places(segments: list[joint_fit.Segment], driven: Array, half_width: float) -> Array:
    """Return where in a play what drives it is, −1 … 1; it begins with the joint where it was measured."""
    place = np.zeros(len(driven))
    parts = (joint_fit.by_segment(segments, each) for each in (np.ascontiguousarray(driven), place))
    for each, values, out in zip(segments, *parts, strict=True):
        _play_position(values, float(each.positions[0]), half_width, out)
    return place


def _carried(segments: list[joint_fit.Segment], place: Array) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return for each sample the last one at which the joint was carried, and which have none in their segment."""
    rows, sizes = np.arange(len(place)), [len(each.times) for each in segments]
    starts = np.repeat(np.cumsum(sizes) - sizes, sizes)
    carried = np.maximum.accumulate(np.where(np.abs(place) > 1 - 1e-9, rows, -1))
    at_rest = carried < starts
    return np.where(at_rest, rows, carried), at_rest
