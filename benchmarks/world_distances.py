"""Distances of 100,000 random pairs of bodies' shapes against Coal's: the largest difference of each kind of pair.

Coal iterates for boxes, cylinders and hulls (its tolerance is set to 1e-12 m); for round shapes it has closed forms.
Penetration depths are left out where Coal's search for them ends at another depth than the least, which is counted:
ours is then the smaller one.

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

from dqcontrol.geometry import Shape, distance_kernels

KINDS = ("sphere", "capsule", "box", "cylinder", "plane", "hull")
SEED = 41


def main(pairs: int = 100_000) -> None:
    """Print a line for each kind of pair."""
    rng = np.random.default_rng(SEED)
    kinds = [each for each in combinations_with_replacement(KINDS, 2) if each != ("plane", "plane")]
    each = -(-pairs // len(kinds))
    print(f"{each} pairs of each kind, {each * len(kinds)} in all; differences in m")
    print("pair                     apart   largest    99.9 %   inside   largest    deeper in Coal   ns ours")
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
        apart, difference = ours > 0, np.abs(ours - theirs)
        deeper = ~apart & (theirs < ours - 1e-6)
        alike = ~apart & ~deeper
        print(
            f"{first + ', ' + second:22} {apart.sum():7d} {difference[apart].max(initial=0):9.1e} "
            f"{np.quantile(difference[apart], 0.999):9.1e} {(~apart).sum():8d} {difference[alike].max(initial=0):9.1e} "
            f"{deeper.sum():16d} {1e9 * took:9.0f}"
        )


def _rows(shapes: list[Shape]) -> np.ndarray:
    """Return the numbers of shapes, rows of hulls with fewer corners filled up."""
    out = np.zeros((len(shapes), max(len(shape.row) for shape in shapes)))
    for row, shape in zip(out, shapes, strict=True):
        row[: len(shape.row)] = shape.row
    return out


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
