"""Search for the best compromises of two objectives, with few evaluations: interpolate, look ahead, evaluate.

Both objectives are interpolated over the points known (SciPy's thin-plate splines); of many candidates those are
evaluated next that the interpolation expects to add the largest area to what the front dominates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.tuning.simplex_search import Point, sobol_points

_FIRST = 16
_AT_ONCE = 8
_CANDIDATES = 128
_NEAR = (0.1, 0.03)  # spreads of candidates about the front
_BEYOND = 0.1  # of the front's width lies the corner up to which areas count

Pair = tuple[float, float]


def search_front(
    pair: Callable[[Point], Pair | None], size: int, budget: int, seed: int
) -> dict[Point, Pair]:
    """Return all points evaluated, with their objectives, of those that keep the constraints.

    Parameters
    ----------
    pair
        Returns both objectives of a point, to be small; None where constraints are violated.
    size
        Number of coordinates, each 0 … 1.
    budget
        Number of evaluations.
    seed
        Of the first points and the candidates.

    Examples
    --------
    >>> from dqcontrol.tuning.front_search import nondominated, search_front
    >>> found = search_front(lambda point: (point[0], 1 - point[0] ** 0.5 + point[1]), 2, 40, seed=0)
    >>> len(nondominated(list(found.values()))) > 10
    True
    """
    asked: set[Point] = set()
    found: dict[Point, Pair] = {}

    def ask(point: Point) -> None:
        asked.add(point)
        if (values := pair(point)) is not None and all(map(math.isfinite, values)):
            found[point] = values

    for point in sobol_points(size, min(_FIRST, budget), seed):
        ask(point)
    draw = np.random.default_rng([seed, 1])
    while len(asked) < budget:
        fresh = _promising(found, size, min(_AT_ONCE, budget - len(asked)), draw)
        for point in fresh:
            ask(point)
    return found


def _promising(found: dict[Point, Pair], size: int, count: int, draw: np.random.Generator) -> list[Point]:
    """Return so many points to look at next."""
    if len(found) < size + 4:  # too few to interpolate
        return [tuple(map(float, draw.random(size))) for _ in range(count)]
    points, values = np.array(list(found)), np.array(list(found.values()))
    scaled = _spread_out(values)
    front = points[nondominated(scaled)]
    candidates = [draw.random((_CANDIDATES, size))]
    for spread in _NEAR:
        chosen = front[draw.integers(len(front), size=_CANDIDATES)]
        candidates.append(np.clip(chosen + spread * draw.standard_normal(chosen.shape), 0.0, 1.0))
    if len(front) > 1:  # between neighbours
        first, second = (front[draw.integers(len(front), size=_CANDIDATES)] for _ in range(2))
        candidates.append(first + draw.random((_CANDIDATES, 1)) * (second - first))
    pool = np.vstack(candidates)
    # These take as long to load as all of ours: only where they are used.
    from scipy.interpolate import RBFInterpolator
    from scipy.spatial.distance import cdist

    distances = cdist(pool, points, "chebyshev").min(axis=1)
    pool = pool[distances > 1e-3] if (distances > 1e-3).any() else pool
    expected = RBFInterpolator(points, scaled, smoothing=1e-9)(pool)
    hopeful = ~_dominated(scaled, expected)
    if hopeful.sum() >= count:  # what is dominated now adds no area later
        pool, expected = pool[hopeful], expected[hopeful]
    known, chosen = scaled, []
    for _ in range(count):
        gains = _added_areas(known, expected)
        best = int(gains.argmax())
        chosen.append(tuple(map(float, pool[best])))
        known = np.vstack([known, expected[best]])
        expected[best] = np.inf
    return list(dict.fromkeys(chosen))


def _spread_out(values: Array) -> Array:
    """Return objectives on scales on which the front is about one wide; logarithms where all are positive."""
    logs = np.log(values) if (values > 0).all() else values
    front = logs[nondominated(logs)]
    width = np.ptp(front, axis=0)
    width = np.where(width > 0, width, np.where(np.ptp(logs, axis=0) > 0, np.ptp(logs, axis=0), 1.0))
    return (logs - front.min(axis=0)) / width


def _dominated(known: Array, expected: Array) -> NDArray[np.bool_]:
    """Return which expected pairs a known one is not worse than in both numbers."""
    front = known[nondominated(known)]
    before = np.searchsorted(front[:, 0], expected[:, 0], side="right") - 1
    return (before >= 0) & (front[before, 1] <= expected[:, 1])


def _added_areas(known: Array, expected: Array) -> Array:
    """Return by how much each expected pair enlarges the area that the known ones dominate."""
    front = known[nondominated(known)]
    corner = front.max(axis=0) + _BEYOND
    x, y = expected.T
    # The front is a staircase that falls from the corner's height; a pair adds what lies above it and below the stairs.
    steps = np.append(front[:, 0], corner[0])
    below = np.append(0.0, np.cumsum(front[:, 1] * np.diff(steps)))  # the stairs, from their first step on
    end = steps[np.searchsorted(-front[:, 1], -y)]  # from there on the stairs are lower than the pair
    before = corner[1] * np.minimum(x - steps[0], 0.0)
    reached = np.interp(end, steps, below) - np.interp(x, steps, below) - before
    areas = np.where((x < end) & (y < corner[1]), reached - y * (end - x), 0.0)
    return np.where(np.isfinite(expected).all(axis=1), areas, -1.0)


def nondominated(values: Sequence[Pair] | Array) -> list[int]:
    """Return the places of pairs that no other is better than in one and as good in the other, by their first number.

    Examples
    --------
    >>> nondominated([(1.0, 3.0), (2.0, 2.0), (2.0, 4.0), (3.0, 1.0)])
    [0, 1, 3]
    """
    array = np.asarray(values, dtype=float)
    order = np.lexsort((array[:, 1], array[:, 0]))
    second = array[order, 1]
    least = np.fmin.accumulate(np.append(math.inf, second[:-1]))  # of those before; NaN is no number
    return order[second < least].tolist()


def hypervolume(values: Sequence[Pair] | Array, corner: Pair) -> float:
    """Return the area between pairs, each to be small, and a corner beyond them.

    Examples
    --------
    >>> hypervolume([(0.0, 1.0), (1.0, 0.0)], (2.0, 2.0))
    3.0
    """
    array = np.asarray(values, dtype=float)
    array = array[(array < np.asarray(corner)).all(axis=1)]
    if not len(array):
        return 0.0
    front = array[nondominated(array)]
    right = np.append(front[1:, 0], corner[0])
    return float(np.sum((right - front[:, 0]) * (corner[1] - front[:, 1])))
