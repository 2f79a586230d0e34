"""A fit refined by what a coarse encoder says: in which cell the joint was, and not that it was in the middle of it.

P(y) = Φ((y + δ/2 − m)/s) − Φ((y − δ/2 − m)/s) of a step δ, m what the model says. The likelihood is concave in m, so
Newton's steps from a least-squares fit go up; the width s is the one under which the log is likeliest.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import log_ndtr, ndtr

from dqcontrol.arrays import Array
from dqcontrol.logs.servos import joint_fit

_WIDTHS = (0.04, 0.06, 0.09, 0.13, 0.2, 0.3)  # of a step; narrower ones trust the model too much
_NO_BASIS = np.zeros((0, 0))
_ROUNDS = 12  # Newton steps; they end by themselves where the likelihood gains no more
_FARTHEST = 8.0  # standard deviations outside of a cell beyond which a sample pulls no harder


def refined(segments: list[joint_fit.Segment], found: joint_fit.Fit, resolution: float) -> joint_fit.Fit:
    """Return the likeliest fit near one of least squares, with its uncertainty.

    Parameters
    ----------
    segments
        As for the fit.
    found
        The fit.
    resolution
        Step of the encoder, rad or m.
    """
    positions = joint_fit.positions_of(segments)
    best, point = (-math.inf, np.zeros(0), None, 0.0), np.concatenate([found.values, found.factors])
    for spread in (width * resolution for width in reversed(_WIDTHS)):
        likelihood, point, columns = _climbed(segments, found, positions, point, resolution, spread)
        if likelihood <= best[0]:
            break
        best = likelihood, point, columns, spread
    _, point, columns, spread = best
    assert columns is not None
    values = point[: len(found.values)]
    score, weight, likelihood = _cells(columns.residual, resolution, spread)
    jacobian = columns.jacobian
    root = np.sqrt(weight)
    covariance = joint_fit.sandwich(jacobian * root[:, None], score, jacobian * score[:, None])
    return replace(joint_fit.fit_of(segments, found.kind, values, columns, covariance), likelihood=likelihood)


def _climbed(
    segments: list[joint_fit.Segment],
    found: joint_fit.Fit,
    positions: Array,
    point: Array,
    resolution: float,
    spread: float,
) -> tuple[float, Array, joint_fit.Columns]:
    """Return the log-likelihood at its top for a width, the parameters there and the columns."""
    k, kind = len(found.values), found.kind

    def at(trial: Array) -> tuple[float, joint_fit.Columns, Array, Array]:
        values, factors = trial[:k], trial[k:]
        columns, slopes, pulls = joint_fit.columns_at(segments, kind, values)
        by_values = joint_fit.slopes_by_values(factors, slopes, pulls)
        residual = positions - columns @ factors
        score, weight, likelihood = _cells(residual, resolution, spread)
        return likelihood, joint_fit.Columns(columns, by_values, _NO_BASIS, factors, residual), score, weight

    likelihood, columns, score, weight = at(point)
    for _ in range(_ROUNDS):
        jacobian = columns.jacobian
        sizes = np.linalg.norm(jacobian, axis=0)
        sizes[sizes == 0] = 1.0
        scaled = jacobian / sizes
        normal = (scaled * weight[:, None]).T @ scaled
        step = np.linalg.lstsq(normal, scaled.T @ score, rcond=1e-12)[0] / sizes
        for halved in range(6):
            trial = point + step / 2**halved
            trial[:k] = np.clip(trial[:k], kind.lower, kind.upper)
            tried = at(trial)
            if tried[0] >= likelihood:
                break
        else:
            break
        gained, point = tried[0] - likelihood, trial
        likelihood, columns, score, weight = tried
        if gained < 1e-4:
            break
    return likelihood, point, columns


def _cells(residual: Array, resolution: float, spread: float) -> tuple[Array, Array, float]:
    """Return the slope and the curvature (positive) of each sample's log-likelihood by the model, and their sum."""
    above, below = (residual + resolution / 2) / spread, (residual - resolution / 2) / spread
    # P is that of a cell on the side where the normal distribution is not 1: by symmetry, the negative side.
    flip = above + below > 0
    upper, lower = np.where(flip, -below, above), np.where(flip, -above, below)
    share = np.maximum(ndtr(upper) - ndtr(lower), 1e-300)
    far = upper < -_FARTHEST
    logarithm = np.where(far, log_ndtr(upper), np.log(share))
    at_upper, at_lower = (np.exp(-(end**2) / 2) / math.sqrt(2 * math.pi) for end in (upper, lower))
    slope = np.where(far, -upper, (at_upper - at_lower) / share)
    bend = np.where(far, 1.0, slope**2 + (upper * at_upper - lower * at_lower) / share)
    signed = np.where(flip, slope, -slope) / spread
    return signed, np.maximum(bend, 1e-9) / spread**2, float(logarithm.sum())
