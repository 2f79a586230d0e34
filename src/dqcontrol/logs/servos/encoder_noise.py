"""How fine an encoder is and how much it trembles, from what it gave."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array

_MULTIPLE = 0.06  # of a step: RMS by which differences may miss whole numbers of steps
_LEAST_LEVELS = 4
_MOST_LEVELS = 20_000
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
