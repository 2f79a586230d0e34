"""How far the joints stay from their limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ShapeError
from dqcontrol.files import long_array
from dqcontrol.loop.record import Record, part_of
from dqcontrol.robots.limits import Limits

AT_LIMIT = 1e-3  # rad or m: a joint so near its limit is at it


def joint_margins(record: Record, limits: Limits) -> NDArray[np.float64]:
    """Return each configuration variable's distance from its nearest limit over time, shape (n, N), rad or m.

    It is negative beyond the limit and infinite where there is none.

    Raises
    ------
    ShapeError
        If the limits do not fit the record.
    """
    if len(limits.lower) != record.q.shape[1]:
        raise ShapeError(
            f"limits: expected {record.q.shape[1]} as in the record's q, got {len(limits.lower)}"
        )
    q = np.ascontiguousarray(record.q.T)  # NumPy is slow along a long axis of short rows
    return np.minimum(q - limits.lower[:, None], limits.upper[:, None] - q)


def least_margin(record: Record, limits: Limits | None) -> tuple[float, str]:
    """Return the least distance from a joint limit and that joint's name; NaN without limits or for a diverged run."""
    if limits is None:
        return math.nan, ""
    block = long_array.BLOCK
    parts = (part_of(record, first, first + block) for first in range(0, len(record), block))
    margins = np.min([joint_margins(part, limits).min(axis=1) for part in parts], axis=0)
    if np.isnan(margins).any() or np.isinf(margins).all():
        return math.nan, ""
    nearest = int(margins.argmin())
    return float(margins[nearest]), record.joint_names[nearest]
