"""Search for the best point of the unit cube: Sobol points, then Nelder–Mead from the best of them.

Chosen after measurements on tunings of two parameters: 16 Sobol points and Nelder–Mead came within 2 % of the optimum
in about 20 evaluations, CMA-ES in 40 to 110, TPE in 25 to 90. Sobol's points are SciPy's, Nelder–Mead is NLopt's: on 36
tunings it was as good as SciPy's after 24, 60 and 120 evaluations, and between runs, which empty the caches, it takes
0.03 ms an evaluation, SciPy's 0.14.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import MissingExtraError
from dqcontrol.experiments.sampling import quasi_random

_MOST_SOBOL = 16
_SIDE = 0.15  # of the first simplex
_REJECTED = 1e9  # rank of what violates constraints, beside which all totals are small
_APART = 0.25  # between points that simplexes begin at
_FINE = 1e-3  # of a simplex, in shares of the cube
_MOST_RESTARTS = 100

Point = tuple[float, ...]
Rank = tuple[float, float]  # violation, total: what is smaller is better


class _BudgetSpentError(Exception):
    """No evaluation is left."""


class SimplexSearch:
    """Asks for the ranks of points until the budget is spent.

    Parameters
    ----------
    rank
        Returns violation and total of a point; constraints count before totals.
    size
        Number of coordinates, each 0 … 1.
    budget
        Largest number of points.
    seed
        Of the first points.

    Raises
    ------
    MissingExtraError
        If NLopt is not installed.

    Attributes
    ----------
    points
        All that were asked for, in their order, with their ranks.

    Examples
    --------
    >>> from dqcontrol.tuning.simplex_search import SimplexSearch
    >>> search = SimplexSearch(lambda point: (0.0, (point[0] - 0.3) ** 2 + (point[1] - 0.6) ** 2), 2, 60, seed=0)
    >>> [round(number, 2) for number in search.run()]
    [0.3, 0.6]
    """

    def __init__(self, rank: Callable[[Point], Rank], size: int, budget: int, seed: int) -> None:
        self._rank, self._size, self._budget, self._seed = rank, size, budget, seed
        self._nlopt = _nlopt()
        self.points: dict[Point, Rank] = {}

    def run(self) -> Point:
        """Return the best point found."""
        try:
            for point in sobol_points(self._size, self._first_points(), self._seed):
                self._value(point)
            begun: list[Point] = []
            for _ in range(_MOST_RESTARTS):
                begin = self._next_start(begun)
                begun.append(begin)
                self._descend(np.array(begin), _SIDE / (1 + len(begun) // 4))
        except _BudgetSpentError:
            pass
        return self.best

    @property
    def best(self) -> Point:
        """The best point so far."""
        return min(self.points, key=self.points.__getitem__)

    def _first_points(self) -> int:
        """Return a power of two, as Sobol points want it, that leaves most of the budget."""
        most = max(min(_MOST_SOBOL, self._budget // 3), 2)
        return 1 << (most.bit_length() - 1)

    def _next_start(self, begun: Sequence[Point]) -> Point:
        """Return the best point away from those that were begun at; the best of all if there is none."""
        if len(begun) % 2 == 0:
            return self.best
        points, ranks = np.array(list(self.points)), list(self.points.values())
        distances = np.linalg.norm(points[:, None] - np.array(begun)[None], axis=2).min(axis=1)
        away = [i for i in np.flatnonzero(distances > _APART).tolist() if ranks[i][0] == 0]
        return tuple(points[min(away, key=ranks.__getitem__)].tolist()) if away else self.best

    def _descend(self, begin: Array, side: float) -> None:
        simplex = self._nlopt.opt(self._nlopt.LN_NELDERMEAD, self._size)
        simplex.set_lower_bounds(0.0)
        simplex.set_upper_bounds(1.0)
        simplex.set_initial_step(side * np.where(begin > 0.5, -1.0, 1.0))
        simplex.set_xtol_abs(_FINE)
        simplex.set_maxeval(self._budget)
        simplex.set_min_objective(lambda point, _: self._value(tuple(point.tolist())))
        simplex.optimize(begin)

    def _value(self, point: Point) -> float:
        if point not in self.points:
            if len(self.points) >= self._budget:
                raise _BudgetSpentError
            self.points[point] = self._rank(point)
        violation, total = self.points[point]
        return _REJECTED * (1 + violation) if violation or not math.isfinite(total) else total


def sobol_points(size: int, count: int, seed: int) -> list[Point]:
    """Return quasi-random points of the unit cube, scrambled by a seed."""
    return [tuple(map(float, point)) for point in quasi_random("sobol", size, seed, 0, count)]


def _nlopt() -> Any:
    try:
        import nlopt
    except ImportError:
        raise MissingExtraError(
            "nlopt: is needed for searches and not installed; install it with: pip install 'dqcontrol[data]'"
        ) from None
    return nlopt
