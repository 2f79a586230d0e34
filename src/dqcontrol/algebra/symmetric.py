"""Small symmetric systems, in place: faster here than LAPACK, which is made for large ones."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

_SWEEPS = 12  # cyclic Jacobi on 8 × 8 converges in 5 or 6


@inline
def cholesky(gram, m):
    """Factor the lower triangle in place; return False if it is not positive definite."""
    for j in range(m):
        pivot = gram[j, j]
        for k in range(j):
            pivot -= gram[j, k] * gram[j, k]
        # m², of Jacobians in metres: rounding of a Gram matrix, 2⁻⁵² |G|, is little less
        if not pivot > 1e-14:
            return False
        pivot = 1.0 / math.sqrt(pivot)
        gram[j, j] = pivot  # the reciprocal: every later use divides
        for i in range(j + 1, m):
            value = gram[i, j]
            for k in range(j):
                value -= gram[i, k] * gram[j, k]
            gram[i, j] = value * pivot
    return True


@inline
def cholesky_solve(factor, m, y):
    """Solve in place with the factor that has reciprocal pivots."""
    for i in range(m):
        value = y[i]
        for k in range(i):
            value -= factor[i, k] * y[k]
        y[i] = value * factor[i, i]
    for i in range(m - 1, -1, -1):
        value = y[i]
        for k in range(i + 1, m):
            value -= factor[k, i] * y[k]
        y[i] = value * factor[i, i]


@inline
def inverse_trace(factor, m, column):
    """Return tr G⁻¹ = ‖L⁻¹‖², an upper bound of 1/σ²min."""
    total = 0.0
    for j in range(m):
        column[j] = factor[j, j]
        total += column[j] * column[j]
        for i in range(j + 1, m):
            value = 0.0
            for k in range(j, i):
                value -= factor[i, k] * column[k]
            column[i] = value * factor[i, i]
            total += column[i] * column[i]
    return total


@inline
def diagonalise(gram, m, vectors):
    """Diagonalise a symmetric matrix in place by cyclic Jacobi rotations; columns of vectors are eigenvectors."""
    for i in range(m):
        for j in range(m):
            vectors[i, j] = 1.0 if i == j else 0.0
            if j > i:
                gram[i, j] = gram[j, i]
    for _ in range(_SWEEPS):
        off, diagonal = 0.0, 0.0
        for i in range(m):
            diagonal += gram[i, i] * gram[i, i]
            for j in range(i):
                off += gram[i, j] * gram[i, j]
        if off <= 1e-30 * diagonal:  # squares: what is left is the rounding of a rotation, 1e-15
            break
        for p in range(m - 1):
            for r in range(p + 1, m):
                apr = gram[p, r]
                if apr == 0.0:
                    continue
                theta = (gram[r, r] - gram[p, p]) / (2.0 * apr)
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(m):
                    akp, akr = gram[k, p], gram[k, r]
                    gram[k, p], gram[k, r] = c * akp - s * akr, s * akp + c * akr
                for k in range(m):
                    apk, ark = gram[p, k], gram[r, k]
                    gram[p, k], gram[r, k] = c * apk - s * ark, s * apk + c * ark
                    vkp, vkr = vectors[k, p], vectors[k, r]
                    vectors[k, p], vectors[k, r] = c * vkp - s * vkr, s * vkp + c * vkr


@inline
def smallest_singular_value(jacobian, gram, vectors):
    """Return the smallest singular value of J (6 × n).

    Parameters
    ----------
    jacobian
        Any Jacobian of six rows.
    gram, vectors
        Scratch, 6 × 6 each; a corner is used for n < 6.
    """
    n = jacobian.shape[1]
    m = min(n, 6)
    for i in range(m):
        for j in range(i + 1):
            value = 0.0
            if n < 6:
                for k in range(6):
                    value += jacobian[k, i] * jacobian[k, j]
            else:
                for k in range(n):
                    value += jacobian[i, k] * jacobian[j, k]
            gram[i, j] = value
    diagonalise(gram, m, vectors)
    least = gram[0, 0]
    for i in range(1, m):
        least = min(least, gram[i, i])
    return math.sqrt(max(least, 0.0))
