"""Damped and filtered inverses of task Jacobians. [Wampler 1986; Maciejewski and Klein 1988; Chiaverini 1997]"""

from __future__ import annotations

import math
from typing import Annotated

from msgspec import Meta, Struct

from dqcontrol.algebra.symmetric import cholesky, cholesky_solve, diagonalise, inverse_trace
from dqcontrol.compiled.compile import NOT_FINITE, OK, SINGULAR, attached, inlined
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.errors import as_positive
from dqcontrol.laws.least_norm import least_norm
from dqcontrol.robots.kinematics_kernels import hand_jacobian, position

DAMPED, FILTERED, BY_MANIPULABILITY = 0.0, 1.0, 2.0
ELSEWHERE = -1  # not a failure: the law must solve with its own matrix
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


class ManipulabilityInverse(
    Struct, frozen=True, tag="manipulability", tag_field="kind", forbid_unknown_fields=True
):
    """Least squares damped where the manipulability is small: λ² = λ₀² (1 − m/m₀)² for m < m₀, else 0. [Nakamura 1986]

    m = √det(JJᵀ), J the Jacobian of the hand's [ω ; ṗ] (for fewer than six joints √det(NᵀN) of the law's own
    matrix). All directions are damped, not only the singular one.
    """

    threshold: Annotated[float, Meta(gt=0, description="m₀")] = 0.03
    damping: Annotated[float, Meta(gt=0, description="λ₀")] = 0.05

    def parameters(self) -> tuple[float, float, float]:
        """Return kind and numbers as compiled code reads them."""
        return (
            BY_MANIPULABILITY,
            as_positive("inverse.threshold", self.threshold),
            as_positive("inverse.damping", self.damping),
        )


Inverse = DampedInverse | FilteredInverse | ManipulabilityInverse


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
def _manipulability_damping(factor, m, inverse):
    """Return λ² from a Cholesky factor with reciprocal pivots: m = 1/Π(1/lᵢᵢ)."""
    product = 1.0
    for i in range(m):
        product *= factor[i, i]
    shortfall = 1.0 - 1.0 / (product * inverse[1])
    return inverse[2] * inverse[2] * shortfall * shortfall if shortfall > 0.0 else 0.0


@inlined
def _finite(command):
    """Return the status of a command, which may have overflowed."""
    check = 0.0
    for i in range(command.shape[0]):
        check += 0.0 * command[i]
    return OK if check == 0.0 else NOT_FINITE


@attached
def solve(matrix, y, preferred, inverse, work, out):
    """Write out = z + J⁺ (y − J z) for J of at most eight rows; y is overwritten.

    The smaller of JᵀJ and JJᵀ is used. The filtered inverse needs its eigenvalues only where tr G⁻¹ ≥ 1/σ²min cannot
    exclude a singular value below the threshold; elsewhere one Cholesky factorisation gives the same result.
    """
    rows, n = matrix.shape
    by_columns = n < rows
    m = n if by_columns else rows
    gram = as_matrix(work[0 : m * m], m, m)
    rhs = work[2 * _SQUARE : 2 * _SQUARE + m]
    scratch = work[2 * _SQUARE + _MOST_ROWS : 2 * _SQUARE + _MOST_ROWS + m]
    _gram(matrix, rows, n, by_columns, gram)
    check = 0.0
    for i in range(m):
        check += 0.0 * gram[i, i]
    for i in range(rows):
        for k in range(n):
            y[i] -= matrix[i, k] * preferred[k]
        check += 0.0 * y[i]
    if check != 0.0:
        return NOT_FINITE
    for i in range(m):
        rhs[i] = 0.0 if by_columns else y[i]
    if by_columns:
        for k in range(rows):
            for i in range(n):
                rhs[i] += matrix[k, i] * y[k]

    if inverse[0] == FILTERED:
        if cholesky(gram, m) and inverse_trace(gram, m, scratch) * inverse[1] * inverse[1] <= 1.0:
            cholesky_solve(gram, m, rhs)
        else:
            _gram(matrix, rows, n, by_columns, gram)
            _filtered_solve(gram, m, rhs, inverse, as_matrix(work[_SQUARE : _SQUARE + m * m], m, m), scratch)
    else:
        damping = inverse[1] * inverse[1]
        if inverse[0] == BY_MANIPULABILITY:
            regular = cholesky(gram, m)
            damping = _manipulability_damping(gram, m, inverse) if regular else inverse[2] * inverse[2]
            _gram(matrix, rows, n, by_columns, gram)
        for i in range(m):
            gram[i, i] += damping
        if not cholesky(gram, m):
            return SINGULAR
        cholesky_solve(gram, m, rhs)

    for i in range(n):
        out[i] = preferred[i] + (rhs[i] if by_columns else 0.0)
    if not by_columns:
        for k in range(rows):
            for i in range(n):
                out[i] += matrix[k, i] * rhs[k]
    return _finite(out)


@inlined
def solve_hand_twist(pose, twist_jacobian, hand_twist, preferred, smallest, inverse, work, out):
    """Write out = z + J_h⁺ (t − J_h z) for the hand's twist t = [ω ; ṗ], inertial axes; or return ELSEWHERE.

    Where J_h has full row rank, N⁺ = J_h⁺C⁺ for any task matrix N = C J_h with C of full column rank: a law that knows
    t = C⁺y gets N⁺y from one 6 × 6 system that all laws share. For the filtered inverse that holds where no singular
    value of N can be below the threshold, as σmin(N) ≥ σmin(C) σmin(J_h); ``smallest`` is σmin(C).
    """
    n = twist_jacobian.shape[1]
    if n < 6 or inverse[0] == DAMPED:
        return ELSEWHERE
    p = position(pose)
    if inverse[0] == BY_MANIPULABILITY:
        matrix, y = as_matrix(work[0 : 6 * n], 6, n), work[6 * n : 6 * n + 6]
        hand_jacobian(p, twist_jacobian, matrix)
        for i in range(6):
            y[i] = hand_twist[i]
        return solve(matrix, y, preferred, inverse, work[6 * n + 6 :], out)
    bound = inverse[1] / smallest
    return _least_norm(p, twist_jacobian, hand_twist, preferred, bound * bound, 0.0, (0.0, 0.0, 0.0), out)


@inlined
def solve_pose_rate(pose, twist_jacobian, hand_twist, preferred, offset, inverse, work, out):
    """Write `solve_hand_twist` for a C that takes t to vec8(½ξx), ξ = ω + ε(ṗ + ω × d), x = P + εdP, d the offset.

    With damping, Nᵀ(NNᵀ + λ²I)⁻¹y = J_hᵀ (J_h J_hᵀ + λ²(CᵀC)⁻¹)⁻¹ t, and 4 CᵀC = [[(1 + d²) I, [d]×], [−[d]×, I]].
    """
    dx, dy, dz = offset
    square = dx * dx + dy * dy + dz * dz
    if inverse[0] == DAMPED:
        damping = 4.0 * inverse[1] * inverse[1]
        return _least_norm(position(pose), twist_jacobian, hand_twist, preferred, 0.0, damping, offset, out)
    smallest = 0.25 * (math.sqrt(square + 4.0) - math.sqrt(square))  # half that of [[1, 0], [|d|, 1]]
    return solve_hand_twist(pose, twist_jacobian, hand_twist, preferred, smallest, inverse, work, out)


@inlined
def solve_damped_twist(twist_jacobian, twist, preferred, inverse, out):
    """Write z + J_wᵀ(J_w J_wᵀ + λ²I)⁻¹ (ξ − J_w z), J_w the twist Jacobian: that of a hand in the origin."""
    origin = 0.0, 0.0, 0.0
    return _least_norm(origin, twist_jacobian, twist, preferred, 0.0, inverse[1] * inverse[1], origin, out)


@inlined
def _least_norm(position, twist_jacobian, hand_twist, preferred, limit, damping, offset, out):
    """Write z + J_h⁺ (t − J_h z), damped or not."""
    px, py, pz = position
    dx, dy, dz = offset
    if not least_norm(twist_jacobian, px, py, pz, hand_twist, preferred, limit, damping, dx, dy, dz, out):
        return ELSEWHERE
    return _finite(out)
