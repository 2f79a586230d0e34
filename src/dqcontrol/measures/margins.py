"""How far the joints stay from their limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ShapeError
from dqcontrol.files.long_array import BLOCK
from dqcontrol.loop.record import Record
from dqcontrol.robots.limits import Limits

AT_LIMIT = 1e-3  # rad or m: a joint so near its limit is at it
UNSEEN = 1e-6  # rad or m beyond a limit: no encoder tells it, and stops in physics give way by less


def joint_margins(record: Record, limits: Limits) -> NDArray[np.float64]:
    """Return each configuration variable's distance from its nearest limit over time, shape (n, N), rad or m.

    It is negative beyond the limit and infinite where there is none.

    Raises
    ------
    ShapeError
        If the limits do not fit the record.
    """
    _check_fit(record, limits)
    q = np.ascontiguousarray(record.q.T)  # NumPy is slow along a long axis of short rows
    return np.minimum(q - limits.lower[:, None], limits.upper[:, None] - q)


def least_margin(record: Record, limits: Limits | None) -> tuple[float, str]:
    """Return the least distance from a joint limit and that joint's name; NaN without limits or for a diverged run."""
    if limits is None:
        return math.nan, ""
    _check_fit(record, limits)
    least, largest = np.inf, -np.inf
    for first in range(0, len(record), BLOCK):
        q = np.ascontiguousarray(record.q[first : first + BLOCK].T)  # see above
        least, largest = np.minimum(least, q.min(axis=1)), np.maximum(largest, q.max(axis=1))
    margins = np.minimum(least - limits.lower, limits.upper - largest)
    if np.isnan(margins).any() or np.isinf(margins).all():
        return math.nan, ""
    nearest = int(margins.argmin())
    return float(margins[nearest]), record.joint_names[nearest]


def _check_fit(record: Record, limits: Limits) -> None:
    if len(limits.lower) != record.q.shape[1]:
        raise ShapeError(
            f"limits: expected {record.q.shape[1]} as in the record's q, got {len(limits.lower)}"
        )
