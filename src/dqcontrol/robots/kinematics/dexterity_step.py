"""Dexterity of an end effector, compiled."""

from __future__ import annotations

import math

from dqcontrol.algebra.symmetric import diagonalise
from dqcontrol.compiled.compile import inline


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
