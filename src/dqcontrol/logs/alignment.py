"""When a motion begins in a log: the shift of time at which log and reference fit best."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.references import Reference

_LEVER = 0.3  # m; points so far from the end effector's origin turn with it
_SAMPLES = 500  # of the log that are compared
_SHIFTS = 400  # that are tried before the best one is refined
_STILL = 1e-4  # m; motions below it have no time to be found


class Alignment(NamedTuple):
    """When the reference begins, s after the log's first sample; RMS distances of points there and at 0, m."""

    begin: float
    rms: float
    unshifted_rms: float


def align(time: Array, poses: Array, reference: Reference) -> Alignment:
    """Return the begin of the reference at which it is nearest to the logged poses, over the whole log.

    Compared are three points of the end effector, its origin and one 0.3 m along each of two axes, so that turns count.
    The reference rests at its ends. Where the robot lags behind, its lag counts as part of the shift.

    Parameters
    ----------
    time
        Of the log, shape (N,), s from 0.
    poses
        Of the end effector, shape (N, 8).
    reference
        With an end.

    Raises
    ------
    ValueRangeError
        If the reference has no end, or one of the two hardly moves.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> circle = dqc.references.Circle(start=[1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=2.0)
    >>> late = circle.samples(np.maximum(np.arange(0, 4, 0.01) - 0.7, 0))[:, :8]
    >>> round(align(np.arange(0, 4, 0.01), late, circle).begin, 3)
    0.7
    """
    if not np.isfinite(reference.duration):
        raise ValueRangeError(
            "align: the reference has no end and no motion to find in the log; give --start-time"
        )
    chosen = np.unique(np.linspace(0, len(time) - 1, _SAMPLES).round().astype(int))
    at, logged = time[chosen], _points(poses[chosen])
    grid = np.linspace(0.0, reference.duration, 4 * _SAMPLES)
    from scipy.optimize import minimize_scalar

    desired = _points(reference.samples(grid)[:, :8])
    for name, points in (("the reference", desired), ("the logged hand", logged)):
        if np.ptp(points, axis=0).max() < _STILL:
            raise ValueRangeError(f"align: {name} hardly moves; give --start-time")

    def cost(begin: float) -> float:
        shifted = np.column_stack([np.interp(at - begin, grid, each) for each in desired.T])
        return float(np.mean(np.sum((shifted - logged) ** 2, axis=1)) / 3)

    shifts = np.linspace(-reference.duration, float(time[-1]), _SHIFTS)
    best = int(np.argmin([cost(shift) for shift in shifts]))
    bounds = shifts[max(best - 1, 0)], shifts[min(best + 1, _SHIFTS - 1)]
    found = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-5})
    return Alignment(float(found.x), float(np.sqrt(found.fun)), float(np.sqrt(cost(0.0))))


def _points(poses: Array) -> Array:
    """Return three points that turn with the end effector, shape (N, 9), m."""
    frames = algebra.matrix_from_pose(poses)
    x, y, origin = (frames[:, :3, column] for column in (0, 1, 3))
    return np.concatenate([origin, origin + _LEVER * x, origin + _LEVER * y], axis=1)
