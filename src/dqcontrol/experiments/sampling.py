"""Which points a parameter study visits: grids, random and quasi-random sets, each point known by its number."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.experiments.spec.reference_base import Part

_MOST_POINTS = 10_000_000


class Range(Part, frozen=True, kw_only=True):
    """An interval that a key is drawn from.

    Parameters
    ----------
    low, high
        Its ends, in the unit of the key.
    scale
        ``"linear"``, ``"log"`` (uniform in the logarithm) or ``"integer"`` (both ends included).
    count
        Number of equal steps' ends on the scale, for grids only.
    """

    low: float
    high: float
    scale: Literal["linear", "log", "integer"] = "linear"
    count: Annotated[int, Meta(ge=2)] | None = None

    def check(self, field: str, *, grid: bool) -> None:
        """Raise if it is empty, or does not fit the method."""
        if not self.low < self.high:
            raise ValueRangeError(f"{field}: low must be < high, got {self.low:g} and {self.high:g}")
        if self.scale == "log" and self.low <= 0:
            raise ValueRangeError(f"{field}: a log range needs low > 0, got {self.low:g}")
        if self.scale == "integer" and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueRangeError(f"{field}: expected integers, got {self.low:g} and {self.high:g}")
        if grid and self.count is None:
            raise ShapeError(f"{field}: a range in a grid needs 'count', the number of its values")
        if not grid and self.count is not None:
            raise ShapeError(
                f"{field}: 'count' is for grids; say with 'points' how many points there are in all"
            )

    def at(self, share: float) -> float | int:
        """Return the value at a share of the interval, 0 to 1."""
        if self.scale == "integer":
            return int(self.low) + min(int(share * (self.high - self.low + 1)), int(self.high - self.low))
        if share in (0, 1):
            return self.high if share else self.low
        if self.scale == "log":
            return min(max(self.low * (self.high / self.low) ** share, self.low), self.high)
        return self.low + share * (self.high - self.low)

    def steps(self) -> list[float | int]:
        """Return its values in a grid."""
        shares = np.linspace(0, 1, self.count or 2).tolist()
        if self.scale == "integer":  # rounded, not cut into equal shares
            return [round(self.low + share * (self.high - self.low)) for share in shares]
        return [self.at(share) for share in shares]


Values = Annotated[list[Any], Meta(min_length=1)]
Point = dict[str, Any]


class Sampling(Part, frozen=True, kw_only=True):
    """The points of a parameter study.

    Parameters
    ----------
    method
        ``"grid"``: every combination; ``"random"``: uniform and independent; ``"sobol"`` (scrambled) and ``"halton"``
        (scrambled): quasi-random sequences, which fill the space evenly.
    points
        Their number; a grid has its own.
    seed
        Of the points.
    over
        By key of the spec, as ``law.gain``, a list of values or a `Range`.
    """

    method: Literal["grid", "random", "sobol", "halton"] = "grid"
    points: Annotated[int, Meta(ge=1, le=_MOST_POINTS)] | None = None
    seed: Annotated[int, Meta(ge=0, le=2**62)] = 0
    over: Annotated[dict[str, Values | Range], Meta(min_length=1)]

    def check(self) -> None:
        """Raise if the ranges are empty or do not fit the method, or there are too many points.

        Raises
        ------
        ValueRangeError, ShapeError
            Naming the key.
        """
        grid = self.method == "grid"
        for key, values in self.over.items():
            if isinstance(values, Range):
                values.check(f"sweep.over.{key}", grid=grid)
        if grid and self.points is not None:
            raise ShapeError("sweep.points: a grid has as many points as its values combine to; leave it out")
        if not grid and self.points is None:
            raise ShapeError(f"sweep: missing key 'points', which method '{self.method}' needs")
        if self.size > _MOST_POINTS:
            raise ValueRangeError(f"sweep: makes {self.size:,} points; at most {_MOST_POINTS:,}")
        if not grid:
            self._shares(0, 1)

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(map(len, self._grid())) if self.points is None else self.points

    def points_between(self, first: int, last: int) -> Iterator[Point]:
        """Return the points number ``first`` to ``last`` − 1: of each key its value.

        Examples
        --------
        >>> from dqcontrol.experiments.sampling import Range, Sampling
        >>> grid = Sampling(over={"law.gain": Range(low=1.0, high=100.0, scale="log", count=3), "seed": [0, 1]})
        >>> [round(point["law.gain"]) for point in grid.points_between(1, 5)]
        [1, 10, 10, 100]
        """
        if self.method == "grid":
            axes = self._grid()
            for number in range(first, last):
                places = np.unravel_index(number, [len(axis) for axis in axes])
                yield {key: axis[i] for key, axis, i in zip(self.over, axes, places, strict=True)}
            return
        for shares in self._shares(first, last).tolist():
            yield {
                key: values.at(share) if isinstance(values, Range) else values[int(share * len(values))]
                for (key, values), share in zip(self.over.items(), shares, strict=True)
            }

    def ends(self) -> Iterator[Point]:
        """Return the first point, and with every other value, or end of a range, in it."""
        (first,) = self.points_between(0, 1)
        yield first
        for key, values in self.over.items():
            for value in (values.at(0), values.at(1)) if isinstance(values, Range) else values:
                yield first | {key: value}

    def _grid(self) -> list[list[Any]]:
        return [values.steps() if isinstance(values, Range) else values for values in self.over.values()]

    def _shares(self, first: int, last: int) -> NDArray[np.float64]:
        """Return points of the unit cube, (last − first, keys)."""
        count, keys = last - first, len(self.over)
        if self.method == "random":
            return np.random.Generator(np.random.PCG64(self.seed).advance(first * keys)).random((count, keys))
        return quasi_random(self.method, keys, self.seed, first, last)


def quasi_random(method: str, size: int, seed: int, first: int, last: int) -> NDArray[np.float64]:
    """Return the points from ``first`` to before ``last`` of a sequence in the unit cube, shape (points, size).

    Parameters
    ----------
    method
        ``"sobol"`` or ``"halton"``.
    size
        Of a point.
    seed
        Scrambles the sequence.
    first, last
        Numbers of points, counted from 0.
    """
    from scipy.stats import qmc  # takes as long to load as all of ours: only where it is used

    engine = qmc.Sobol if method == "sobol" else qmc.Halton
    sequence = engine(size, rng=np.random.default_rng(seed))
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The balance properties")  # of the whole, not of a part of it
        return sequence.random(last - first)
