"""Distances of 100,000 random pairs of bodies' shapes against Coal's: the largest difference of each kind of pair.

Coal iterates for boxes, cylinders and hulls (its tolerance is set to 1e-12 m); for round shapes it has closed forms.
Penetration depths are left out where Coal's search for them ends at another depth than the least, which is counted:
ours is then the smaller one. Of cylinders Coal's distance is wrong now and then, or the largest number there is:
where it is off, alternating projections onto both decide, and Coal's errors that they find are counted.

Usage: python benchmarks/world_distances.py [PAIRS]
"""

from __future__ import annotations

import sys
import time
from itertools import combinations_with_replacement
from pathlib import Path

import coal
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from shape_samples import coal_distance, random_shape

from dqcontrol.geometry import Cylinder, Shape, distance_kernels

KINDS = ("sphere", "capsule", "box", "cylinder", "plane", "hull")
SEED = 41
OFF = 1e-6  # m


def main(pairs: int = 100_000) -> None:
    """Print a line for each kind of pair."""
    rng = np.random.default_rng(SEED)
    kinds = [each for each in combinations_with_replacement(KINDS, 2) if each != ("plane", "plane")]
    each = -(-pairs // len(kinds))
    print(f"{each} pairs of each kind, {each * len(kinds)} in all; differences in m")
    print(
        "pair                     apart   largest    99.9 %   inside   largest    deeper in Coal   Coal wrong   ns ours"
    )
    for first, second in kinds:
        a, b = (
            [random_shape(first, rng) for _ in range(each)],
            [random_shape(second, rng) for _ in range(each)],
        )
        rows = [_rows(shapes) for shapes in (a, b)]
        out = np.empty((each, distance_kernels.FOUND))
        distance_kernels.distances(rows[0][:1], rows[1][:1], out[:1])
        begin = time.process_time()
        distance_kernels.distances(*rows, out)
        took = (time.process_time() - begin) / each
        ours = out[:, distance_kernels.DISTANCE]
        theirs = np.array([coal_distance(coal, *pair) for pair in zip(a, b, strict=True)])
        wrong = np.zeros(each, bool)
        for i in np.flatnonzero((ours > 0) & (np.abs(ours - theirs) > OFF)):
            if isinstance(a[i], Cylinder) and isinstance(b[i], Cylinder):
                wrong[i] = abs(_by_projections(a[i], b[i]) - ours[i]) < OFF
            else:
                wrong[i] = abs(theirs[i]) == np.finfo(float).max
        apart, difference = (ours > 0) & ~wrong, np.abs(ours - theirs)
        deeper = (ours <= 0) & (theirs < ours - 1e-6)
        alike = (ours <= 0) & ~deeper
        print(
            f"{first + ', ' + second:22} {apart.sum():7d} {difference[apart].max(initial=0):9.1e} "
            f"{np.quantile(difference[apart], 0.999):9.1e} {(ours <= 0).sum():8d} "
            f"{difference[alike].max(initial=0):9.1e} {deeper.sum():16d} {wrong.sum():12d} {1e9 * took:9.0f}"
        )


def _by_projections(a: Cylinder, b: Cylinder) -> float:
    """Return the distance of two solid cylinders by von Neumann's projections onto one and the other in turn."""
    at = a.start
    for _ in range(100_000):
        other = _nearest_point(b, at)
        before, at = at, _nearest_point(a, other)
        if np.abs(at - before).max() < 1e-13:
            break
    return float(np.linalg.norm(at - _nearest_point(b, at)))


def _nearest_point(cylinder: Cylinder, point: np.ndarray) -> np.ndarray:
    axis = cylinder.end - cylinder.start
    length = float(np.linalg.norm(axis))
    along = (point - cylinder.start) @ axis / length
    aside = point - cylinder.start - along * axis / length
    aside *= min(1.0, cylinder.radius / max(float(np.linalg.norm(aside)), 1e-300))
    return cylinder.start + min(max(along, 0.0), length) * axis / length + aside


def _rows(shapes: list[Shape]) -> np.ndarray:
    """Return the numbers of shapes, rows of hulls with fewer corners filled up."""
    out = np.zeros((len(shapes), max(len(shape.row) for shape in shapes)))
    for row, shape in zip(out, shapes, strict=True):
        row[: len(shape.row)] = shape.row
    return out


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
