"""A law's command made to keep constraints, compiled: the command nearest to it that keeps all rows.

    min (u − u₀)ᵀ H (u − u₀),  H = Jᵀ W J + ρ² 1,   low ≤ u ≤ high,   ∇d·u ≥ −η (d − kept) − ∂d/∂t  for every row

u₀ is what the law asks; where it keeps everything it leaves bit for bit. J is that of the hand's [ω ; ṗ],
W = diag(l², l², l², 1, 1, 1): what is given up is given up in the motion of the hand. Further tasks add their own
JᵀJ, those before the law's by a weight that lets them give way last. The box of each joint always
holds a command from which it can still brake.

A row is a linear picture of a distance. Where it may be wrong by its curvature, what the command leads to is computed,
and where that is less than the row promised, the picture of there becomes a further row, until all rows hold at the
period's end. Between samples a distance that curves by κ at most sinks by κT²/8 at most below the line between its ends
(`kept` has that much more than was asked for). What gives way if nothing keeps everything: first the limits of
acceleration, by least squares; then the rows, level by level, the last first; never the box.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.compiled.compile import (
    INPUT,
    NOT_FINITE,
    OK,
    READ,
    READ2,
    STATUS,
    WRITE,
    WRITE2,
    inline,
    kernel,
    shared,
)
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix
from dqcontrol.laws.constrained.active_set import (
    INDEFINITE,
    SOLVED,
    invert_factor,
    solve_centered,
    unpack_program,
    unpack_scratch,
)
from dqcontrol.laws.constrained.constraint_layout import (
    APART,
    AT_MOST,
    INSIDE,
    MOST_CUTS,
    ROUNDS,
    SIGHT,
    head,
    memory_of,
    parameters_of,
    report_of,
    room_for_soft,
    row_of,
    work_of,
)
from dqcontrol.laws.constrained.constraint_rows import (
    curvature,
    dip_between,
    farther_than,
    look_ahead,
    place_bodies,
    place_frames,
    place_obstacles,
    value_of,
    write_line,
    write_screws,
    write_tree_screws,
)
from dqcontrol.laws.constrained.escape import go_to_posture, range_ends_pressed
from dqcontrol.laws.constrained.levels import solve_by_levels
from dqcontrol.limits.supervisor.braking import fastest_stoppable
from dqcontrol.references.sample import TIME
from dqcontrol.robots.driving import RIM_LEVER, advance
from dqcontrol.robots.kinematics_kernels import call_chain, hand_jacobian, split

_SMALL = 1e-11  # of a row, m/s: less is rounding
_SHORT = 1e-10  # m or rad: how much less than promised a distance may be after a period
_FAR_SHORT = 1e-7  # m or rad: the same of one that is looked at ahead
_ACCEPTED = 1e-9  # m or rad: more than that is scaled back
_GAVE_WAY = 1e-8  # m/s or rad/s
_ITERATIONS = 300
_SOFT = 1e-6  # softness of limits of acceleration, to be compared with inverses of H
_HALVINGS = 5
_HELD, _ASIDE = 0.4, 1.0  # s: how long a hand is held before it goes aside, and for how long it does
_POSTURE = 2.0  # s: for how long joints go to another posture at most
_STUCK, _ASKED = 0.1, 1e-3  # share of the speed that the law asks for; m/s, less is no wish
_TRIES = 8

# kinematics, chain, q, sample, its number, twist Jacobian, what further tasks add to H (m × m numbers, or none), state
# (its end is the memory), parameters, work, command
CONSTRAINT = STATUS(ADDRESS, READ2, INPUT, READ, types.intp, READ2, READ, WRITE, READ, WRITE, WRITE)


@shared
def _set_box(given, memory, work, q, period):
    """Write what each input may be: within limits of speed, able to brake before its end, and near its last value."""
    for j in range(work.low.shape[0]):
        angle, most, fastest = q[int(given.coordinate[j])], given.acceleration[j], given.velocity[j]
        up = min(fastest_stoppable(given.upper[j] - angle, most, period), fastest)
        down = -min(fastest_stoppable(angle - given.lower[j], most, period), fastest)
        work.rough_low[j], work.rough_high[j] = down, up
        last, change = memory.sent[j], most * period
        low, high = max(down, last - change), min(up, last + change)
        if low > high:  # it cannot brake in time: as hard as it may
            low = high = min(max(last, min(down, up)), max(down, up))
            low = high = min(max(low, last - change), last + change)
            work.rough_low[j], work.rough_high[j] = min(down, low), max(up, high)
        work.low[j], work.high[j] = low, high


@shared
def _fastest_change(levers, work):
    """Return how fast a row can change with inputs inside the box."""
    total = 0.0
    for j in range(levers.shape[0]):
        total += levers[j] * max(abs(work.low[j]), abs(work.high[j]))
    return total


@shared
def _add_row(work, count, capacity, bound, owner, required):
    """Make room for a row; return its place, that of the one that matters least if there is none, −1 if it does."""
    place = count
    if count >= capacity:
        place = 0
        for i in range(1, capacity):
            if work.bounds[i] > work.bounds[place]:
                place = i
        if work.bounds[place] <= bound:
            return -1
    work.bounds[place], work.owners[place], work.required[place] = bound, float(owner), required
    work.press[place] = 0.0
    return place


@shared
def _collect_at(given, work, screws, report, settings, g, count):
    """Find the distances that this period can matter to at a point of the way, as rows of the program."""
    capacity = int(settings.capacity) - MOST_CUTS
    meets, share = given.meets[g, 0], given.meets[g, 1]
    before = 0.0 if g == 0 else given.meets[g - 1, 0] + settings.period * given.meets[g - 1, 1]
    is_way = given.shares.shape[0] > 1
    for i in range(given.rows.shape[0]):
        row = row_of(given.rows[i])
        name = int(row.name)
        span = 1.0 / settings.rate + settings.late
        reach = row.kept + (_fastest_change(given.levers[i], work) + row.speed) * span
        if row.kind == APART and row.b >= given.bodies.shape[0]:
            drift = work.drift[int(row.b) - given.bodies.shape[0]]
            reach += math.sqrt(drift[0] ** 2 + drift[1] ** 2 + drift[2] ** 2) * span
        if row.kind == APART:
            apart = farther_than(work, row)
            if apart > reach and apart > report.least[name]:
                continue
        value = value_of(given, work, row)
        report.least[name] = min(report.least[name], value)
        if value > reach:
            continue
        drift = share * write_line(given, work, row, screws, work.line)
        give = max(settings.rate * (value - row.kept), -settings.recovery) - row.speed
        place = _add_row(work, count, capacity, give + drift, i, value - settings.period * give)
        if place >= 0:
            for j in range(work.line.shape[0]):
                work.lines[place, j] = given.shares[g, int(given.coordinate[j])] * work.line[j]
            work.value[place], work.points[place], work.alone[place] = value, float(g), drift
            work.nearest[i] = min(work.nearest[i], value - row.speed * meets)
            if is_way:
                passed = meets + settings.period * share - before
                work.dips[i] = max(work.dips[i], dip_between(given, work, i, screws, passed))
            count += 1 if place == count else 0
    return count


@shared
def _collect(kinematics, chain, given, memory, work, report, settings, time, sample):
    """Find the distances that this period can matter to, as rows of the program; return how many.

    At all points of the way the same is asked for: what the least of them may become.
    """
    count, last, period = 0, given.shares.shape[0] - 1, settings.period
    for i in range(given.rows.shape[0]):
        work.nearest[i], work.dips[i] = math.inf, 0.0
    for g in range(last + 1):
        if g < last:
            _place_on_way(given, memory, work, work.config, g)
        else:
            for i in range(work.config.shape[0]):
                work.trial[i] = work.config[i]
        if last > 0:
            _measure_step(given, memory, work, g, period)
            place_frames(chain, work.trial, given, work)
        place_bodies(given, work)
        place_obstacles(given, work, time, sample, given.meets[g, 0], period * given.meets[g, 1], period)
        if g < last:
            write_screws(kinematics, chain, work.trial, given, work)
            count = _collect_at(given, work, work.screws, report, settings, g, count)
        else:
            count = _collect_at(given, work, work.first_screws, report, settings, g, count)
    for i in range(count):
        owner, g = int(work.owners[i]), int(work.points[i])
        row = row_of(given.rows[owner])
        least = work.nearest[owner]
        give = max(settings.rate * (least - row.kept - work.dips[owner]), -settings.recovery)
        lead = work.value[i] - least - row.speed * given.meets[g, 0]
        give += lead / period - row.speed * given.meets[g, 1]
        work.bounds[i], work.required[i] = give + work.alone[i], work.value[i] - period * give
    return count


@inline
def _follow(given, memory, period):
    """Let the joints follow their target for a period, as far as that is known."""
    for i in range(memory.joint.shape[0]):
        left = 0.0
        if given.times[i] > 0.0:
            left = math.exp(-period / given.times[i])
        memory.joint[i] = memory.target[i] + (memory.joint[i] - memory.target[i]) * left


@inline
def _place_on_way(given, memory, work, target, g):
    """Write the configuration at a point of the way to a target."""
    for i in range(target.shape[0]):
        work.trial[i] = memory.joint[i] + given.shares[g, i] * (target[i] - memory.joint[i])


@shared
def _measure_step(given, memory, work, g, period):
    """Write how far inputs are from the last point of the way to this one, with any command of the box at most."""
    for j in range(work.step.shape[0]):
        i = int(given.coordinate[j])
        share = given.shares[g, i] - (0.0 if g == 0 else given.shares[g - 1, i])
        left = work.config[i] - memory.joint[i]
        most = abs(left) + period * max(abs(work.low[j]), abs(work.high[j]))
        work.step[j], work.reach[j], work.off[j] = share * left, share * most, given.bent[i] * most


@shared
def _line_change(work, i, u):
    """Return how row i changes with an input, m/s or rad/s."""
    change = 0.0
    for j in range(u.shape[0]):
        change += work.lines[i, j] * u[j]
    return change


@shared
def _keeps(given, work, count, u):
    """Return whether an input keeps box, rims and rows as they stand."""
    for j in range(u.shape[0]):
        if not work.low[j] <= u[j] <= work.high[j]:
            return False
    for i in range(count):
        if not _line_change(work, i, u) + work.bounds[i] >= -_SMALL * (1.0 + abs(work.bounds[i])):
            return False
    for k in range(given.drives.shape[0]):
        j = int(given.drives[k, 0]) - k
        if abs(u[j]) + given.drives[k, RIM_LEVER] * abs(u[j + 1]) > given.rims[k]:
            return False
    return True


@shared
def _place_after(kinematics, chain, given, memory, work, settings, u, time, sample, g, screws):
    """Place everything where a point of the way leads to that an input gives, with screws if asked for."""
    period = settings.period
    for i in range(work.trial.shape[0]):
        work.trial[i] = work.config[i]
    advance(given.drives, u, period, work.trial)
    if g < given.shares.shape[0] - 1:
        _place_on_way(given, memory, work, work.trial, g)
    place_frames(chain, work.trial, given, work)
    place_bodies(given, work)
    span = period * given.meets[g, 1]
    place_obstacles(given, work, time, sample, given.meets[g, 0] + span, span, period)
    if screws:
        write_screws(kinematics, chain, work.trial, given, work)


@shared
def _add_cut(given, work, settings, i, count, short, u):
    """Add the picture of row i at an input, whose line is written, where it is short by so much, m/s or rad/s."""
    if count >= int(settings.capacity):
        return count
    g = int(work.points[i])
    bound = -short
    for j in range(u.shape[0]):
        work.lines[count, j] = given.shares[g, int(given.coordinate[j])] * work.line[j]
        bound -= work.lines[count, j] * u[j]
    work.bounds[count], work.owners[count], work.points[count] = bound, work.owners[i], work.points[i]
    work.required[count], work.press[count] = work.required[i], 0.0
    return count + 1


@shared
def _verify(kinematics, chain, given, memory, work, settings, originals, count, u, time, sample, adds):
    """Compute what an input leads to; return the count with further rows, and the worst shortfalls, now and ahead.

    Distances from convex things whose line leaves more room than their curvature can take are sure, and not computed.
    """
    period, last = settings.period, given.shares.shape[0] - 1
    worst, worst_ahead = 0.0, 0.0
    for g in range(last + 1):
        placed = False
        for i in range(originals):
            if int(work.points[i]) != g:
                continue
            owner = int(work.owners[i])
            row = row_of(given.rows[owner])
            spare = _line_change(work, i, u) + work.bounds[i]
            if row.kind == APART and spare >= 0.5 * period * curvature(given.levers[owner], u):
                continue
            if not placed:
                placed = True
                _place_after(kinematics, chain, given, memory, work, settings, u, time, sample, g, adds)
            value = value_of(given, work, row)
            short = work.required[i] - value
            worst = max(worst, short)
            if adds and short > _SHORT:
                write_line(given, work, row, work.screws, work.line)
                count = _add_cut(given, work, settings, i, count, short / period, u)
            if g == last and (row.kind == INSIDE or row.kind == AT_MOST or row.kind == SIGHT):
                ahead = look_ahead(given, work, row, value, u, 1.0 / settings.rate - period, work.line)
                short = min(row.kept, work.required[i]) - ahead
                worst_ahead = max(worst_ahead, short)
                if adds and short > _FAR_SHORT:
                    count = _add_cut(given, work, settings, i, count, short * settings.rate, u)
    return count, worst, worst_ahead


@shared
def _fill_program(given, work, count, soft, m, drives):
    """Write rows (−∇d·u ≤ bound), limits of rims, and limits of acceleration as soft rows; return how many rows."""
    rows = count + 4 * drives + (2 * m if soft else 0)
    program = unpack_program(work.program, m, rows)
    for i in range(m):
        for j in range(m):
            program.hessian[i, j] = work.hessian[i, j]
        program.gradient[i] = 0.0
        program.lower[i] = work.rough_low[i] if soft else work.low[i]
        program.upper[i] = work.rough_high[i] if soft else work.high[i]
    for i in range(count):
        program.bounds[i], program.softness[i], program.equal[i] = work.bounds[i], 0.0, 0.0
        for j in range(m):
            program.columns[j, i] = -work.lines[i, j]
    place = count
    for k in range(drives):
        at = int(given.drives[k, 0]) - k
        for side in range(4):
            for j in range(m):
                program.columns[j, place] = 0.0
            program.columns[at, place] = 1.0 if side < 2 else -1.0
            program.columns[at + 1, place] = given.drives[k, RIM_LEVER] * (1.0 if side % 2 == 0 else -1.0)
            program.bounds[place], program.softness[place], program.equal[place] = given.rims[k], 0.0, 0.0
            place += 1
    if soft:
        for j in range(m):
            for side in range(2):
                for i in range(m):
                    program.columns[i, place] = 0.0
                program.columns[j, place] = 1.0 if side == 0 else -1.0
                program.bounds[place] = work.high[j] if side == 0 else -work.low[j]
                program.softness[place], program.equal[place] = _SOFT, 0.0
                place += 1
    return rows


@shared
def _solve(given, work, chosen, count, u, m, drives, soft):
    """Solve the program about the wish; return the status, and write how hard rows press."""
    rows = _fill_program(given, work, count, soft, m, drives)
    program = unpack_program(work.program, m, rows)
    room = room_for_soft(m)
    memory = unpack_scratch(work.solver, m, rows, room)
    if not invert_factor(program.hessian, memory.inverse, m):
        return INDEFINITE
    for j in range(m):
        memory.center[j] = work.wish[j]
    chosen[0] = 0
    status = solve_centered(program, memory, chosen[0 : room + 2], m, rows, _ITERATIONS, u)
    for i in range(count):
        work.press[i] = 0.0
    if status == SOLVED:
        for j in range(chosen[0]):
            if chosen[1 + j] < count:
                work.press[chosen[1 + j]] = memory.multipliers[j]
    return status


@shared
def _solve_levels(given, work, chosen, levels, count, u, m, drives):
    """Violate the rows least, level by level; limits of rims and the box hold."""
    rows = _fill_program(given, work, count, False, m, drives)
    program = unpack_program(work.program, m, rows)
    most = 0
    for i in range(rows):
        level = int(row_of(given.rows[int(work.owners[i])]).level) + 1 if i < count else 0
        levels[i] = level
        most = max(most, level)
    for i in range(m):
        program.gradient[i] = 0.0
        program.lower[i], program.upper[i] = work.rough_low[i], work.rough_high[i]
        for j in range(m):
            program.gradient[i] -= program.hessian[i, j] * work.wish[j]
    return solve_by_levels(
        work.program, levels[0:rows], most + 1, m, rows, _ITERATIONS, work.levels, u, chosen
    )


@shared
def _hand_speed(work, u, angular):
    """Return |[l ω ; v]| of the hand."""
    total = 0.0
    for k in range(6):
        value = 0.0
        for j in range(u.shape[0]):
            value += work.hand[k, j] * u[j]
        total += value * value * (angular if k < 3 else 1.0)
    return math.sqrt(total)


@shared
def _write_objective(work, settings, metric, m):
    for i in range(m):
        for j in range(i + 1):
            value = settings.free if i == j else 0.0
            if metric.shape[0] > 0:
                value += metric[m * i + j]
            for k in range(6):
                value += work.hand[k, i] * work.hand[k, j] * (settings.angular if k < 3 else 1.0)
            work.hessian[i, j] = value
            work.hessian[j, i] = value


@shared
def _clip(work, u, low, high):
    for j in range(u.shape[0]):
        u[j] = min(max(u[j], low[j]), high[j])


@shared
def _scale_back(kinematics, chain, given, memory, work, settings, count, u, worst, time, sample):
    """Halve an input that leaves a row short until it does not; return the share that is left, of the best one."""
    for j in range(u.shape[0]):
        work.best[j] = u[j]
    share, best_share = 1.0, 1.0
    for _ in range(_HALVINGS):
        share *= 0.5
        for j in range(u.shape[0]):
            u[j] *= 0.5
        _, short, _ = _verify(
            kinematics, chain, given, memory, work, settings, count, count, u, time, sample, False
        )
        if short < worst:
            worst, best_share = short, share
            for j in range(u.shape[0]):
                work.best[j] = u[j]
        if worst <= _ACCEPTED:
            break
    for j in range(u.shape[0]):
        u[j] = work.best[j]
    return best_share


@shared
def _constrain(
    kinematics, chain, given, memory, work, settings, metric, report, chosen, levels, count, u, time, sample
):
    """Replace a wish that does not keep everything by the nearest command that does."""
    m, drives, originals = u.shape[0], given.drives.shape[0], count
    soft, is_violated, worst = False, False, 0.0
    _write_objective(work, settings, metric, m)
    for i in range(ROUNDS):
        report.numbers[1] = i + 1.0
        status = _solve(given, work, chosen, count, u, m, drives, soft)
        if status != SOLVED and not soft:
            soft = True
            status = _solve(given, work, chosen, count, u, m, drives, soft)
        if status != SOLVED:
            _solve_levels(given, work, chosen, levels, count, u, m, drives)
            is_violated = True
        if soft or is_violated:
            _clip(work, u, work.rough_low, work.rough_high)
        else:
            _clip(work, u, work.low, work.high)
        if is_violated:
            break
        more, worst, _ = _verify(
            kinematics, chain, given, memory, work, settings, originals, count, u, time, sample, True
        )
        if more == count:
            break
        count = more
    if worst > _ACCEPTED and not is_violated:
        report.numbers[2] = _scale_back(
            kinematics, chain, given, memory, work, settings, originals, u, worst, time, sample
        )
    return count


@shared
def _go_to_posture(given, work, memory, settings, u):
    """Replace the wish by a motion of the joints to another posture, as fast as the hand may go."""
    is_near = go_to_posture(given, work.config, memory.escape[2] - 1.0, u)
    fast = _hand_speed(work, u, settings.angular)
    for j in range(u.shape[0]):
        if fast > settings.escape:
            u[j] *= settings.escape / fast
        work.wish[j] = u[j]
    if is_near:
        memory.escape[1] = 0.0


@shared
def _go_aside(given, work, memory, settings, metric, u):
    """Replace the wish while the hand goes aside: by the least motion that moves it so and turns it little."""
    m = u.shape[0]
    memory.escape[1] -= settings.period
    if memory.aside[0] == 0.0 and memory.aside[1] == 0.0 and memory.aside[2] == 0.0:
        _go_to_posture(given, work, memory, settings, u)
        return
    inverse = as_matrix(work.solver[0 : m * m], m, m)
    _write_objective(work, settings, metric, m)
    if not invert_factor(work.hessian, inverse, m):
        return
    for i in range(m):
        value = 0.0
        for k in range(i + 1):
            for axis in range(3):
                value += inverse[i, k] * work.hand[3 + axis, k] * settings.escape * memory.aside[axis]
        work.best[i] = value
    for k in range(m):
        value = 0.0
        for i in range(k, m):
            value += inverse[i, k] * work.best[i]
        u[k] = value
        work.wish[k] = value


@shared
def _watch_for_deadlock(given, work, memory, settings, report, u):
    """Let the hand go aside, next time another way, once it has been held: across where the law wants it to go.

    Where the end of a joint's range or its turning is what is held, the joints go to another posture.
    """
    asked, speed = report.numbers[4], report.numbers[5]
    is_held = report.numbers[0] > 0.0 and asked > _ASKED and speed < _STUCK * asked
    memory.escape[0] = memory.escape[0] + settings.period if is_held else 0.0
    if memory.escape[0] < _HELD + 1.5 * settings.period or memory.escape[2] >= _TRIES:
        return
    x, y, z = 0.0, 0.0, 0.0
    for j in range(work.wish.shape[0]):
        x += work.hand[3, j] * work.wish[j]
        y += work.hand[4, j] * work.wish[j]
        z += work.hand[5, j] * work.wish[j]
    size = math.sqrt(x * x + y * y + z * z)
    memory.escape[0] = 0.0
    memory.escape[2] += 1.0
    if range_ends_pressed(given, work, u) > 0 or size < 0.5 * asked:
        memory.escape[1] = _POSTURE
        memory.aside[0] = memory.aside[1] = memory.aside[2] = 0.0
        return
    x, y, z = x / size, y / size, z / size
    a, b, c = -x * z, -y * z, 1.0 - z * z  # up, as far as that is across
    if c < 0.1:
        a, b, c = 1.0 - x * x, -x * y, -x * z
    size = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / size, b / size, c / size
    way = int(memory.escape[2] - 1.0) % 4
    if way == 1 or way == 2:
        a, b, c = y * c - z * b, z * a - x * c, x * b - y * a
    sign = 1.0 if way < 2 else -1.0
    memory.aside[0], memory.aside[1], memory.aside[2] = sign * a, sign * b, sign * c
    memory.escape[1] = _ASIDE


@shared
def _report(given, memory, work, report, settings, originals, count, u):
    """Write which rows and ends of joints' ranges pressed, and which rows gave way."""
    for i in range(count):
        name = int(row_of(given.rows[int(work.owners[i])]).name)
        if work.press[i] > 0.0:
            report.numbers[0] += 1.0
            report.pressure[name] += work.press[i]
        if i < originals:
            slack = -_line_change(work, i, u) - work.bounds[i]
            if slack > _GAVE_WAY:
                report.slack[name] = max(report.slack[name], slack)
    report.numbers[0] += range_ends_pressed(given, work, u)
    for j in range(u.shape[0]):
        most = given.acceleration[j] * settings.period
        if most < math.inf:
            report.numbers[3] = max(report.numbers[3], abs(u[j] - memory.sent[j]) / most - 1.0)
    report.numbers[4] = _hand_speed(work, work.wish, settings.angular)
    report.numbers[5] = _hand_speed(work, u, settings.angular)


@inline
def _parts(parameters, scratch, settings, n, m):
    """Return what is given and the scratch by name."""
    shapes, obstacles, drives = int(settings.shapes), int(settings.obstacles), int(settings.drives)
    frames, screws = int(settings.frames), int(settings.screws)
    given = parameters_of(
        parameters,
        n,
        m,
        frames,
        screws,
        int(settings.tree),
        shapes,
        obstacles,
        int(settings.rows),
        drives,
        int(settings.points),
        int(settings.moving),
    )
    work = work_of(
        scratch,
        n,
        m,
        frames,
        screws,
        shapes,
        obstacles,
        int(settings.rows),
        int(settings.names),
        int(settings.capacity),
        int(settings.program),
        int(settings.solver),
        int(settings.levels),
        int(settings.sets),
    )
    return given, work


@kernel(CONSTRAINT)
def keep_constraints(kinematics, chain, q, sample, k, twist_jacobian, metric, state, parameters, scratch, u):
    """Replace a command by the nearest one that keeps the constraints; one that keeps them stays as it is."""
    n, m = q.shape[0], u.shape[0]
    settings = head(parameters)
    names, capacity, drives = int(settings.names), int(settings.capacity), int(settings.drives)
    given, work = _parts(parameters, scratch, settings, n, m)
    memory = memory_of(state[state.shape[0] - 7 - 2 * n - m :], n, m)
    report = report_of(work.report, names)
    check = 0.0
    for j in range(m):
        work.wish[j] = u[j]
        check += 0.0 * u[j]
    if check != 0.0:
        return NOT_FINITE
    for i in range(n):
        work.config[i] = q[i]
    for i in range(6):
        for j in range(m):
            work.jacobian[i, j] = twist_jacobian[i, j]
    branches = settings.tree != 0.0
    if settings.integrates != 0.0:
        if memory.started[0] == 0.0:
            for i in range(n):
                memory.target[i] = memory.joint[i] = q[i]
        else:
            advance(given.drives, memory.sent, settings.period, memory.target)
            _follow(given, memory, settings.period)
        for i in range(n):
            work.config[i] = memory.target[i]
    if settings.integrates != 0.0 or branches:
        status = call_chain(kinematics, chain, work.config, work.buffer)
        if status != OK:
            return status
        _, _, moved = split(work.buffer)
        for i in range(6):
            for j in range(m):
                work.jacobian[i, j] = moved[i, j]
    memory.started[0] = 1.0
    status = place_frames(chain, work.config, given, work)
    if status != OK:
        return status
    if branches:
        hand_jacobian(position(work.buffer[0:8]), work.jacobian, work.hand)
        write_tree_screws(work.config, given, work)
    else:
        hand_jacobian(position(work.frames[8 * n : 8 * n + 8]), work.jacobian, work.hand)
    for i in range(6):
        for j in range(work.screws.shape[1]):
            work.first_screws[i, j] = work.screws[i, j] if branches else work.jacobian[i, j]
    if memory.escape[1] > 0.0:
        _go_aside(given, work, memory, settings, metric, u)
    for i in range(names):
        report.least[i], report.pressure[i], report.slack[i] = math.inf, 0.0, 0.0
    for i in range(report.numbers.shape[0]):
        report.numbers[i] = 0.0
    report.numbers[2], report.numbers[3] = 1.0, -1.0
    _set_box(given, memory, work, work.config, settings.period)
    time = sample[TIME]
    originals = _collect(kinematics, chain, given, memory, work, report, settings, time, k)
    count, short, ahead = originals, math.inf, 0.0
    if _keeps(given, work, count, u):
        _, short, ahead = _verify(
            kinematics, chain, given, memory, work, settings, originals, count, u, time, k, False
        )
    if short > _ACCEPTED or ahead > _FAR_SHORT:
        sets = work.sets.view(np.intp)
        rows = capacity + 2 * m + 4 * drives
        count = _constrain(
            kinematics,
            chain,
            given,
            memory,
            work,
            settings,
            metric,
            report,
            sets[rows:],
            sets[0:rows],
            count,
            u,
            time,
            k,
        )
    _report(given, memory, work, report, settings, originals, count, u)
    if settings.escape > 0.0 and memory.escape[1] <= 0.0:
        _watch_for_deadlock(given, work, memory, settings, report, u)
    return OK


# chain, configurations, times, numbers of samples, parameters, work, out (a value of each row)
VALUES = STATUS(READ2, READ2, READ, READ, READ, WRITE, WRITE2)


@kernel(VALUES)
def constraint_values(chain, q, times, samples, parameters, scratch, out):
    """Write the distances and angles of all rows at configurations and times."""
    settings = head(parameters)
    n, m = q.shape[1], int(settings.inputs)
    given, work = _parts(parameters, scratch, settings, n, m)
    for i in range(q.shape[0]):
        status = place_frames(chain, q[i], given, work)
        if status != OK:
            return status
        place_bodies(given, work)
        place_obstacles(given, work, times[i], int(samples[i]), 0.0, settings.period, settings.period)
        for k in range(given.rows.shape[0]):
            out[i, k] = value_of(given, work, row_of(given.rows[k]))
    return OK
