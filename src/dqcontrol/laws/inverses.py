"""Damped and filtered inverses of task Jacobians. [Wampler 1986; Maciejewski and Klein 1988; Chiaverini 1997]"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

from dqcontrol.compile import NOT_FINITE, OK, SINGULAR, inlined
from dqcontrol.errors import as_positive
from dqcontrol.laws.least_norm import least_norm
from dqcontrol.laws.symmetric import cholesky, cholesky_solve, diagonalise, inverse_trace

DAMPED, FILTERED = 0.0, 1.0
HEAD = 3  # parameters that an inverse puts first: kind, and two numbers

_MOST_ROWS = 8
_SQUARE = _MOST_ROWS * _MOST_ROWS


class DampedInverse(Struct, frozen=True, tag="damped", tag_field="kind", forbid_unknown_fields=True):
    """Damped least squares with a constant factor: J⁺ = Jᵀ(JJᵀ + λ²I)⁻¹. [P16 2.18, Wampler 1986]

    It scales the response along each singular direction by σ²/(σ² + λ²), everywhere: a loss of loop gain.
    """

    damping: Annotated[float, Meta(gt=0, description="λ, in units of the Jacobian's singular values")]

    def parameters(self) -> tuple[float, float, float]:
        """Return kind and numbers as compiled code reads them."""
        return DAMPED, as_positive("inverse.damping", self.damping), 0.0


class FilteredInverse(Struct, frozen=True, tag="filtered", tag_field="kind", forbid_unknown_fields=True):
    """Exact pseudoinverse away from singularities; near them only the small singular values are damped.

    J⁺ = Σ σᵢ/(σᵢ² + λᵢ) vᵢuᵢᵀ with λᵢ = (1 − (σᵢ/ε)²) λ² where σᵢ < ε, else 0. [Chiaverini 1997]
    """

    threshold: Annotated[float, Meta(gt=0, description="ε: singular values below it are damped")] = 0.02
    damping: Annotated[float, Meta(gt=0, description="λ: the damping of a vanishing singular value")] = 0.05

    def parameters(self) -> tuple[float, float, float]:
        """Return kind and numbers as compiled code reads them."""
        return (
            FILTERED,
            as_positive("inverse.threshold", self.threshold),
            as_positive("inverse.damping", self.damping),
        )


Inverse = DampedInverse | FilteredInverse


def work_size() -> int:
    """Return the length of the work array that `solve` needs beside its matrix."""
    return 2 * _SQUARE + 2 * _MOST_ROWS


@inlined
def _gram(matrix, rows, n, by_columns, gram):
    """Write the lower triangle of JᵀJ or JJᵀ."""
    if by_columns:
        for i in range(n):
            for j in range(i + 1):
                value = 0.0
                for k in range(rows):
                    value += matrix[k, i] * matrix[k, j]
                gram[i, j] = value
    else:
        for i in range(rows):
            for j in range(i + 1):
                value = 0.0
                for k in range(n):
                    value += matrix[i, k] * matrix[j, k]
                gram[i, j] = value


@inlined
def _filtered_solve(gram, m, y, inverse, vectors, scratch):
    """Replace y by f(G) y, f(σ²) = 1/(σ² + λ(σ)), through the eigenvalues of G."""
    diagonalise(gram, m, vectors)
    threshold = inverse[1] * inverse[1]
    for i in range(m):
        eigenvalue = max(gram[i, i], 0.0)
        if eigenvalue < threshold:
            eigenvalue += (1.0 - eigenvalue / threshold) * inverse[2] * inverse[2]
        value = 0.0
        for k in range(m):
            value += vectors[k, i] * y[k]
        scratch[i] = value / eigenvalue
    for i in range(m):
        value = 0.0
        for k in range(m):
            value += vectors[i, k] * scratch[k]
        y[i] = value


@inlined
def solve(matrix, rows, n, y, inverse, work, out):
    """Write out = J⁺ y for J (rows × n) of at most eight rows.

    The smaller of JᵀJ and JJᵀ is used. The filtered inverse needs its eigenvalues only where tr G⁻¹ ≥ 1/σ²min cannot
    exclude a singular value below the threshold; elsewhere one Cholesky factorisation gives the same result.
    """
    by_columns = n < rows
    m = n if by_columns else rows
    gram = work[0 : m * m].reshape(m, m)
    rhs = work[2 * _SQUARE : 2 * _SQUARE + m]
    scratch = work[2 * _SQUARE + _MOST_ROWS : 2 * _SQUARE + _MOST_ROWS + m]
    _gram(matrix, rows, n, by_columns, gram)
    check = 0.0
    for i in range(m):
        check += 0.0 * gram[i, i]
    for i in range(rows):
        check += 0.0 * y[i]
    if check != 0.0:
        return NOT_FINITE
    for i in range(m):
        rhs[i] = 0.0 if by_columns else y[i]
    if by_columns:
        for k in range(rows):
            for i in range(n):
                rhs[i] += matrix[k, i] * y[k]

    if inverse[0] == DAMPED:
        for i in range(m):
            gram[i, i] += inverse[1] * inverse[1]
        if not cholesky(gram, m):
            return SINGULAR
        cholesky_solve(gram, m, rhs)
    elif cholesky(gram, m) and inverse_trace(gram, m, scratch) * inverse[1] * inverse[1] <= 1.0:
        cholesky_solve(gram, m, rhs)
    else:
        _gram(matrix, rows, n, by_columns, gram)
        _filtered_solve(gram, m, rhs, inverse, work[_SQUARE : _SQUARE + m * m].reshape(m, m), scratch)

    if by_columns:
        for i in range(n):
            out[i] = rhs[i]
    else:
        for i in range(n):
            out[i] = 0.0
        for k in range(rows):
            for i in range(n):
                out[i] += matrix[k, i] * rhs[k]
    return OK


@inlined
def solve_regular(pose, twist_jacobian, hand_twist, bound, out):
    """Write the smallest u that gives the hand a twist [ω ; ṗ], inertial axes; return whether it is regular there.

    Regular: every singular value of the hand's Jacobian [ω ; ṗ] = J_h u is above ``bound``. Far from singularities any
    task matrix N = C J_h with C of full column rank has N⁺ = J_h⁺C⁺, so that one 6 × 6 system serves all laws.
    """
    if twist_jacobian.shape[1] < 6:
        return False
    w, i, j, k = pose[0], -pose[1], -pose[2], -pose[3]
    dw, di, dj, dk = pose[4], pose[5], pose[6], pose[7]
    px = 2.0 * (dw * i + di * w + dj * k - dk * j)
    py = 2.0 * (dw * j - di * k + dj * w + dk * i)
    pz = 2.0 * (dw * k + di * j - dj * i + dk * w)
    return least_norm(twist_jacobian, px, py, pz, hand_twist, bound * bound, out)
