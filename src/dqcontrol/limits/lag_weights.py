"""The answer of joints that lag to targets that reach them within a period."""

from __future__ import annotations

import math


def lag_weights(share: float, lag: float, period: float) -> tuple[float, float]:
    """Return the weight of the older target, and what is left of the distance to it after a period, exp(−T/τ).

    A target that is followed for the first share f of a period T, before the next one is for the rest, counts with
    (exp(−(1 − f)T/τ) − exp(−T/τ))/(1 − exp(−T/τ)).

    Parameters
    ----------
    share
        f, above 0, up to 1: of the period, in which the older target holds.
    lag
        Time constant τ, s; 0: joints are where their newest target is.
    period
        Period T, s.

    Examples
    --------
    >>> [round(each, 3) for each in lag_weights(0.5, 0.05, 0.01)]
    [0.475, 0.819]
    """
    if not lag:
        return 1.0 if share == 1 else 0.0, 0.0
    decay = math.exp(-period / lag)
    oldest = (
        1.0 if share == 1 else (math.exp((share - 1) * period / lag) - decay) / -math.expm1(-period / lag)
    )
    return oldest, decay
