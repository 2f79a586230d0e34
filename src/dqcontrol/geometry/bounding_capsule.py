"""Tight capsules around points, such as the corners of a mesh.

The simplex search is by hand, although SciPy has one: in the same time it finds the same volumes, to 2e-7, but in their
flat valleys other ends, up to 0.2 mm off for each metre of size, which would move all distances of known robots.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.geometry.shapes import Capsule

_DIRECTIONS = 200  # in which the farthest points are looked for: only these can touch a tight capsule
_STEPS = 400  # of each search
_SEEDS = 12  # directions of its axis: three principal ones, random ones against local minima


def bounding_capsule(points: ArrayLike) -> Capsule:
    """Return a small capsule that contains all points.

    Of a line and a radius r ≥ max ρ, the shortest segment that contains points with radial parts ρ and axial parts t
    runs from min(t + √(r² − ρ²)) to max(t − √(r² − ρ²)); the volume is minimised over line and radius by simplex
    searches (Nelder and Mead 1965) from three principal and nine other axes. The answer is the best that these find,
    which may not be the least of all, and contains every point whatever they find.

    Parameters
    ----------
    points
        Shape (N, 3), m. Of a mesh its corners are enough: a capsule is convex.

    Raises
    ------
    ShapeError, ValueRangeError
        If there are no points, the shape is wrong or a value not finite.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> rod = dqc.geometry.bounding_capsule([[0, 0, 0], [0, 0, 1], [0.1, 0, 0.5]])
    >>> bool(np.linalg.norm(rod.end - rod.start) > 0.8), bool(rod.volume < 0.02)
    (True, True)
    """
    given = as_array("points", points, (None, 3))
    if given.ndim != 2 or len(given) == 0:
        raise ShapeError(f"points: expected shape (N, 3), N ≥ 1, got {given.shape}")
    middle = given.mean(axis=0)
    size = float(np.abs(given - middle).max())
    if size == 0.0:
        return Capsule(middle, middle, 0.0)
    cloud = (given - middle) / size
    outer = _extreme(cloud)
    best, least = None, np.inf
    for axis in _seeds(outer):
        found, volume = _minimised(lambda x: _volume(x, outer), _start(axis, outer))
        if volume < least:
            best, least = found, volume
    assert best is not None
    low, high, radius = _capsule(best, cloud)  # of all points, not only of the outer ones
    return Capsule(middle + size * low, middle + size * high, size * radius)


def _extreme(cloud: Array) -> Array:
    """Return the points that are farthest in some direction of a fixed set."""
    k = np.arange(_DIRECTIONS) + 0.5
    z = 1 - 2 * k / _DIRECTIONS
    turn = np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - z * z)
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)
    return cloud[np.unique(np.argmax(cloud @ directions.T, axis=0))]


def _seeds(points: Array) -> Array:
    principal = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]
    others = np.random.default_rng(0).normal(size=(_SEEDS - 3, 3))
    return np.vstack([principal, others / np.linalg.norm(others, axis=1)[:, None]])


def _frame(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors across an axis."""
    first = np.asarray(np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))]), np.float64)
    first = first / np.linalg.norm(first)
    return first, np.asarray(np.cross(axis, first), np.float64)


def _start(axis: Array, points: Array) -> tuple[Array, Array, Array]:
    """Return where a search begins (offset 2, slope 2, radius beyond max ρ) and the frame that describes its line."""
    first, second = _frame(axis)
    across = points @ np.column_stack([first, second])
    offset = 0.5 * (across.min(axis=0) + across.max(axis=0))
    return np.array([*offset, 0.0, 0.0, 0.0]), axis, np.vstack([first, second])


Parameters = tuple[Array, Array, Array]


def _capsule(parameters: Parameters, points: Array) -> tuple[Array, Array, float]:
    """Return the ends and the radius of the shortest capsule on a line, which contains the points by construction."""
    numbers, axis, across = parameters
    origin = numbers[:2] @ across
    direction = axis + numbers[2:4] @ across
    direction = direction / np.linalg.norm(direction)
    relative = points - origin
    axial = relative @ direction
    radial = np.linalg.norm(relative - axial[:, None] * direction, axis=1)
    radius = float(radial.max()) * (1 + abs(numbers[4]))
    half = np.sqrt(np.maximum(radius * radius - radial**2, 0.0))
    low, high = float((axial + half).min()), float((axial - half).max())
    if low > high:  # one ball is enough
        low = high = 0.5 * (float(axial.min()) + float(axial.max()))
        radius = float(np.hypot(radial, axial - low).max())
    return origin + low * direction, origin + high * direction, radius


def _volume(parameters: Parameters, points: Array) -> float:
    low, high, radius = _capsule(parameters, points)
    return float(np.pi * radius**2 * (np.linalg.norm(high - low) + 4 / 3 * radius))


def _minimised(value: Callable[[Parameters], float], start: Parameters) -> tuple[Parameters, float]:
    """Minimise by the simplex method of Nelder and Mead."""
    numbers, axis, across = start
    n = len(numbers)

    def at(x: Array) -> float:
        return value((x, axis, across))

    simplex = np.vstack([numbers, numbers + 0.1 * np.eye(n)])
    values = np.array([at(x) for x in simplex])
    for _ in range(_STEPS):
        order = np.argsort(values, kind="stable")
        simplex, values = simplex[order], values[order]
        if values[-1] - values[0] <= 1e-9 * values[0]:
            break
        center = simplex[:-1].mean(axis=0)
        reflected = 2 * center - simplex[-1]
        found = at(reflected)
        if found < values[0]:
            stretched = 3 * center - 2 * simplex[-1]
            farther = at(stretched)
            simplex[-1], values[-1] = (stretched, farther) if farther < found else (reflected, found)
        elif found < values[-2]:
            simplex[-1], values[-1] = reflected, found
        else:
            nearer = center + 0.5 * ((reflected if found < values[-1] else simplex[-1]) - center)
            inside = at(nearer)
            if inside < min(found, values[-1]):
                simplex[-1], values[-1] = nearer, inside
            else:
                simplex[1:] = simplex[0] + 0.5 * (simplex[1:] - simplex[0])
                values[1:] = [at(x) for x in simplex[1:]]
    best = int(values.argmin())
    return (simplex[best], axis, across), float(values[best])
