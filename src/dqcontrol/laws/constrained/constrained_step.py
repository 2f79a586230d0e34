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
from dqcontrol.laws.constrained.levels import solve_by_levels
from dqcontrol.limits.supervisor.braking import fastest_stoppable
from dqcontrol.references.sample import TIME
from dqcontrol.robots.driving import RIM_LEVER, advance
from dqcontrol.robots.kinematics_kernels import call_chain, hand_jacobian, split

_SMALL = 1e-11  # of a row, m/s: less is rounding
_SHORT = 1e-10  # m or rad: how much less than promised a distance may be after a period
_FAR_SHORT = 1e-7  # m or rad: the same of one that is looked at ahead
_ROUNDER = 1.5  # the bend of a way is that times what three of its points say at most
_ACCEPTED = 1e-9  # m or rad: more than that is scaled back
_GAVE_WAY = 1e-8  # m/s or rad/s
_ITERATIONS = 300
_SOFT = 1e-6  # softness of limits of acceleration, to be compared with inverses of H
_HALVINGS = 5
_HELD, _ASIDE = 0.4, 1.0  # s: how long a hand is held before it goes aside, and for how long it does
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
def _collect(given, work, screws, report, settings, time, sample):
    """Find the distances that this period can matter to, as rows of the program; return how many."""
    count, capacity = 0, int(settings.capacity) - MOST_CUTS
    place_bodies(given, work)
    place_obstacles(given, work, time, sample)
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
        drift = write_line(given, work, row, screws, work.line)
        give = max(settings.rate * (value - row.kept), -settings.recovery) - row.speed
        place = _add_row(work, count, capacity, give + drift, i, value - settings.period * give)
        if place >= 0:
            for j in range(work.line.shape[0]):
                work.lines[place, j] = work.line[j]
            work.value[place] = value
            count += 1 if place == count else 0
    return count


@inline
def _follow(given, memory, period):
    """Let the joints follow their target for a period, as far as that is known."""
    for i in range(memory.joint.shape[0]):
        left = 0.0
        if given.times[i] > 0.0:
            left = math.exp(-period / given.times[i])
        memory.joint[i] = memory.target[i] + (memory.joint[i] - memory.target[i]) * left


@shared
def _keep_more(chain, given, memory, work, settings, count):
    """Let targets keep more than is asked by what it takes for joints that follow them to keep what is asked.

    Joints move towards their target. Where their distance d(q) is what is asked, and that of the target d(z) larger by
    m, it grows as it begins to if on the way it bends upwards by 2m at most, d(z) = d(q) + d' + ½ bend: the bend is
    that of a parabola through joints, half way, and target. And points of the way, which the target moves by a share
    of its own motion, come no nearer either. What moves by itself meets the joints later by lag and delay.
    """
    for part in range(4):  # at the joints, half way, a quarter, three quarters
        share = 0.0 if part == 0 else 0.5 if part == 1 else 0.25 if part == 2 else 0.75
        for i in range(work.trial.shape[0]):
            work.trial[i] = memory.joint[i] + share * (memory.target[i] - memory.joint[i])
        place_frames(chain, work.trial, given, work)
        place_bodies(given, work)
        for i in range(count):
            row = row_of(given.rows[int(work.owners[i])])
            found = value_of(given, work, row)
            room = work.value[i] - row.kept
            if part == 0:
                work.press[i] = found
                continue
            if part == 1:
                bend = 8.0 * (0.5 * (work.press[i] + work.value[i]) - found)
                work.press[i] = room - _ROUNDER * 0.5 * max(bend, 0.0)
            work.press[i] = min(work.press[i], (found - row.kept) / share)
            if part < 3:
                continue
            moving = row.speed
            if row.kind == APART and row.b >= given.bodies.shape[0]:
                drift = work.drift[int(row.b) - given.bodies.shape[0]]
                moving += math.sqrt(drift[0] ** 2 + drift[1] ** 2 + drift[2] ** 2)
            before = max(settings.rate * room, -settings.recovery)
            left = min(work.press[i], room) - moving * settings.late
            give = max(settings.rate * left, -settings.recovery)
            work.bounds[i] += give - before
            work.required[i] += settings.period * (before - give)
            work.press[i] = 0.0


@shared
def _move_on(given, work, u, period):
    """Write the configuration after a period."""
    for i in range(work.trial.shape[0]):
        work.trial[i] = work.config[i]
    advance(given.drives, u, period, work.trial)


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
def _verify(kinematics, chain, given, work, settings, originals, count, u, time, sample, adds):
    """Compute what an input leads to; return the count with further rows, and the worst shortfalls, now and ahead.

    Distances from convex things whose line leaves more room than their curvature can take are sure, and not computed.
    """
    period, m = settings.period, u.shape[0]
    worst, worst_ahead, placed = 0.0, 0.0, False
    _, _, screws = split(work.buffer)
    if given.tree.shape[0] > 0:
        screws = work.tree_screws
    for i in range(originals):
        owner = int(work.owners[i])
        row = row_of(given.rows[owner])
        spare = _line_change(work, i, u) + work.bounds[i]
        if row.kind == APART and spare >= 0.5 * period * curvature(given.levers[owner], u):
            continue
        if not placed:
            placed = True
            _move_on(given, work, u, period)
            place_frames(chain, work.trial, given, work)
            place_bodies(given, work)
            place_obstacles(given, work, time + period, sample + 1)
            if adds:
                write_screws(kinematics, chain, work.trial, given, work)
        value = value_of(given, work, row)
        short = work.required[i] - value
        worst = max(worst, short)
        if adds and short > _SHORT and count < int(settings.capacity):
            write_line(given, work, row, screws, work.line)
            bound = -short / period
            for j in range(m):
                work.lines[count, j] = work.line[j]
                bound -= work.line[j] * u[j]
            work.bounds[count], work.owners[count] = bound, float(owner)
            work.required[count], work.press[count] = work.required[i], 0.0
            count += 1
        if row.kind == INSIDE or row.kind == AT_MOST or row.kind == SIGHT:
            ahead = look_ahead(given, work, row, value, u, 1.0 / settings.rate - period, work.line)
            short = min(row.kept, work.required[i]) - ahead
            worst_ahead = max(worst_ahead, short)
            if adds and short > _FAR_SHORT and count < int(settings.capacity):
                bound = -short * settings.rate
                for j in range(m):
                    work.lines[count, j] = work.line[j]
                    bound -= work.line[j] * u[j]
                work.bounds[count], work.owners[count] = bound, float(owner)
                work.required[count], work.press[count] = work.required[i], 0.0
                count += 1
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
def _scale_back(kinematics, chain, given, work, settings, count, u, worst, time, sample):
    """Halve an input that leaves a row short until it does not; return the share that is left, of the best one."""
    for j in range(u.shape[0]):
        work.best[j] = u[j]
    share, best_share = 1.0, 1.0
    for _ in range(_HALVINGS):
        share *= 0.5
        for j in range(u.shape[0]):
            u[j] *= 0.5
        _, short, _ = _verify(kinematics, chain, given, work, settings, count, count, u, time, sample, False)
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
    kinematics, chain, given, work, settings, metric, report, chosen, levels, count, u, time, sample
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
            kinematics, chain, given, work, settings, originals, count, u, time, sample, True
        )
        if more == count:
            break
        count = more
    if worst > _ACCEPTED and not is_violated:
        report.numbers[2] = _scale_back(
            kinematics, chain, given, work, settings, originals, u, worst, time, sample
        )
    return count


@shared
def _go_aside(work, memory, settings, metric, u):
    """Replace the wish while the hand goes aside: by the least motion that moves it so and turns it little."""
    m = u.shape[0]
    memory.escape[1] -= settings.period
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
def _watch_for_deadlock(work, memory, settings, report):
    """Let the hand go aside, next time another way, once it has been held: across where the law wants it to go."""
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
    if size < 0.5 * asked:  # it is its turning that is held
        return
    x, y, z = x / size, y / size, z / size
    a, b, c = -x * z, -y * z, 1.0 - z * z  # up, as far as that is across
    if c < 0.1:
        a, b, c = 1.0 - x * x, -x * y, -x * z
    size = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / size, b / size, c / size
    way = int(memory.escape[2]) % 4
    if way == 1 or way == 2:
        a, b, c = y * c - z * b, z * a - x * c, x * b - y * a
    sign = 1.0 if way < 2 else -1.0
    memory.aside[0], memory.aside[1], memory.aside[2] = sign * a, sign * b, sign * c
    memory.escape[0], memory.escape[1] = 0.0, _ASIDE
    memory.escape[2] += 1.0


@shared
def _report(given, memory, work, report, settings, originals, count, u):
    """Write which rows pressed and gave way."""
    for i in range(count):
        name = int(row_of(given.rows[int(work.owners[i])]).name)
        if work.press[i] > 0.0:
            report.numbers[0] += 1.0
            report.pressure[name] += work.press[i]
        if i < originals:
            slack = -_line_change(work, i, u) - work.bounds[i]
            if slack > _GAVE_WAY:
                report.slack[name] = max(report.slack[name], slack)
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
    screws = work.jacobian
    if branches:
        hand_jacobian(position(work.buffer[0:8]), work.jacobian, work.hand)
        write_tree_screws(work.config, given, work)
        screws = work.first_screws
        for i in range(6):
            for j in range(screws.shape[1]):
                screws[i, j] = work.tree_screws[i, j]
    else:
        hand_jacobian(position(work.frames[8 * n : 8 * n + 8]), work.jacobian, work.hand)
    if memory.escape[1] > 0.0:
        _go_aside(work, memory, settings, metric, u)
    for i in range(names):
        report.least[i], report.pressure[i], report.slack[i] = math.inf, 0.0, 0.0
    for i in range(report.numbers.shape[0]):
        report.numbers[i] = 0.0
    report.numbers[2], report.numbers[3] = 1.0, -1.0
    _set_box(given, memory, work, work.config, settings.period)
    time = sample[TIME]
    originals = _collect(given, work, screws, report, settings, time, k)
    if settings.lags != 0.0:
        _keep_more(chain, given, memory, work, settings, originals)
    count, short, ahead = originals, math.inf, 0.0
    if _keeps(given, work, count, u):
        _, short, ahead = _verify(
            kinematics, chain, given, work, settings, originals, count, u, time, k, False
        )
    if short > _ACCEPTED or ahead > _FAR_SHORT:
        sets = work.sets.view(np.intp)
        rows = capacity + 2 * m + 4 * drives
        count = _constrain(
            kinematics,
            chain,
            given,
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
        _watch_for_deadlock(work, memory, settings, report)
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
        place_obstacles(given, work, times[i], int(samples[i]))
        for k in range(given.rows.shape[0]):
            out[i, k] = value_of(given, work, row_of(given.rows[k]))
    return OK
