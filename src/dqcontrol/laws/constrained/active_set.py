"""The solver of quadratic programs, compiled: a dual active set method that allocates nothing.

    min ½ uᵀHu + gᵀu,  rows u ≤ bounds (some of them =),  lower ≤ u ≤ upper

as Goldfarb and Idnani (1983) step and as DAQP (Arnström, Bemporad, Axehill 2022) keeps what is active: with H = LLᵀ,
m_i = L⁻¹a_i and the set W of active constraints, the multipliers solve G y = c, G = M_W M_Wᵀ, whose LDLᵀ factor grows
and shrinks by a line, and u = u₀ − L⁻ᵀM_Wᵀy. Multipliers are never negative and the dual objective only grows, so that
no set returns. A *soft* row may give way: it costs ½ s²/softness, which adds its softness to G's diagonal; G is then
regular even where more rows press than there are inputs, and the violation is s = softness · y.

Constraints have numbers: i < m the rows, m + k the upper, m + n + k the lower bound of u_k. A set is an array of
integers, its size first.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from numba import types

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ2, STATUS, WRITE, WRITE2, inline, kernel, shared
from dqcontrol.compiled.memory_layout import MemoryLayout

SOLVED, INFEASIBLE, LIMIT, INDEFINITE = range(4)
LARGEST = 30  # inputs
TOLERANCE = 1e-11  # violation, relative to 1 + |bound|, above which a constraint becomes active
_CONSISTENT = 1e-8  # violation of a row that depends on active ones, above which it contradicts them
_DEPENDENT = 1e-9  # square of the sine between a constraint and the active ones
_REFINED = 1e-12  # residual of an active constraint above which multipliers are computed again
_EQUAL = 0.5


class Program(NamedTuple):
    """A quadratic program: H (n × n), g (n), rows as columns (n × m), and a number of each kind a row or an input.

    Attributes
    ----------
    softness
        1/weight of each row; 0 for rows that do not give way.
    equal
        1 for rows that are equations, 0 for the others.
    """

    hessian: Annotated[Array, "n", "n"]
    gradient: Annotated[Array, "n"]
    columns: Annotated[Array, "n", "m"]
    bounds: Annotated[Array, "m"]
    softness: Annotated[Array, "m"]
    equal: Annotated[Array, "m"]
    lower: Annotated[Array, "n"]
    upper: Annotated[Array, "n"]


class ProgramWork(NamedTuple):
    """Work memory of the solver, for at most `room` active constraints.

    Attributes
    ----------
    inverse
        L⁻¹ (n × n).
    center
        u₀, the answer without constraints (n).
    active
        m_j of the active constraints (room × n).
    factor, pivots, reciprocals
        LDLᵀ of G: L (room × room), D and 1/D (room).
    right, forward
        c and L⁻¹c (room).
    trial
        Multipliers of the present set, before their signs are looked at (room).
    residual
        a_i u − b_i of the rows (m).
    row, image, shift
        One constraint a, its m, L(u₀ − u) (n).
    """

    inverse: Annotated[Array, "n", "n"]
    center: Annotated[Array, "n"]
    active: Annotated[Array, "room", "n"]
    factor: Annotated[Array, "room", "room"]
    pivots: Annotated[Array, "room"]
    reciprocals: Annotated[Array, "room"]
    right: Annotated[Array, "room"]
    forward: Annotated[Array, "room"]
    multipliers: Annotated[Array, "room"]
    trial: Annotated[Array, "room"]
    residual: Annotated[Array, "m"]
    row: Annotated[Array, "n"]
    image: Annotated[Array, "n"]
    shift: Annotated[Array, "n"]


unpack_program, unpack_scratch = MemoryLayout(Program, "n", "m"), MemoryLayout(ProgramWork, "n", "m", "room")


def program_size(n: int, m: int) -> int:
    """Return how many numbers a program of n inputs and m rows has."""
    return unpack_program.size(n, m)


def room_for(n: int, m: int, soft: bool) -> int:
    """Return how many constraints can be active: independent ones, and soft rows beyond these."""
    return n + m if soft else n + 1


def scratch_size(n: int, m: int, room: int) -> int:
    """Return how many numbers the solver's work memory has."""
    return unpack_scratch.size(n, m, room)


def _in_order(function, everywhere=True):
    """Mark a small function whose sums stay in order."""
    return inline(function, fastmath={"contract", "nsz"}, everywhere=everywhere)


def _in_order_once(function):
    """Mark a large function whose sums stay in order, which kernels have once."""
    return _in_order(function, everywhere=False)


@_in_order
def invert_factor(hessian, inverse, n):
    """Write L⁻¹ of H = LLᵀ; return False unless H is positive definite."""
    for j in range(n):
        for i in range(j, n):
            inverse[i, j] = hessian[i, j]
    for j in range(n):
        scale = abs(inverse[j, j])
        pivot = inverse[j, j]
        for k in range(j):
            pivot -= inverse[j, k] * inverse[j, k]
        if not pivot > 1e-15 * scale:
            return False
        pivot = 1.0 / math.sqrt(pivot)
        inverse[j, j] = pivot
        for i in range(j + 1, n):
            value = inverse[i, j]
            for k in range(j):
                value -= inverse[i, k] * inverse[j, k]
            inverse[i, j] = value * pivot
    for j in range(n):  # L⁻¹ in place of L, column by column; diagonals are reciprocal already
        for i in range(j + 1, n):
            value = inverse[i, j] * inverse[j, j]
            for k in range(j + 1, i):
                value += inverse[i, k] * inverse[k, j]
            inverse[i, j] = -value * inverse[i, i]
    return True


@_in_order
def to_center(program, memory, n):
    """Write u₀ = −L⁻ᵀL⁻¹g."""
    for i in range(n):
        value = 0.0
        for k in range(i + 1):
            value -= memory.inverse[i, k] * program.gradient[k]
        memory.shift[i] = value
        memory.center[i] = 0.0
    for k in range(n):
        value = memory.shift[k]
        for i in range(k + 1):
            memory.center[i] += memory.inverse[k, i] * value


@_in_order
def _load(program, memory, p, n, m):
    """Write m_p of constraint p; return |m_p|² with its softness, and how much u₀ violates it."""
    if p < m:
        violation = -program.bounds[p]
        for k in range(n):
            value = program.columns[k, p]
            memory.row[k] = value
            violation += value * memory.center[k]
        square = program.softness[p]
        for i in range(n):
            value = 0.0
            for k in range(i + 1):
                value += memory.inverse[i, k] * memory.row[k]
            memory.image[i] = value
            square += value * value
        return square, violation
    if p < m + n:
        k, sign = p - m, 1.0
        violation = memory.center[k] - program.upper[k]
    else:
        k, sign = p - m - n, -1.0
        violation = program.lower[k] - memory.center[k]
    square = 0.0
    for i in range(n):
        value = sign * memory.inverse[i, k] if i >= k else 0.0
        memory.image[i] = value
        square += value * value
    return square, violation


@_in_order
def _append(memory, chosen, q, p, square, violation, n):
    """Add constraint p, as loaded, as the active one number q; return False if it depends on the others."""
    line = memory.factor[q]
    for k in range(n):
        memory.active[q, k] = memory.image[k]
    pivot, forward = square, violation
    for j in range(q):
        value = 0.0
        for k in range(n):
            value += memory.active[j, k] * memory.image[k]
        for k in range(j):
            value -= memory.factor[j, k] * line[k]
        line[j] = value
    for j in range(q):
        value = line[j]
        line[j] = value * memory.reciprocals[j]
        pivot -= value * line[j]
        forward -= line[j] * memory.forward[j]
    chosen[1 + q] = p
    memory.right[q] = violation
    memory.forward[q] = forward
    memory.multipliers[q] = 0.0
    if not pivot > _DEPENDENT * square or square <= 1e-30:
        return False
    memory.pivots[q], memory.reciprocals[q] = pivot, 1.0 / pivot
    return True


@_in_order
def _remove(memory, chosen, q, out, n):
    """Take the active constraint number `out` of q away: a rank-one update of what comes after it."""
    alpha = memory.pivots[out]
    column = memory.trial
    for i in range(out + 1, q):
        column[i] = memory.factor[i, out]
    for i in range(out + 1, q):
        for k in range(out):
            memory.factor[i - 1, k] = memory.factor[i, k]
        for k in range(out + 1, i):
            memory.factor[i - 1, k - 1] = memory.factor[i, k]
        for k in range(n):
            memory.active[i - 1, k] = memory.active[i, k]
        chosen[i] = chosen[1 + i]
        memory.right[i - 1] = memory.right[i]
        memory.multipliers[i - 1] = memory.multipliers[i]
        memory.pivots[i - 1] = memory.pivots[i]
        column[i - 1] = column[i]
    for k in range(out, q - 1):
        p = column[k]
        pivot = memory.pivots[k]
        updated = pivot + alpha * p * p
        beta = alpha * p / updated
        alpha *= pivot / updated
        memory.pivots[k], memory.reciprocals[k] = updated, 1.0 / updated
        for i in range(k + 1, q - 1):
            column[i] -= p * memory.factor[i, k]
            memory.factor[i, k] += beta * column[i]
    for i in range(out, q - 1):
        value = memory.right[i]
        for k in range(i):
            value -= memory.factor[i, k] * memory.forward[k]
        memory.forward[i] = value


@_in_order
def _back(memory, q, values):
    """Solve Lᵀv = v in place."""
    for i in range(q - 1, 0, -1):
        value = values[i]
        for k in range(i):
            values[k] -= memory.factor[i, k] * value


@_in_order
def _multipliers(memory, q):
    """Write what solves G y = c as the trial."""
    for j in range(q):
        memory.trial[j] = memory.forward[j] * memory.reciprocals[j]
    _back(memory, q, memory.trial)


@_in_order
def _fill_residuals(program, memory, u, n, m):
    """Write rows u − bounds."""
    for i in range(m):
        memory.residual[i] = -program.bounds[i]
    for k in range(n):
        value, column = u[k], program.columns[k]
        for i in range(m):
            memory.residual[i] += value * column[i]


@_in_order
def _follow(program, memory, q, n, m, u):
    """Write u of the multipliers, and the residuals of all rows."""
    if q == 0:
        for i in range(n):
            u[i] = memory.center[i]
    else:
        for i in range(n):
            memory.shift[i] = 0.0
        for j in range(q):
            value = memory.multipliers[j]
            for i in range(n):
                memory.shift[i] += value * memory.active[j, i]
        for i in range(n):
            u[i] = memory.center[i]
        for k in range(n):
            value = memory.shift[k]
            for i in range(k + 1):
                u[i] -= memory.inverse[k, i] * value
    _fill_residuals(program, memory, u, n, m)


@_in_order
def _own_residual(program, memory, chosen, j, u, n, m):
    """Return a u − b − s of an active constraint, which should be zero."""
    p = chosen[1 + j]
    if p < m:
        return memory.residual[p] - program.softness[p] * memory.multipliers[j]
    if p < m + n:
        return u[p - m] - program.upper[p - m]
    return program.lower[p - m - n] - u[p - m - n]


@_in_order
def _is_off(program, memory, chosen, q, u, n, m):
    """Write what active constraints are off as the trial; return whether one is more than rounding."""
    worst = 0.0
    for j in range(q):
        memory.trial[j] = _own_residual(program, memory, chosen, j, u, n, m)
        worst = max(worst, abs(memory.trial[j]))
    return worst > _REFINED


@shared
def _refine(program, memory, chosen, q, u, n, m):
    """Correct the multipliers by what active constraints are off, which is the trial; twice at most."""
    for _ in range(2):
        for i in range(q):
            value = memory.trial[i]
            for k in range(i):
                value -= memory.factor[i, k] * memory.trial[k]
            memory.trial[i] = value
        for j in range(q):
            memory.trial[j] *= memory.reciprocals[j]
        _back(memory, q, memory.trial)
        for i in range(n):
            memory.shift[i] = 0.0
        for j in range(q):
            memory.multipliers[j] += memory.trial[j]
            for i in range(n):
                memory.shift[i] += memory.trial[j] * memory.active[j, i]
        for k in range(n):  # by the correction alone: large multipliers would lose it in their rounding
            for i in range(k + 1):
                u[i] -= memory.inverse[k, i] * memory.shift[k]
        _fill_residuals(program, memory, u, n, m)
        if not _is_off(program, memory, chosen, q, u, n, m):
            return


@_in_order
def _most_violated(program, memory, chosen, q, u, n, m, tolerance):
    """Return the constraint that is violated most and beyond the tolerance, −1 if none is, and how much."""
    for j in range(q):
        if chosen[1 + j] < m:
            memory.residual[chosen[1 + j]] = -math.inf
    worst, found = 0.0, -1
    for i in range(m):
        if memory.residual[i] > worst:
            value = memory.residual[i]
            if value > tolerance * (1.0 + abs(program.bounds[i])):
                worst, found = value, i
    for k in range(n):
        value = u[k] - program.upper[k]
        if value > worst and value > tolerance * (1.0 + abs(program.upper[k])):
            worst, found = value, m + k
        value = program.lower[k] - u[k]
        if value > worst and value > tolerance * (1.0 + abs(program.lower[k])):
            worst, found = value, m + n + k
    return found, worst


@_in_order
def _is_active(chosen, q, p):
    found = False
    for j in range(q):
        found = found or chosen[1 + j] == p
    return found


@_in_order
def _drop_negative(memory, chosen, fixed, q, n):
    """Take constraints away, the worst first, until no multiplier of the others is negative; return how many stay."""
    while True:
        _multipliers(memory, q)
        least, out = 0.0, -1
        for j in range(fixed, q):
            if memory.trial[j] < least:
                least, out = memory.trial[j], j
        if out < 0:
            break
        _remove(memory, chosen, q, out, n)
        q -= 1
    for j in range(q):
        memory.multipliers[j] = memory.trial[j]
    return q


@_in_order
def _start(program, memory, chosen, n, m):
    """Make all equations active that are independent, then what was active before; return how many of each."""
    before, room = chosen[0], memory.pivots.shape[0]
    fixed, skipped = 0, False
    for j in range(before):  # out of the way: the set grows from its front
        memory.trial[j] = float(chosen[1 + j])
    for p in range(m):
        if program.equal[p] > _EQUAL:
            square, violation = _load(program, memory, p, n, m)
            if fixed < room and _append(memory, chosen, fixed, p, square, violation, n):
                fixed += 1
            else:
                skipped = True
    q = fixed
    for j in range(before):
        p = int(memory.trial[j])
        equation = p < m and program.equal[p] > _EQUAL
        if 0 <= p < m + 2 * n and not equation and q < room and not _is_active(chosen, q, p):
            square, violation = _load(program, memory, p, n, m)
            if _append(memory, chosen, q, p, square, violation, n):
                q += 1
    return fixed, _drop_negative(memory, chosen, fixed, q, n), skipped


@_in_order
def _row_residual(program, p, u, n):
    value = -program.bounds[p]
    for k in range(n):
        value += program.columns[k, p] * u[k]
    return value


@shared
def _size(program, p, n, m):
    """Return 1 + |bound| + |a|₁ of a constraint: what its violation is to be compared with."""
    if p >= m + n:
        return 2.0 + abs(program.lower[p - m - n])
    if p >= m:
        return 2.0 + abs(program.upper[p - m])
    size = 1.0 + abs(program.bounds[p])
    for k in range(n):
        size += abs(program.columns[k, p])
    return size


@shared
def _off(program, u, n, m):
    """Return how far the worst equation is off, relative to its size; those that depend on others count too."""
    worst = 0.0
    for p in range(m):
        if program.equal[p] > _EQUAL and program.softness[p] == 0.0:
            worst = max(worst, abs(_row_residual(program, p, u, n)) / _size(program, p, n, m))
    return worst


@shared
def _make_way(memory, fixed, q):
    """Return which active constraint has to go for one that depends on them, −1 if none can, and how far that leads.

    The multipliers move along the null vector of G, in which that of the new one grows, until one reaches zero.
    """
    for j in range(q):
        memory.trial[j] = memory.factor[q, j]
    _back(memory, q, memory.trial)
    largest = 0.0
    for j in range(q):
        largest = max(largest, abs(memory.trial[j]))
    step, out = math.inf, -1
    for j in range(fixed, q):
        if memory.trial[j] > 1e-10 * largest and memory.multipliers[j] < step * memory.trial[j]:
            step, out = memory.multipliers[j] / memory.trial[j], j
    if out >= 0:
        for j in range(q):
            memory.multipliers[j] -= step * memory.trial[j]
    return out, step


@_in_order_once
def _search(program, memory, chosen, fixed, q, skipped, n, m, limit, u):
    """Make what is violated active, one after the other, from q active constraints on; return the status."""
    room = memory.pivots.shape[0]
    status, fresh, tolerance = LIMIT, True, TOLERANCE
    for iteration in range(1, limit + 1):
        if iteration % (4 * n + 40) == 0:  # rounding may let a constraint come and go for ever
            tolerance = min(10.0 * tolerance, _CONSISTENT)
        if not fresh:
            _multipliers(memory, q)
            step, out = 1.0, -1
            for j in range(fixed, q):
                if memory.trial[j] < 0.0:
                    value = memory.multipliers[j]
                    if value < step * (value - memory.trial[j]):
                        step, out = value / (value - memory.trial[j]), j
            if out >= 0:
                for j in range(q):
                    memory.multipliers[j] += step * (memory.trial[j] - memory.multipliers[j])
                _remove(memory, chosen, q, out, n)
                q -= 1
                continue
            for j in range(q):
                memory.multipliers[j] = memory.trial[j]
        fresh = False
        _follow(program, memory, q, n, m, u)
        if _is_off(program, memory, chosen, q, u, n, m):
            _refine(program, memory, chosen, q, u, n, m)
        p, worst = _most_violated(program, memory, chosen, q, u, n, m, tolerance)
        if p < 0:
            status = SOLVED
            break
        gathered = 0.0
        while True:
            square, violation = _load(program, memory, p, n, m)
            if q == room:  # more than can be independent: rounding has let some through
                status = INFEASIBLE
                break
            if _append(memory, chosen, q, p, square, violation, n):
                memory.multipliers[q] = gathered
                q += 1
                break
            if worst <= _CONSISTENT * _size(program, p, n, m):
                status = SOLVED  # a copy of active ones, as near as rounding lets it be
                break
            out, step = _make_way(memory, fixed, q)
            if out < 0:
                status = INFEASIBLE
                break
            gathered += step
            _remove(memory, chosen, q, out, n)
            q -= 1
        if status != LIMIT:
            break
    if status == SOLVED and skipped and _off(program, u, n, m) > _CONSISTENT:
        status = INFEASIBLE
    chosen[0] = q
    return status


@_in_order_once
def solve_centered(program, memory, chosen, n, m, limit, u):
    """Solve with L⁻¹ and u₀ given, from the set given; return the status.

    At the limit of iterations, and where no answer exists, u violates constraints: the caller says what then. Where
    none exists, the set is that of a contradiction: its last, beyond its size, cannot be kept together with the others.
    """
    fixed, q, skipped = 0, 0, False
    equations = 0.0
    for p in range(m):
        equations += program.equal[p]
    if chosen[0] > 0 or equations > 0.0:
        fixed, q, skipped = _start(program, memory, chosen, n, m)
    return _search(program, memory, chosen, fixed, q, skipped, n, m, limit, u)


@_in_order_once
def solve_recentered(program, memory, chosen, n, m, limit, u):
    """Solve as `solve_centered` what was solved about another u₀: of what is active only the right side has changed."""
    fixed, q = 0, chosen[0]
    for j in range(q):
        p = chosen[1 + j]
        if p < m:
            value = -program.bounds[p]
            for k in range(n):
                value += program.columns[k, p] * memory.center[k]
            if program.equal[p] > _EQUAL:
                fixed += 1
        elif p < m + n:
            value = memory.center[p - m] - program.upper[p - m]
        else:
            value = program.lower[p - m - n] - memory.center[p - m - n]
        memory.right[j] = value
        for k in range(j):
            value -= memory.factor[j, k] * memory.forward[k]
        memory.forward[j] = value
    q = _drop_negative(memory, chosen, fixed, q, n)
    return _search(program, memory, chosen, fixed, q, False, n, m, limit, u)


@_in_order_once
def tighten(program, memory, chosen, softness, n, m, u):
    """Let rows of this softness, which made dependent ones solvable, no longer give way: what is active is kept."""
    for p in range(m):
        if program.softness[p] == softness:
            program.softness[p] = 0.0
    _fill_residuals(program, memory, u, n, m)
    if _is_off(program, memory, chosen, chosen[0], u, n, m):
        _refine(program, memory, chosen, chosen[0], u, n, m)


@_in_order
def solve(program, memory, chosen, n, m, limit, u):
    """Solve a program from the set given; return the status."""
    if not invert_factor(program.hessian, memory.inverse, n):
        return INDEFINITE
    to_center(program, memory, n)
    return solve_centered(program, memory, chosen, n, m, limit, u)


@kernel(STATUS(READ2, STATUS, STATUS, STATUS, WRITE2, types.Array(types.intp, 2, "C"), WRITE))
def solve_programs(programs, n, m, limit, answers, sets, scratch):
    """Solve one program after the other, each from its set: write u and the multipliers of all constraints.

    The status of each is the last number of its set.
    """
    room = sets.shape[1] - 2
    memory = unpack_scratch(scratch, n, m, room)
    for i in range(programs.shape[0]):
        program = unpack_program(programs[i], n, m)
        chosen, answer = sets[i], answers[i]
        status = solve(program, memory, chosen, n, m, limit, answer[:n])
        for k in range(n, n + m + 2 * n):
            answer[k] = 0.0
        if status != INDEFINITE:
            for j in range(chosen[0]):
                answer[n + chosen[1 + j]] = memory.multipliers[j]
        chosen[1 + room] = status
    return SOLVED
