"""Programs whose rows give way level by level, compiled.

What a level has fixed (its equations, and the rows that it had to violate) leaves a subspace to the levels after it:
u = base + Z z with an orthonormal basis Z. Later levels choose z, so that nothing that they do, and no rounding of
theirs, moves what is fixed; rows without a part in the subspace disappear, so that no dependent equations are left;
and z = 0 keeps every row that remains, so that there always is an answer.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from numba import types

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, STATUS, WRITE, inline, kernel, shared
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.constraints import active_set

_RIDGE = 1e-7  # ρ² of least squares, relative to the largest row's square
_ROUNDS = 30  # each leaves ρ²/(σ² + ρ²) of what moves: where that is a half, `_ROUNDING` of it after 30
_RESTS = 1e-12  # how far a round moves z, relative to 1 + |z|, that has come to rest
_ROUNDING = 1e-9  # the same of one that may move it by rounding, if it moves it no less than the one before
_VIOLATED = 1e-10  # relative to 1 + |bound|; upper levels lose 4·10⁻¹² at most (docs/constraints.md)
_FIXED = 1e-10  # part of a row in the subspace, relative to the row, below which nothing moves it
_EQUAL = 0.5  # marks are 0 or 1


class LevelsWork(NamedTuple):
    """Work memory of the levels.

    Attributes
    ----------
    basis
        Z, by columns: the first d rows of it are in use.
    base
        What the levels so far have chosen.
    part
        Zᵀa of one row a; and a reflection.
    bounds
        Of the rows, moved by their violations.
    fixed
        1 for rows that the subspace keeps as they are.
    rest
        The program of z, with the bounds of u as rows, and the solver's work memory.
    """

    basis: Annotated[Array, "n", "n"]
    base: Annotated[Array, "n"]
    part: Annotated[Array, "n"]
    bounds: Annotated[Array, "m"]
    fixed: Annotated[Array, "m"]
    rest: Annotated[Array, ...]


levels_work: MemoryLayout[LevelsWork] = MemoryLayout(LevelsWork, "n", "m")


def room_for_levels(n: int, m: int) -> int:
    """Return how many constraints can be active: all rows and bounds, as soft ones may depend on each other."""
    return m + 2 * n


def levels_size(n: int, m: int) -> int:
    """Return how many numbers the work memory of `solve_levels` has."""
    rows = m + 2 * n
    return (
        levels_work.size(n, m)
        + active_set.program_size(n, rows)
        + active_set.scratch_size(n, rows, room_for_levels(n, m))
    )


@inline
def _part_of_row(given, work, p, n, d):
    """Write Zᵀa of a row; return |Zᵀa|² and |a|²."""
    whole, square = 0.0, 0.0
    for k in range(n):
        whole += given.columns[k, p] ** 2
    for j in range(d):
        value, column = 0.0, work.basis[j]
        for k in range(n):
            value += column[k] * given.columns[k, p]
        work.part[j] = value
        square += value * value
    return square, whole


@shared
def _fix_row(given, work, p, n, d):
    """Take the direction of a row out of the subspace; return the dimension that is left.

    A Householder reflection of the basis turns the row's part into its last direction.
    """
    square, whole = _part_of_row(given, work, p, n, d)
    if square <= _FIXED * _FIXED * whole:
        return d
    size, v = math.sqrt(square), work.part
    last = v[d - 1]
    v[d - 1] = last + (size if last >= 0.0 else -size)
    scale = 1.0 / (size * (size + abs(last)))
    for k in range(n):
        value = 0.0
        for j in range(d):
            value += v[j] * work.basis[j, k]
        value *= scale
        for j in range(d):
            work.basis[j, k] -= value * v[j]
    return d - 1


@inline
def _value(given, work, p, n):
    value = 0.0
    for k in range(n):
        value += given.columns[k, p] * work.base[k]
    return value


@shared
def _set_rows(given, work, program, levels, level, n, m, d):
    """Write the rows and bounds of z, the rows of this level as they are, those of earlier ones with length 1.

    Returns the square of the largest row of the level.
    """
    largest = 0.0
    for p in range(m):
        program.bounds[p], program.softness[p], program.equal[p] = math.inf, 0.0, 0.0
        if levels[p] > level or work.fixed[p] > 0.0 or given.bounds[p] == math.inf:
            continue
        square, whole = _part_of_row(given, work, p, n, d)
        if square <= _FIXED * _FIXED * whole:
            continue
        room = work.bounds[p] - _value(given, work, p, n)
        scale = 1.0
        if levels[p] == level:
            program.equal[p] = given.equal[p]
            largest = max(largest, square)
        else:
            scale = 1.0 / math.sqrt(square)
            room = max(room, 0.0)
        program.bounds[p] = scale * room
        for j in range(d):
            program.columns[j, p] = scale * work.part[j]
    for i in range(n):
        square = 0.0
        for j in range(d):
            square += work.basis[j, i] ** 2
        scale = 1.0 / math.sqrt(square) if square > _FIXED * _FIXED else 0.0
        for side, room in (
            (m + i, given.upper[i] - work.base[i]),
            (m + n + i, work.base[i] - given.lower[i]),
        ):
            program.bounds[side] = scale * max(room, 0.0) if scale > 0.0 else math.inf
            program.softness[side], program.equal[side] = 0.0, 0.0
            for j in range(d):
                program.columns[j, side] = scale * work.basis[j, i] * (1.0 if side < m + n else -1.0)
    for j in range(d):
        program.lower[j], program.upper[j] = -math.inf, math.inf
    return largest


@shared
def _least_squares(program, memory, chosen, d, rows, limit, z):
    """Minimise the squares of the soft rows' violations, whatever their rank: the centre follows z until it rests.

    Each round minimises |s|²/ρ² + |z − z₀|² (proximal point); the violation ends where no round changes it. A round
    that fails leaves what the one before it has found, which keeps all rows; the first says so.
    """
    for j in range(d):
        for k in range(d):
            memory.inverse[j, k] = 1.0 if j == k else 0.0
        memory.center[j] = 0.0
    status, before = active_set.LIMIT, math.inf
    for i in range(_ROUNDS):
        if i > 0:
            status = active_set.solve_recentered(program, memory, chosen, d, rows, limit, z)
        if status != active_set.SOLVED:
            chosen[0] = 0
            status = active_set.solve_centered(program, memory, chosen, d, rows, limit, z)
        if status != active_set.SOLVED:
            for j in range(d):
                z[j] = memory.center[j]
            return status
        moved, size = 0.0, 0.0
        for j in range(d):
            moved, size = max(moved, abs(z[j] - memory.center[j])), max(size, abs(z[j]))
            memory.center[j] = z[j]
        size += 1.0
        if moved <= _RESTS * size or (moved <= _ROUNDING * size and moved > 0.5 * before):
            break
        before = moved
    return status


@shared
def _move(given, work, z, n, d):
    """Move the base by z, inside the bounds of u."""
    for k in range(n):
        value = work.base[k]
        for j in range(d):
            value += work.basis[j, k] * z[j]
        work.base[k] = min(max(value, given.lower[k]), given.upper[k])


@shared
def _keep_level(given, work, levels, level, n, m, d):
    """Fix the equations of a level and the rows that it violates; return the dimension that is left."""
    for p in range(m):
        if levels[p] == level and given.bounds[p] < math.inf:
            violation = _value(given, work, p, n) - given.bounds[p]
            fixed = given.equal[p] > _EQUAL or violation > _VIOLATED * (1.0 + abs(given.bounds[p]))
            if fixed:
                work.fixed[p] = 1.0
                d = _fix_row(given, work, p, n, d)
            else:
                work.bounds[p] = given.bounds[p] + max(violation, 0.0)
    return d


@shared
def _set_objective(given, work, program, n, d):
    """Write ZᵀHZ and Zᵀ(H base + g)."""
    for j in range(d):
        for k in range(n):
            value = given.gradient[k] if j == 0 else 0.0
            for i in range(n):
                value += given.hessian[k, i] * (work.base[i] if j == 0 else 0.0)
            work.part[k] = value if j == 0 else work.part[k]
        value = 0.0
        for k in range(n):
            value += work.basis[j, k] * work.part[k]
        program.gradient[j] = value
    for j in range(d):
        for k in range(n):
            value = 0.0
            for i in range(n):
                value += given.hessian[k, i] * work.basis[j, i]
            work.part[k] = value
        for i in range(j + 1):
            value = 0.0
            for k in range(n):
                value += work.basis[i, k] * work.part[k]
            program.hessian[i, j] = value
            program.hessian[j, i] = value


@shared
def solve_by_levels(flat, levels, count, n, m, limit, memory, u, chosen):
    """Solve a program whose rows give way level by level; return the status.

    The bounds of the inputs hold always. Of the rows, first the squares of the violations of level 0 are minimised,
    then those of level 1 as far as level 0 loses nothing, and so on; what is left free minimises the objective.
    If a level cannot be solved, those after it go on from what it has reached, and the status is that of the first.
    """
    given, work = active_set.unpack_program(flat, n, m), levels_work(memory, n, m)
    rows, room = m + 2 * n, chosen.shape[0] - 2
    size = n * n + 3 * n + n * rows + 3 * rows
    for i in range(n):
        for k in range(n):
            work.basis[i, k] = 1.0 if i == k else 0.0
        work.base[i] = min(max(0.0, given.lower[i]), given.upper[i])
    for p in range(m):
        work.bounds[p], work.fixed[p] = given.bounds[p], 0.0
    d, answer = n, active_set.SOLVED
    for level in range(count):
        program = active_set.unpack_program(work.rest[0:size], d, rows)
        solver = active_set.unpack_scratch(work.rest[size:], d, rows, room)
        largest = _set_rows(given, work, program, levels, level, n, m, d)
        if largest > 0.0:
            for p in range(m):
                if levels[p] == level:
                    program.softness[p] = _RIDGE * largest
            status = _least_squares(program, solver, chosen, d, rows, limit, u)
            if answer == active_set.SOLVED:
                answer = status
            _move(given, work, u, n, d)
        d = _keep_level(given, work, levels, level, n, m, d)
        if d == 0:
            break
    if d > 0:
        program = active_set.unpack_program(work.rest[0:size], d, rows)
        solver = active_set.unpack_scratch(work.rest[size:], d, rows, room)
        _set_rows(given, work, program, levels, count, n, m, d)
        _set_objective(given, work, program, n, d)
        if not active_set.invert_factor(program.hessian, solver.inverse, d):
            return active_set.INDEFINITE
        active_set.to_center(program, solver, d)
        chosen[0] = 0
        status = active_set.solve_centered(program, solver, chosen, d, rows, limit, u)
        if status == active_set.SOLVED:
            _move(given, work, u, n, d)
        elif answer == active_set.SOLVED:
            answer = status
    for k in range(n):
        u[k] = work.base[k]
    return answer


LEVELS = STATUS(READ, types.Array(types.intp, 1, "C", readonly=True), STATUS, STATUS, STATUS, STATUS, WRITE, WRITE,
                types.Array(types.intp, 1, "C"))  # fmt: skip


@kernel(LEVELS)
def solve_levels(flat, levels, count, n, m, limit, memory, u, chosen):
    """Do what `solve_by_levels` does."""
    return solve_by_levels(flat, levels, count, n, m, limit, memory, u, chosen)
