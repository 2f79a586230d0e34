"""What repeated runs tell: means with their intervals, differences on the same seeds, ratios of spreads.

All intervals and p values take the repeats to be independent and normally distributed; those of spreads
depend on it most.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from numpy.typing import ArrayLike

from dqcontrol.errors import ShapeError, ValueRangeError, as_array

LEVEL = 0.95


@dataclass(frozen=True)
class Mean:
    """Mean of repeats.

    Attributes
    ----------
    count
        n, number of repeats.
    mean
        x̄.
    deviation
        Sample standard deviation s, with n − 1; NaN for one repeat.
    """

    count: int
    mean: float
    deviation: float

    @property
    def variation(self) -> float:
        """Coefficient of variation s / |x̄|, no unit; NaN for a mean of 0."""
        return self.deviation / abs(self.mean) if self.mean else math.nan

    def half_width(self, level: float = LEVEL) -> float:
        """Return t s / √n: the interval x̄ ± half_width holds the true mean with this confidence (Student 1908).

        Raises
        ------
        ValueRangeError
            If the level is not between 0 and 1.

        Examples
        --------
        >>> round(mean_of([1.0, 2.0, 3.0]).half_width(), 4)
        2.4841
        """
        _check_level(level)
        if self.count < 2:
            return math.nan
        from scipy import special  # half of Numba's import: only where it is used

        quantile = float(special.stdtrit(self.count - 1, (1 + level) / 2))
        return quantile * self.deviation / math.sqrt(self.count)


@dataclass(frozen=True)
class Difference:
    """Mean difference of two groups of runs on the same seeds.

    Attributes
    ----------
    pairs
        Number of seeds that both have.
    mean
        Mean of first − second; NaN without a pair.
    half_width
        Its confidence interval is mean ± half_width; NaN with fewer than two pairs.
    p_value
        Of the two-sided paired t test that the true mean difference is 0; 1 if all differences are 0.
    """

    pairs: int
    mean: float
    half_width: float
    p_value: float

    @property
    def excludes_zero(self) -> bool:
        """Whether 0 lies outside the interval."""
        return abs(self.mean) > self.half_width


@dataclass(frozen=True)
class SpreadRatio:
    """Ratio of the standard deviations of two groups of runs.

    Attributes
    ----------
    ratio
        First over second; NaN if one of them has fewer than two runs, or the second no spread.
    low, high
        Ends of its confidence interval.
    p_value
        Of the two-sided F test that the true ratio is 1.
    """

    ratio: float
    low: float
    high: float
    p_value: float

    @property
    def excludes_one(self) -> bool:
        """Whether 1 lies outside the interval."""
        return self.low > 1 or self.high < 1


def mean_of(values: ArrayLike) -> Mean:
    """Return mean and sample standard deviation; equal values have exactly no spread.

    Raises
    ------
    ShapeError, ValueRangeError
        If there is no value, or one is not finite.

    Examples
    --------
    >>> mean_of([1.0, 2.0, 3.0])
    Mean(count=3, mean=2.0, deviation=1.0)
    """
    numbers = as_array("values", values, (None,)).tolist()
    if not numbers:
        raise ShapeError("values: expected at least one, got none")
    deviation = statistics.stdev(numbers) if len(numbers) > 1 else math.nan
    return Mean(len(numbers), statistics.mean(numbers), deviation)


def paired_difference(
    first: Mapping[Hashable, float], second: Mapping[Hashable, float], level: float = LEVEL
) -> Difference:
    """Compare two groups of runs seed by seed: what the same noise does to both cancels.

    Parameters
    ----------
    first, second
        A number of each run by the run's seed. Seeds that only one group has are left out.
    level
        Of confidence.

    Raises
    ------
    ValueRangeError
        If a number is not finite or the level not between 0 and 1.

    Examples
    --------
    >>> found = paired_difference({1: 2.0, 2: 3.1, 3: 4.2}, {1: 1.0, 2: 2.0, 3: 3.0})
    >>> found.pairs, round(found.mean, 3), found.excludes_zero
    (3, 1.1, True)
    """
    from scipy import special

    _check_level(level)
    differences = [value - second[seed] for seed, value in first.items() if seed in second]
    if not differences:
        return Difference(0, math.nan, math.nan, math.nan)
    found = mean_of(differences)
    if found.count < 2:
        p_value = math.nan
    elif found.deviation == 0:
        p_value = 0.0 if found.mean else 1.0
    else:
        t = abs(found.mean) / (found.deviation / math.sqrt(found.count))
        p_value = 2 * float(special.stdtr(found.count - 1, -t))
    return Difference(found.count, found.mean, found.half_width(level), p_value)


def spread_ratio(first: Mean, second: Mean, level: float = LEVEL) -> SpreadRatio:
    """Compare how well two groups of runs repeat, by the F distribution of s₁²/s₂².

    Parameters
    ----------
    first, second
        Groups of independent runs.
    level
        Of confidence.

    Raises
    ------
    ValueRangeError
        If the level is not between 0 and 1.

    Examples
    --------
    >>> spread_ratio(mean_of([1.0, 5.0, 9.0]), mean_of([1.0, 2.0, 3.0])).ratio
    4.0
    """
    from scipy import special

    _check_level(level)
    if first.count < 2 or second.count < 2 or second.deviation == 0:
        return SpreadRatio(math.nan, math.nan, math.nan, math.nan)
    ratio = first.deviation / second.deviation
    freedom = first.count - 1, second.count - 1
    upper, lower = (float(special.fdtri(*freedom, (1 + sign * level) / 2)) for sign in (1, -1))
    tails = float(special.fdtr(*freedom, ratio**2)), float(special.fdtrc(*freedom, ratio**2))
    return SpreadRatio(ratio, ratio / math.sqrt(upper), ratio / math.sqrt(lower), min(1.0, 2 * min(tails)))


def _check_level(level: float) -> None:
    if not 0 < level < 1:
        raise ValueRangeError(f"level: must be between 0 and 1, got {level:g}")
