"""Quadratic programs, and programs whose rows give way level by level instead of having no answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.constraints import active_set
from dqcontrol.constraints.levels import levels_size, room_for_levels, solve_levels
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_count

ITERATIONS = 500  # the most that 10⁵ random programs of 30 inputs and 200 rows needed is about half of it
_STATUS = {
    active_set.SOLVED: "solved",
    active_set.INFEASIBLE: "infeasible",
    active_set.LIMIT: "iteration limit",
}


@dataclass(frozen=True, eq=False)
class ProgramSolution:
    """What a quadratic program's solver found.

    Attributes
    ----------
    u
        The minimiser, shape (n,). Without a solution it is inside lower and upper all the same: where rows contradict
        each other, with the least squares of violations; at the limit of iterations, the nearest to the last iterate.
    multipliers
        Of the rows, shape (m,), ≥ 0 for inequalities: Hu + g + rowsᵀ multipliers + bound_multipliers = 0.
    bound_multipliers
        Of lower (≤ 0) and upper (≥ 0), shape (n,).
    active
        Numbers of the active constraints: i of row i, m + k of upper, m + n + k of lower of input k.
    status
        ``"solved"``, ``"infeasible"`` or ``"iteration limit"``.
    violations
        How much u violates the rows, shape (m,): max(0, rows u − bounds), of equations |rows u − bounds|.
    """

    u: Array
    multipliers: Array
    bound_multipliers: Array
    active: NDArray[np.intp]
    status: str
    violations: Array


@dataclass(frozen=True, eq=False)
class LevelSolution:
    """What was found where rows give way level by level.

    Attributes
    ----------
    u
        Shape (n,), always inside lower and upper.
    violations
        Of all rows, shape (m,): max(0, rows u − bounds), of equations |rows u − bounds|.
    gave_way
        Names of the rows that are violated, the worst first.
    status
        ``"solved"``; or ``"iteration limit"``, if the solver stopped: u is then best for the levels before.
    """

    u: Array
    violations: Array
    gave_way: tuple[str, ...]
    status: str


def quadratic_program(
    hessian: ArrayLike,
    gradient: ArrayLike,
    rows: ArrayLike,
    bounds: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    equalities: int = 0,
    *,
    active: ArrayLike | None = None,
) -> ProgramSolution:
    """Minimise ½ uᵀHu + gᵀu subject to rows u ≤ bounds and lower ≤ u ≤ upper, by a dual active set method.

    Parameters
    ----------
    hessian, gradient
        H, shape (n, n), symmetric and positive definite, and g, shape (n,); n ≤ 30.
    rows, bounds
        Shapes (m, n) and (m,); the first ``equalities`` rows are equations. They may depend on each other.
        A bound of inf is none.
    lower, upper
        Bounds of u, shape (n,); none if omitted.
    equalities
        How many of the rows are equations.
    active
        The ``active`` of the solution of a similar program, from which the search starts.

    Returns
    -------
    ProgramSolution
        ``u``, ``multipliers``, ``active``, ``status``; it never raises because there is no answer.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, H not positive definite, or lower above upper.

    Notes
    -----
    D. Goldfarb, A. Idnani, A numerically stable dual method for solving strictly convex quadratic programs,
    Mathematical Programming 27, 1983; D. Arnström, A. Bemporad, D. Axehill, A dual active-set solver for embedded
    quadratic programming using recursive LDLᵀ updates, IEEE TAC 67, 2022.

    Examples
    --------
    The point of a half-plane that is nearest to (2, 1):

    >>> import dqcontrol as dqc
    >>> found = dqc.constraints.quadratic_program([[1, 0], [0, 1]], [-2, -1], [[1, 0]], [0.5])
    >>> found.u.tolist(), found.multipliers.tolist(), found.status
    ([0.5, 1.0], [1.5], 'solved')
    """
    flat, n, m = _packed(hessian, gradient, rows, bounds, lower, upper, equalities)
    room = active_set.room_for(n, m, soft=False)
    sets = np.zeros((1, room + 2), np.intp)
    if active is not None:
        _set_active(sets[0], active, room, n, m)
    answer = np.empty((1, 3 * n + m))
    scratch = np.empty(active_set.scratch_size(n, m, room))
    active_set.solve_programs(flat[None], n, m, ITERATIONS, answer, sets, scratch)
    status, u = int(sets[0, -1]), answer[0, :n]
    if status == active_set.INDEFINITE:
        least = float(np.linalg.eigvalsh(as_array("hessian", hessian))[0])
        raise ValueRangeError(f"hessian: must be positive definite, its least eigenvalue is {least:.3g}")
    program = active_set.unpack_program(flat, n, m)
    if status == active_set.INFEASIBLE:
        u = _by_levels(flat, np.zeros(m, np.intp), 1, n, m)[0]
    u = np.clip(u, program.lower, program.upper) if status != active_set.SOLVED else u
    count = int(sets[0, 0])
    return ProgramSolution(
        u,
        answer[0, n : n + m],
        answer[0, n + m : 2 * n + m] - answer[0, 2 * n + m :],
        sets[0, 1 : 1 + count],
        _STATUS[status],
        _violations(program, u),
    )


def lexicographic_program(
    levels: ArrayLike,
    rows: ArrayLike,
    bounds: ArrayLike,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    *,
    equalities: Sequence[int] = (),
    hessian: ArrayLike | None = None,
    gradient: ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> LevelSolution:
    """Minimise violations level by level, then ½ uᵀHu + gᵀu: there is always an answer inside lower and upper.

    First the squares of the violations of the rows of level 0 are minimised, then those of level 1 as far as level 0
    loses nothing, and so on. Violations of the least squares are unique, so later levels keep each row as it is: its
    bound, moved by its violation, becomes an equation.

    Parameters
    ----------
    levels
        Level of each row, shape (m,): 0 comes first.
    rows, bounds
        rows u ≤ bounds, shapes (m, n) and (m,), n ≤ 30, in any order. Within a level a violation counts by its size:
        let rows of a level have one unit.
    lower, upper
        Bounds of u that hold always, shape (n,); none if omitted.
    equalities
        Indices of rows that are equations (a task).
    hessian, gradient
        Objective of what is left free: H, shape (n, n), positive definite, and g, shape (n,); |u|² if omitted.
    names
        Name of each row; ``row 0`` … if omitted.

    Returns
    -------
    LevelSolution
        ``u``, ``violations`` and the names of the rows that gave way.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, H not positive definite, or lower above upper.

    Examples
    --------
    A wall asks for u ≤ 1, another for u ≥ 2 of lower rank, a task for u = 5 comes last:

    >>> import dqcontrol as dqc
    >>> found = dqc.constraints.lexicographic_program(
    ...     [0, 1, 2], [[1], [-1], [1]], [1, -2, 5], equalities=[2], names=["wall", "gate", "task"]
    ... )
    >>> found.u.round(12).tolist(), found.gave_way
    ([1.0], ('task', 'gate'))
    """
    matrix = as_array("rows", rows, (None, None))
    n = matrix.shape[-1]
    flat, n, m = _packed(
        np.eye(n) if hessian is None else hessian,
        np.zeros(n) if gradient is None else gradient,
        matrix,
        bounds,
        lower,
        upper,
        0,
    )
    given = np.asarray(levels) if np.size(levels) else np.zeros(0, np.intp)
    if given.shape != (m,) or given.dtype.kind not in "iu" or (given < 0).any():
        raise ShapeError(f"levels: expected {m} integers ≥ 0, one a row, got {levels!r:.80}")
    if names is not None and len(names) != m:
        raise ShapeError(f"names: expected {m}, one a row, got {len(names)}")
    program = active_set.unpack_program(flat, n, m)
    for index in equalities:
        if not 0 <= index < m:
            raise ValueRangeError(f"equalities: expected numbers of rows, 0 … {m - 1}, got {index}")
        program.equal[index] = 1.0
        if not np.isfinite(program.bounds[index]):
            raise ValueRangeError(
                f"bounds: of equations must be finite, got {program.bounds[index]} of row {index}"
            )
    order = np.unique(given)
    u, status = _by_levels(flat, np.searchsorted(order, given).astype(np.intp), len(order), n, m)
    if status == active_set.INDEFINITE:
        raise ValueRangeError("hessian: must be positive definite")
    violations = _violations(program, u)
    gave = violations > 1e-9 * (1 + np.abs(np.where(np.isfinite(program.bounds), program.bounds, 0.0)))
    worst = [int(i) for i in np.argsort(-violations, kind="stable") if gave[i]]
    return LevelSolution(
        u,
        violations,
        tuple(f"row {i}" if names is None else names[i] for i in worst),
        "solved" if status == active_set.SOLVED else "iteration limit",
    )


def _packed(
    hessian: ArrayLike,
    gradient: ArrayLike,
    rows: ArrayLike,
    bounds: ArrayLike,
    lower: ArrayLike | None,
    upper: ArrayLike | None,
    equalities: int,
) -> tuple[Array, int, int]:
    """Return a checked program as compiled code takes it, n and m."""
    g = as_array("gradient", gradient, (None,))
    n = g.shape[-1]
    matrix = as_array("rows", rows, (None, n)) if np.size(rows) else np.zeros((0, n))
    m = matrix.shape[-2]
    h = as_array("hessian", hessian, (n, n))
    if g.ndim != 1 or h.ndim != 2 or matrix.ndim != 2:
        raise ShapeError("hessian, gradient, rows: expected one program, no batch")
    if not 0 < n <= active_set.LARGEST:
        raise ShapeError(f"gradient: 1 … {active_set.LARGEST} inputs are allowed, got {n}")
    if np.abs(h - h.T).max() > 1e-9 * np.abs(h).max():
        raise ValueRangeError(
            f"hessian: must be symmetric, differs from its transpose by {np.abs(h - h.T).max():.3g}"
        )
    if as_count("equalities", equalities) > m:
        raise ValueRangeError(f"equalities: there are {m} rows, got {equalities}")
    flat = np.zeros(active_set.program_size(n, m))
    program = active_set.unpack_program(flat, n, m)
    program.hessian[:], program.gradient[:] = h, g
    program.columns[:], program.bounds[:] = matrix.T, _limits("bounds", bounds, m)
    if not np.isfinite(program.bounds[:equalities]).all():
        raise ValueRangeError("bounds: of equations must be finite")
    program.equal[:equalities] = 1.0
    program.lower[:] = -np.inf if lower is None else _limits("lower", lower, n)
    program.upper[:] = np.inf if upper is None else _limits("upper", upper, n)
    if (program.lower > program.upper).any():
        k = int(np.argmax(program.lower - program.upper))
        raise ValueRangeError(
            f"lower: must be ≤ upper, got {program.lower[k]:g} > {program.upper[k]:g} of input {k}"
        )
    return flat, n, m


def _limits(field: str, value: ArrayLike, size: int) -> Array:
    """Return limits, which may be infinite but not NaN."""
    given = np.asarray(value)
    if given.dtype.kind in "iuf":
        as_array(field, np.where(np.isinf(given), 0.0, given), (size,))
        if given.ndim == 1:
            return given.astype(np.float64)
    raise ShapeError(f"{field}: expected {size} numbers, got {value!r:.80}")


def _set_active(chosen: NDArray[np.intp], active: ArrayLike, room: int, n: int, m: int) -> None:
    numbers = np.asarray(active)
    if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
        raise ShapeError(f"active: expected integers, got {active!r:.80}")
    if numbers.size and not 0 <= int(numbers.min()) <= int(numbers.max()) < m + 2 * n:
        raise ValueRangeError(
            f"active: expected numbers of constraints, 0 … {m + 2 * n - 1}, got {active!r:.80}"
        )
    count = min(len(numbers), room)
    chosen[0], chosen[1 : 1 + count] = count, numbers[:count]


def _by_levels(flat: Array, levels: NDArray[np.intp], count: int, n: int, m: int) -> tuple[Array, int]:
    u, chosen = np.zeros(n), np.zeros(room_for_levels(n, m) + 2, np.intp)
    memory = np.empty(levels_size(n, m))
    return u, solve_levels(flat, levels, count, n, m, ITERATIONS, memory, u, chosen)


def _violations(program: active_set.Program, u: Array) -> Array:
    excess = program.columns.T @ u - program.bounds
    return np.where(program.equal > 0, np.abs(excess), np.maximum(excess, 0.0))
