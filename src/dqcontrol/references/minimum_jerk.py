"""The motion from rest to rest whose jerk is least: progress 10 s³ − 15 s⁴ + 6 s⁵ over a share s of the time."""

from __future__ import annotations

from dqcontrol.arrays import Array

PEAK_SPEED = 1.875  # times its mean: 15/8, at half of the time


def progress(share: Array) -> Array:
    """Return how far a motion is, 0 … 1, at shares 0 … 1 of its time [Flash and Hogan 1985].

    Examples
    --------
    >>> import numpy as np
    >>> progress(np.array([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    return share**3 * (10 - 15 * share + 6 * share**2)
