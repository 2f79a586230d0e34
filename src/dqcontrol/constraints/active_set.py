"""The solver of quadratic programs, compiled: a dual active set method that allocates nothing.

    min ½ uᵀHu + gᵀu,  rows u ≤ bounds (some of them =),  lower ≤ u ≤ upper

as Goldfarb and Idnani (1983) step: with H = LLᵀ, m_i = L⁻¹a_i and the set W of active constraints, the multipliers
solve G y = c, G = M_W M_Wᵀ, and u = u₀ − L⁻ᵀM_Wᵀy. M_W = N P, N unit lower triangular, the rows of P orthogonal with
squares D, hence G = N D Nᵀ. DAQP (Arnström, Bemporad, Axehill 2022) makes such factors of G, where the sine between two
rows is squared and lost below 1e-8; P grows by Gram–Schmidt steps, repeated where they cancel, and shrinks by rotations
without roots. Multipliers are never negative and the dual objective only grows, so that no set returns.

By hand, although there are libraries: compiled steps call it, without Python and without allocation, and programs of a
robot's loop take 0.52 of DAQP's own time cold, 0.26 from their own active sets (``benchmarks/quadratic_programs.py``).

A *soft* row may give way: it costs ½ s²/softness, as if it had an input s of its own. Its m has a coordinate more, the
root of the softness; then even more rows than inputs are independent, and the violation is s = softness · y.

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
TOLERANCE = 1e-12  # violation, relative to 1 + |bound|, above which a constraint becomes active
_CONSISTENT = 1e-9  # violation of a row that depends on active ones, above which it contradicts them
_DEPENDENT = 1e-10  # sine between a constraint and the active ones
_CANCELLED = 0.01  # of a square, what is left of it, below which a Gram–Schmidt step is repeated
_REFINED = 1e-12  # residual of an active constraint, relative to what it sums, above which it is corrected
_EQUAL = 0.5  # flags are 0 or 1


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
    orthogonal
        P of the active constraints; its first `width` columns are in use.
    factor, pivots, reciprocals
        N (room × room), D and 1/D (room).
    right, forward
        c and N⁻¹c (room).
    trial
        Multipliers of the present set, before their signs are looked at (room).
    own
        Column of P in which an active soft row gives way, 0 of one that does not (room).
    carried
        A row that leaves P; what a new one has of each row of P.
    width
        n and the number of active soft rows.
    residual
        a_i u − b_i of the rows (m).
    row, shift
        One constraint a, L(u₀ − u) (n).
    """

    inverse: Annotated[Array, "n", "n"]
    center: Annotated[Array, "n"]
    orthogonal: Annotated[Array, "room", "n + room"]
    factor: Annotated[Array, "room", "room"]
    pivots: Annotated[Array, "room"]
    reciprocals: Annotated[Array, "room"]
    right: Annotated[Array, "room"]
    forward: Annotated[Array, "room"]
    multipliers: Annotated[Array, "room"]
    trial: Annotated[Array, "room"]
    own: Annotated[Array, "room"]
    carried: Annotated[Array, "n + room"]
    width: Annotated[Array, 1]
    residual: Annotated[Array, "m"]
    row: Annotated[Array, "n"]
    shift: Annotated[Array, "n"]


unpack_program: MemoryLayout[Program] = MemoryLayout(Program, "n", "m")
unpack_scratch: MemoryLayout[ProgramWork] = MemoryLayout(ProgramWork, "n", "m", "room")


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
def _load(program, memory, q, p, n, m):
    """Write m_p of constraint p as row q of P; return |m_p|² with its softness, and how much u₀ violates it."""
    image = memory.orthogonal[q]
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
            image[i] = value
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
        image[i] = value
        square += value * value
    return square, violation


@shared
def _orthogonalise(memory, q, violation, width):
    """Take from row q of P once more what it has of those before; return its square, and how far it is violated."""
    line, rest = memory.factor[q], memory.orthogonal[q]
    pivot = 0.0
    for _ in range(2):
        for j in range(q):
            value = 0.0
            for k in range(width):
                value += memory.orthogonal[j, k] * rest[k]
            memory.carried[j] = value * memory.reciprocals[j]
            line[j] += memory.carried[j]
        before, pivot = 0.0, 0.0
        for k in range(width):
            before += rest[k] * rest[k]
        for j in range(q):
            value = memory.carried[j]
            for k in range(width):
                rest[k] -= value * memory.orthogonal[j, k]
        for k in range(width):
            pivot += rest[k] * rest[k]
        if pivot > _CANCELLED * before:
            break
    forward = violation
    for j in range(q):
        forward -= line[j] * memory.forward[j]
    return pivot, forward


@_in_order
def _append(program, memory, chosen, q, p, n, m):
    """Add constraint p as the active one number q; return False if it depends on the others."""
    line, rest, width = memory.factor[q], memory.orthogonal[q], int(memory.width[0])
    square, violation = _load(program, memory, q, p, n, m)
    pivot, forward = square, violation
    for j in range(q):
        value = 0.0
        for k in range(n):
            value += memory.orthogonal[j, k] * rest[k]
        line[j] = value * memory.reciprocals[j]
        pivot -= value * line[j]
        forward -= line[j] * memory.forward[j]
    chosen[1 + q] = p
    soft = p < m and program.softness[p] > 0.0
    if q >= width and not soft:
        return False
    for k in range(n, width):
        rest[k] = 0.0
    for j in range(q):
        value, row = line[j], memory.orthogonal[j]
        for k in range(width):
            rest[k] -= value * row[k]
    memory.own[q] = 0.0
    if soft:
        for j in range(q):
            memory.orthogonal[j, width] = 0.0
        rest[width] = math.sqrt(program.softness[p])
        memory.own[q] = float(width)
        width += 1
    if not pivot > _CANCELLED * square:
        pivot, forward = _orthogonalise(memory, q, violation, width)
    if not pivot > _DEPENDENT * _DEPENDENT * square or square <= 1e-30:
        return False
    memory.right[q], memory.forward[q], memory.multipliers[q] = violation, forward, 0.0
    memory.width[0] = float(width)
    memory.pivots[q], memory.reciprocals[q] = pivot, 1.0 / pivot
    return True


@_in_order
def _remove(memory, chosen, q, out):
    """Take the active constraint number `out` of q away: rotate its row of P out of those after it."""
    width, own = int(memory.width[0]), int(memory.own[out])
    column, carried, alpha = memory.trial, memory.carried, memory.pivots[out]
    for k in range(width):
        carried[k] = memory.orthogonal[out, k]
    for i in range(out + 1, q):
        column[i - 1] = memory.factor[i, out]
        for k in range(out):
            memory.factor[i - 1, k] = memory.factor[i, k]
        for k in range(out + 1, i):
            memory.factor[i - 1, k - 1] = memory.factor[i, k]
        chosen[i], memory.own[i - 1] = chosen[1 + i], memory.own[i]
        memory.right[i - 1], memory.multipliers[i - 1] = memory.right[i], memory.multipliers[i]
    for k in range(out, q - 1):
        p, pivot = column[k], memory.pivots[k + 1]
        updated = pivot + alpha * p * p
        share, beta = pivot / updated, alpha * p / updated
        alpha *= share
        memory.pivots[k], memory.reciprocals[k] = updated, 1.0 / updated
        for i in range(width):
            below = memory.orthogonal[k + 1, i]
            memory.orthogonal[k, i] = below + p * carried[i]
            carried[i] = share * carried[i] - beta * below
        for i in range(k + 1, q - 1):
            value, below = column[i], memory.factor[i, k]
            memory.factor[i, k] = share * below + beta * value
            column[i] = value - p * below
    for i in range(out, q - 1):
        value = memory.right[i]
        for k in range(i):
            value -= memory.factor[i, k] * memory.forward[k]
        memory.forward[i] = value
    if own > 0:  # the last column takes its place
        width -= 1
        for j in range(q - 1):
            memory.orthogonal[j, own] = memory.orthogonal[j, width]
            if memory.own[j] == width:
                memory.own[j] = float(own)
        memory.width[0] = float(width)


@_in_order
def _back(memory, q, values):
    """Solve Nᵀv = v in place."""
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
def _move(memory, q, values, n, u):
    """Take L⁻ᵀPᵀD⁻¹v from u."""
    for i in range(n):
        memory.shift[i] = 0.0
    for j in range(q):
        value = values[j] * memory.reciprocals[j]
        for i in range(n):
            memory.shift[i] += value * memory.orthogonal[j, i]
    for k in range(n):
        value = memory.shift[k]
        for i in range(k + 1):
            u[i] -= memory.inverse[k, i] * value


@_in_order
def _follow(program, memory, q, n, m, u):
    """Write u of what is active, and the residuals of all rows."""
    for i in range(n):
        u[i] = memory.center[i]
    if q > 0:
        _move(memory, q, memory.forward, n, u)
    _fill_residuals(program, memory, u, n, m)


@_in_order
def _is_off(program, memory, chosen, q, u, n, m):
    """Write a u − b − s of active constraints as the trial; return whether one is off by more than rounding."""
    off = False
    for j in range(q):
        p = chosen[1 + j]
        if p < m:
            given = program.softness[p] * memory.multipliers[j]
            memory.trial[j] = memory.residual[p] - given
            if abs(memory.trial[j]) > _REFINED * abs(program.bounds[p]):
                size = abs(program.bounds[p]) + abs(given)
                for k in range(n):
                    size += abs(program.columns[k, p] * u[k])
                off = off or abs(memory.trial[j]) > _REFINED * size
        else:
            k = p - m if p < m + n else p - m - n
            given = program.upper[k] if p < m + n else program.lower[k]
            memory.trial[j] = u[k] - given if p < m + n else given - u[k]
            off = off or abs(memory.trial[j]) > _REFINED * (1.0 + abs(given))
    return off


@shared
def _refine(program, memory, chosen, q, u, n, m):
    """Correct what is active by how far it is off, which is the trial; twice at most."""
    for _ in range(2):
        for j in range(q):
            memory.right[j] += memory.trial[j]
            value = memory.trial[j]
            for k in range(j):
                value -= memory.factor[j, k] * memory.trial[k]
            memory.trial[j] = value
            memory.forward[j] += value
        _move(memory, q, memory.trial, n, u)
        for j in range(q):
            memory.trial[j] *= memory.reciprocals[j]
        _back(memory, q, memory.trial)
        for j in range(q):
            memory.multipliers[j] += memory.trial[j]
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
def _drop_negative(memory, chosen, fixed, q):
    """Take constraints away, the worst first, until no multiplier of the others is negative; return how many stay."""
    while True:
        _multipliers(memory, q)
        least, out = 0.0, -1
        for j in range(fixed, q):
            if memory.trial[j] < least:
                least, out = memory.trial[j], j
        if out < 0:
            break
        _remove(memory, chosen, q, out)
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
            if fixed < room and _append(program, memory, chosen, fixed, p, n, m):
                fixed += 1
            else:
                skipped = True
    q = fixed
    for j in range(before):
        p = int(memory.trial[j])
        equation = p < m and program.equal[p] > _EQUAL
        is_new = 0 <= p < m + 2 * n and not equation and not _is_active(chosen, q, p)
        if is_new and q < room and _append(program, memory, chosen, q, p, n, m):
            q += 1
    return fixed, _drop_negative(memory, chosen, fixed, q), skipped


@_in_order
def _row_residual(program, p, u, n):
    value = -program.bounds[p]
    for k in range(n):
        value += program.columns[k, p] * u[k]
    return value


@shared
def _sizes(program, p, n, m):
    """Return what a constraint's violation is compared with: 1 + |bound|, and with |a|₁ added."""
    if p >= m + n:
        size = 1.0 + abs(program.lower[p - m - n])
        return size, size + 1.0
    if p >= m:
        size = 1.0 + abs(program.upper[p - m])
        return size, size + 1.0
    size = 1.0 + abs(program.bounds[p])
    whole = size
    for k in range(n):
        whole += abs(program.columns[k, p])
    return size, whole


@shared
def _off(program, u, n, m):
    """Return how far the worst equation is off, relative to its size; those that depend on others count too."""
    worst = 0.0
    for p in range(m):
        if program.equal[p] > _EQUAL and program.softness[p] == 0.0:
            worst = max(worst, abs(_row_residual(program, p, u, n)) / _sizes(program, p, n, m)[1])
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
        if memory.trial[j] > 1e-12 * largest and memory.multipliers[j] < step * memory.trial[j]:
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
                _remove(memory, chosen, q, out)
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
            if q == room:  # more than can be independent
                status = INFEASIBLE
                break
            if _append(program, memory, chosen, q, p, n, m):
                memory.multipliers[q] = gathered
                q += 1
                break
            out, step = _make_way(memory, fixed, q)
            if out < 0:
                size, whole = _sizes(program, p, n, m)
                if worst > _CONSISTENT * whole:
                    status = INFEASIBLE
                else:  # as near to active ones as rounding lets it be: on without it
                    tolerance = max(tolerance, 1.01 * worst / size)
                break
            gathered += step
            _remove(memory, chosen, q, out)
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
    memory.width[0] = float(n)
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
    q = _drop_negative(memory, chosen, fixed, q)
    return _search(program, memory, chosen, fixed, q, False, n, m, limit, u)


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
