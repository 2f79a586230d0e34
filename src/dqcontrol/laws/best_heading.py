"""The heading that suits a differential drive, from the Jacobian alone."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.symmetric import cholesky, cholesky_solve
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.memory_layout import MemoryLayout

_REGULAR = 1e-9  # share of the trace that makes a Gram matrix of less than full rank invertible


class HeadingWork(NamedTuple):
    """Scratch of `turn_to_best_heading`."""

    gram: Annotated[Array, 6, 6]
    column: Annotated[Array, 6]


heading_work: MemoryLayout[HeadingWork] = MemoryLayout(HeadingWork)


@inline
def _gram_without(twist_jacobian, left_out, center, gram):
    """Write the lower triangle of Σ ξξᵀ over all columns but one, moved to a center, slightly regularised."""
    ox, oy, oz = center
    for i in range(6):
        for j in range(i + 1):
            gram[i, j] = 0.0
    trace = 0.0
    for c in range(twist_jacobian.shape[1]):
        if c == left_out:
            continue
        a, b, e = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        column = (
            a,
            b,
            e,
            twist_jacobian[3, c] - (oy * e - oz * b),
            twist_jacobian[4, c] - (oz * a - ox * e),
            twist_jacobian[5, c] - (ox * b - oy * a),
        )
        for i in range(6):
            trace += column[i] * column[i]
            for j in range(i + 1):
                gram[i, j] += column[i] * column[j]
    for i in range(6):
        gram[i, i] += _REGULAR * trace


@inline
def turn_to_best_heading(twist_jacobian, j, work):
    """Return the angle, −π/2 … π/2, from the heading of the drive with input v at j to the best one.

    With G = Σ ξξᵀ over all columns but v and c = [0 ; h], det(JJᵀ) = det G (1 + cᵀG⁻¹c): the best heading h is the
    principal axis of the horizontal part of G⁻¹. Forwards and backwards are the same.
    """
    own = heading_work(work)
    gram, column = own.gram, own.column
    ax, ay, az = twist_jacobian[0, j + 1], twist_jacobian[1, j + 1], twist_jacobian[2, j + 1]
    mx, my, mz = twist_jacobian[3, j + 1], twist_jacobian[4, j + 1], twist_jacobian[5, j + 1]
    hx, hy, hz = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
    sx, sy, sz = ay * hz - az * hy, az * hx - ax * hz, ax * hy - ay * hx
    axle = ay * mz - az * my, az * mx - ax * mz, ax * my - ay * mx
    _gram_without(twist_jacobian, j, axle, gram)
    if not cholesky(gram, 6):
        return 0.0
    for i in range(3):
        column[i] = 0.0
    column[3], column[4], column[5] = hx, hy, hz
    cholesky_solve(gram, 6, column)
    along = hx * column[3] + hy * column[4] + hz * column[5]
    mixed = sx * column[3] + sy * column[4] + sz * column[5]
    for i in range(3):
        column[i] = 0.0
    column[3], column[4], column[5] = sx, sy, sz
    cholesky_solve(gram, 6, column)
    across = sx * column[3] + sy * column[4] + sz * column[5]
    return 0.5 * math.atan2(2.0 * mixed, along - across)
