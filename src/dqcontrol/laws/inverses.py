"""Damped and filtered inverses of task Jacobians. [Wampler 1986; Maciejewski and Klein 1988; Chiaverini 1997]"""

from __future__ import annotations

from typing import Annotated, ClassVar, NamedTuple

from msgspec import Meta

from dqcontrol.algebra.symmetric import cholesky, cholesky_solve, diagonalise, inverse_trace
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import NOT_FINITE, OK, SINGULAR, inline, shared
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import added_damping
from dqcontrol.named_fields import CheckedFields

DAMPED, FILTERED, BY_MANIPULABILITY = 0.0, 1.0, 2.0

_MOST_ROWS = 6  # of a twist


class InverseParameters(NamedTuple):
    """What compiled code knows of an inverse.

    Attributes
    ----------
    kind
        One of the numbers above.
    level
        λ of the damped inverse, ε of the filtered one, m₀.
    damping
        λ of the filtered inverse, λ₀.
    length
        ℓ, m.
    growth
        c of the filtered inverse.
    share
        Of the error's turns, x and y what damping grows with; see `growth.counted`.
    """

    kind: float
    level: float
    damping: float
    length: float
    growth: float
    share: float = 1.0


inverse_parameters: MemoryLayout[InverseParameters] = MemoryLayout(InverseParameters)


class SolverWork(NamedTuple):
    """What `solve` needs beside its matrix; its system has six unknowns at most."""

    gram: Annotated[Array, _MOST_ROWS * _MOST_ROWS]
    vectors: Annotated[Array, _MOST_ROWS * _MOST_ROWS]
    solution: Annotated[Array, _MOST_ROWS]
    column: Annotated[Array, _MOST_ROWS]


solver_work: MemoryLayout[SolverWork] = MemoryLayout(SolverWork, unchecked=True)

_Length = Annotated[float, Meta(gt=0, description="ℓ, m: as many metres count as much as a radian")]


class DampedInverse(CheckedFields, frozen=True, tag="damped", tag_field="kind", forbid_unknown_fields=True):
    """Damped least squares with a constant factor: J⁺ = Jᵀ(JJᵀ + λ²I)⁻¹. [P16 2.18, Wampler 1986]

    J is the Jacobian of the end effector's [ℓω ; ṗ], as for `FilteredInverse`. It scales the response along each
    singular direction by σ²/(σ² + λ²), everywhere: a loss of loop gain. In the literature λ is added to a law's own
    matrix: for small errors that of N is half of this λ with ℓ = 1 m.
    """

    spec_key: ClassVar[str] = "inverse"
    damping: Annotated[float, Meta(gt=0, description="λ, m")]
    characteristic_length: _Length = 0.3

    def parameters(self) -> InverseParameters:
        """Return kind and numbers as compiled code reads them."""
        return InverseParameters(DAMPED, self.damping, 0.0, self.characteristic_length, 0.0)


class FilteredInverse(
    CheckedFields, frozen=True, tag="filtered", tag_field="kind", forbid_unknown_fields=True
):
    """Exact pseudoinverse away from singularities; near them only the small singular values are damped.

    J⁺ = Σ σᵢ/(σᵢ² + λᵢ) vᵢuᵢᵀ with λᵢ = (1 − (σᵢ/ε)²) λ² where σᵢ < ε, else 0. [Chiaverini 1997]

    J is the Jacobian of the end effector's [ℓω ; ṗ] for all laws, whatever error they feed back: σ, ε and λ are in
    metres of the end effector a radian of the joints, and what is asked for and cannot be done is missed by the least
    |[ℓω ; ṗ]|. So neither depends on where the base frame is, and ℓ says how much of a position error an angle is
    worth: with ℓ =
    0.3 m a radian counts as much as 30 cm.

    With λ = ε this is J-PARSE [Guptasarma et al. 2025] with ε in place of its γ σ_max. λ = ε/2 keeps the gain σ/(σ² +
    λᵢ) below 1.16/ε, and above 1/ε as long as σ > ε/3: `python benchmarks/singularities.py` shows how it was chosen.

    Where the target is out of reach, damping grows with the curvature C of the task that J leaves out
    (`laws/growth.py`): g = (c‖C‖ − 1/tr G⁻¹)₊ is added to all σ², G = JJᵀ, and λ² − g takes the place of λ², not less
    than 0. C vanishes with the error, so where that is small or σ large nothing is added, to the last bit; elsewhere
    the loop gain stays below k/c, and the robot comes to rest. On a base that drives, C is formed with a share of the
    errors that it drives away.
    """

    spec_key: ClassVar[str] = "inverse"
    threshold: Annotated[float, Meta(gt=0, description="ε, m: singular values below it are damped")] = 0.04
    damping: Annotated[float, Meta(gt=0, description="λ, m: the damping of a vanishing singular value")] = (
        0.02
    )
    characteristic_length: _Length = 0.3
    growth: (
        Annotated[float, Meta(ge=0, description="c; 0: none; default: by the loop's gain, period and lag")]
        | None
    ) = None

    def parameters(self) -> InverseParameters:
        """Return kind and numbers as compiled code reads them."""
        return InverseParameters(
            FILTERED,
            self.threshold,
            self.damping,
            self.characteristic_length,
            self.growth or 0.0,
        )


class ManipulabilityInverse(
    CheckedFields, frozen=True, tag="manipulability", tag_field="kind", forbid_unknown_fields=True
):
    """Least squares damped where the manipulability is small: λ² = λ₀² (1 − m/m₀)² for m < m₀, else 0. [Nakamura 1986]

    m = √det(JJᵀ), J the Jacobian of the end effector's [ω ; ṗ] (for fewer than six joints √det(JᵀJ)/ℓ³ of that of [ℓω ;
    ṗ]); the damping acts on that of [ℓω ; ṗ], as for `FilteredInverse`. All directions are damped, not only the
    singular one.
    """

    spec_key: ClassVar[str] = "inverse"
    threshold: Annotated[float, Meta(gt=0, description="m₀")] = 0.03
    damping: Annotated[float, Meta(gt=0, description="λ₀, m")] = 0.05
    characteristic_length: _Length = 0.3

    def parameters(self) -> InverseParameters:
        """Return kind and numbers as compiled code reads them."""
        return InverseParameters(
            BY_MANIPULABILITY,
            self.threshold,
            self.damping,
            self.characteristic_length,
            0.0,
        )


Inverse = DampedInverse | FilteredInverse | ManipulabilityInverse


@inline
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


@inline
def _filtered_solve(gram, m, y, inverse, added, vectors, scratch):
    """Replace y by f(G) y, f(σ²) = 1/(σ² + λ(σ) + added), through the eigenvalues of G; λ(0) becomes less by that."""
    diagonalise(gram, m, vectors)
    threshold = inverse.level * inverse.level
    vanishing = inverse.damping * inverse.damping - added
    for i in range(m):
        eigenvalue = max(gram[i, i], 0.0)
        if eigenvalue < threshold:
            eigenvalue += (1.0 - eigenvalue / threshold) * vanishing
        value = 0.0
        for k in range(m):
            value += vectors[k, i] * y[k]
        scratch[i] = value / (eigenvalue + added)
    for i in range(m):
        value = 0.0
        for k in range(m):
            value += vectors[i, k] * scratch[k]
        y[i] = value


@inline
def _manipulability_damping(factor, m, inverse):
    """Return λ² from a Cholesky factor with reciprocal pivots: m = 1/Π(1/lᵢᵢ), without the ℓ of three rows."""
    product = inverse.length * inverse.length * inverse.length
    for i in range(m):
        product *= factor[i, i]
    shortfall = 1.0 - 1.0 / (product * inverse.level)
    return inverse.damping * inverse.damping * shortfall * shortfall if shortfall > 0.0 else 0.0


@inline
def finite(command):
    """Return the status of a command, which may have overflowed."""
    check = 0.0
    for i in range(command.shape[0]):
        check += 0.0 * command[i]
    return OK if check == 0.0 else NOT_FINITE


@shared
def solve(matrix, y, preferred, missing, inverse_numbers, work, out):
    """Write out = z + J⁺ (y − J z) for J of at most six rows; y is overwritten.

    The smaller of JᵀJ and JJᵀ is used. The filtered inverse needs its eigenvalues only where tr G⁻¹ ≥ 1/σ²min cannot
    exclude a singular value below the threshold; elsewhere one Cholesky factorisation gives the same result, or two,
    where its damping grows with the curvature of what is missing, see `added_damping`.
    """
    inverse, own = inverse_parameters(inverse_numbers), solver_work(work)
    rows, n = matrix.shape
    by_columns = n < rows
    m = n if by_columns else rows
    gram, rhs, scratch = as_matrix(own.gram, m, m), own.solution, own.column
    _gram(matrix, rows, n, by_columns, gram)
    columns = 0.0
    for i in range(m):
        columns += gram[i, i]
    check = 0.0 * columns
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

    if inverse.kind == FILTERED:
        regular, least = cholesky(gram, m), 0.0
        if regular:
            trace = inverse_trace(gram, m, scratch)
            least = 1.0 / trace
            regular = trace * inverse.level * inverse.level <= 1.0
        added = added_damping(missing, inverse.growth, columns, least)
        regular = regular or added >= inverse.damping * inverse.damping
        if not regular or added > 0.0:
            _gram(matrix, rows, n, by_columns, gram)
        if regular and added > 0.0:
            for i in range(m):
                gram[i, i] += added
            regular = cholesky(gram, m)
        if regular:
            cholesky_solve(gram, m, rhs)
        else:
            _filtered_solve(gram, m, rhs, inverse, added, as_matrix(own.vectors, m, m), scratch)
    else:
        damping = inverse.level * inverse.level
        if inverse.kind == BY_MANIPULABILITY:
            regular = cholesky(gram, m)
            damping = (
                _manipulability_damping(gram, m, inverse) if regular else inverse.damping * inverse.damping
            )
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
    return finite(out)
