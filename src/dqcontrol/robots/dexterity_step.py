"""How freely a hand can move, compiled."""

from __future__ import annotations

import math

from dqcontrol.algebra.symmetric import cholesky, diagonalise, inverse_trace
from dqcontrol.compiled.compile import inline
from dqcontrol.robots.singular_bound import singular_bound


@inline
def smallest_singular_value(jacobian, beyond, gram, vectors, column):
    """Return the smallest singular value of J (6 × n); some value ≥ ``beyond`` if it is at least that.

    Parameters
    ----------
    jacobian
        Any Jacobian of six rows.
    beyond
        What is no longer of interest: above it a factorisation answers, below it eigenvalues.
    gram, vectors
        Scratch, 6 × 6 each; a corner is used for n < 6.
    column
        Scratch, 6.
    """
    n = jacobian.shape[1]
    m = min(n, 6)
    if n >= 6:
        bound = singular_bound(jacobian)
        if bound >= beyond:
            return bound
    for attempt in range(1 if n >= 6 else 0, 2):
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
        if attempt == 0 and cholesky(gram, m):
            bound = 1.0 / math.sqrt(inverse_trace(gram, m, column))
            if bound >= beyond:
                return bound
    diagonalise(gram, m, vectors)
    least = gram[0, 0]
    for i in range(1, m):
        least = min(least, gram[i, i])
    return math.sqrt(max(least, 0.0))
