"""A law's command made to keep constraints, compiled: the command nearest to it that keeps all rows.

    min (u − u₀)ᵀ H (u − u₀),  H = Jᵀ W J + ρ² 1,   low ≤ u ≤ high,   ∇d·u ≥ −η (d − kept) − ∂d/∂t  for every row

u₀ is what the law asks; where it keeps everything it leaves bit for bit. J is that of the hand's [ω ; ṗ],
W = diag(l², l², l², 1, 1, 1): what is given up is given up in the motion of the hand. Further tasks add their own
JᵀJ, those before the law's by a weight that lets them give way last. The box of each joint always
holds a command from which it can still brake.

A row is a linear picture of a distance. Where it may be wrong by its curvature, what the command leads to is computed,
and where that is less than the row promised, the picture of there becomes a further row, until all rows hold at the
period's end. Between samples a distance that curves by κ at most sinks by κT²/8 at most below the line between its ends
(`kept` has that much more than was asked for).

A row's bound does not know how far limits of acceleration let it slow down: where a distance curves by c, keeping η d
takes η v + c, which may be more. So the way on which all inputs brake to rest after the command is looked at, too:
`_verify_stop`. What gives way if nothing keeps everything: first the rate η, by least squares within the limits of
acceleration, as long as such a way to rest is clear; then these limits, by least squares; then the rows, level by
level, the last first; never the box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import (
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
from dqcontrol.compiled.intrinsics import CONSTRAINT, as_matrix
from dqcontrol.constraints import active_set, constraint_layout as layout
from dqcontrol.constraints.constraint_rows import (
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
from dqcontrol.constraints.levels import solve_by_levels
from dqcontrol.limits.rates import fastest_stoppable
from dqcontrol.references.sample import TIME
from dqcontrol.robots.kinematics.driving import RIM_LEVER, advance
from dqcontrol.robots.kinematics.kinematics_kernels import call_chain, hand_jacobian, split

# What has to hold now is asked for ten times as exactly as it is accepted, so that a round of added rows gets there.
# What lies ahead is looked at again in each period before it holds, and is the less exact the further it is.
_SMALL = 1e-11  # of a row, m/s: less is rounding
_SHORT = 1e-10  # m or rad: how much less than promised a distance may be after a period
_FAR_SHORT = 1e-7  # m or rad: the same of one that is looked at ahead
_STOP_SHORT = 1e-6  # m or rad: the same on the way to rest where that is not settled
_ACCEPTED = 1e-9  # m or rad: more than that is scaled back
_GAVE_WAY = 1e-8  # m/s or rad/s: in a period of 10 ms `_SHORT`
_ITERATIONS = 300  # of the active set, which ends by itself; against cycles by rounding
_SOFT = 1e-6  # softness of limits of acceleration, to be compared with inverses of H
_HALVINGS = 5  # to 3 % of the step
_STOP_POINTS = 3  # of the way to rest that are looked at
_ASKED_MORE = 4  # how often more is asked for
# s: how long a hand is held before it goes aside, and for how long it does
_HELD_TIME, _ASIDE_TIME = 0.4, 1.0
_POSTURE = 2.0  # s: for how long joints go to another posture at most
_STUCK, _ASKED = 0.1, 1e-3  # share of the speed that the law asks for; m/s, less is no wish
_TRIES = 8  # postures before it is a deadlock
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_MIDDLE = 0.7  # share of a range that postures are in
_RATE = 4.0  # 1/s, towards a posture
_NEAR = 0.1  # rad or m, of a posture
_AT_BOUND = 1e-6  # rad/s or m/s: of a solution, less is rounding


class _Step(NamedTuple):
    """What functions of one step are handed together; `placed`, `path`, `box` and `lines` are written."""

    kinematics: int
    chain: Array
    kept: layout.KeptRows
    way: layout.Way
    scene: layout.RobotScene
    placed: layout.Placed
    path: layout.Path
    box: layout.InputBox
    lines: layout.Lines
    acceleration: Array
    settings: layout.Head
    time: float
    sample: int


@shared
def _set_box(limits, coordinate, box, sent, q, period):
    """Write what each input may be: within limits of speed, able to brake before its end, and near its last value."""
    for j in range(box.low.shape[0]):
        angle, most, fastest = q[int(coordinate[j])], limits.acceleration[j], limits.velocity[j]
        up = min(fastest_stoppable(limits.upper[j] - angle, most, period), fastest)
        down = -min(fastest_stoppable(angle - limits.lower[j], most, period), fastest)
        box.rough_low[j], box.rough_high[j] = down, up
        last, change = sent[j], most * period
        low, high = max(down, last - change), min(up, last + change)
        if low > high:  # it cannot brake in time: as hard as it may
            low = high = min(max(last, min(down, up)), max(down, up))
            low = high = min(max(low, last - change), last + change)
            box.rough_low[j], box.rough_high[j] = min(down, low), max(up, high)
        box.low[j], box.high[j] = low, high


@shared
def _fastest_change(levers, box):
    """Return how fast a row can change with inputs inside the box."""
    total = 0.0
    for j in range(levers.shape[0]):
        total += levers[j] * max(abs(box.low[j]), abs(box.high[j]))
    return total


@shared
def _longest_stop(step):
    """Return how long an input of the box can take to rest, s: 0 without limits of acceleration, or before servos."""
    box, longest = step.box, 0.0
    if step.way.shares.shape[0] == 1:
        for j in range(box.low.shape[0]):
            if step.acceleration[j] < math.inf:
                longest = max(longest, max(abs(box.low[j]), abs(box.high[j])) / step.acceleration[j])
    return longest


@inline
def _speed_of_obstacle(scene, placed, row):
    """Return how fast the obstacle of a row moves, m/s."""
    if row.kind == layout.APART and row.b >= scene.bodies.shape[0]:
        drift = placed.drift[int(row.b) - scene.bodies.shape[0]]
        return math.sqrt(drift[0] ** 2 + drift[1] ** 2 + drift[2] ** 2)
    return 0.0


@shared
def _add_row(lines, count, capacity, bound, owner, required):
    """Make room for a row; return its place, that of the one that matters least if there is none, −1 if it does."""
    place = count
    if count >= capacity:
        place = 0
        for i in range(1, capacity):
            if lines.bounds[i] > lines.bounds[place]:
                place = i
        if lines.bounds[place] <= bound:
            return -1
    lines.bounds[place], lines.owners[place], lines.required[place] = bound, float(owner), required
    lines.press[place] = 0.0
    return place


@shared
def _collect_at(step, screws, report, g, count):
    """Find the distances that this period can matter to at a point of the way, as rows of the program."""
    kept, way, scene, placed, path = step.kept, step.way, step.scene, step.placed, step.path
    box, lines, settings = step.box, step.lines, step.settings
    capacity = settings.capacity - layout.MOST_CUTS
    meets, share = way.meets[g, 0], way.meets[g, 1]
    before = 0.0 if g == 0 else way.meets[g - 1, 0] + settings.period * way.meets[g - 1, 1]
    is_way, stop = way.shares.shape[0] > 1, _longest_stop(step)
    for i in range(kept.rows.shape[0]):
        row = layout.row_of(kept.rows[i])
        name = int(row.name)
        span = max(1.0 / settings.rate, stop) + settings.late
        reach = row.kept + (_fastest_change(kept.levers[i], box) + row.speed) * span
        reach += _speed_of_obstacle(scene, placed, row) * span
        if row.kind == layout.APART:
            apart = farther_than(placed, row)
            if apart > reach and apart > report.least[name]:
                continue
        value = value_of(scene, placed, row)
        report.least[name] = min(report.least[name], value)
        if value > reach:
            continue
        drift = share * write_line(scene, placed, row, screws, lines.line)
        give = max(settings.rate * (value - row.kept), -settings.recovery) - row.speed
        place = _add_row(lines, count, capacity, give + drift, i, value - settings.period * give)
        if place >= 0:
            for j in range(lines.line.shape[0]):
                lines.gradients[place, j] = way.shares[g, int(way.coordinate[j])] * lines.line[j]
            lines.value[place], lines.points[place], lines.alone[place] = value, float(g), drift
            lines.nearest[i] = min(lines.nearest[i], value - row.speed * meets)
            if is_way:
                passed = meets + settings.period * share - before
                lines.dips[i] = max(
                    lines.dips[i], dip_between(scene, placed, path, row, kept.levers[i], screws, passed)
                )
            count += 1 if place == count else 0
    return count


@shared
def _collect(step, report):
    """Find the distances that this period can matter to, as rows of the program; return how many.

    At all points of the way the same is asked for: what the least of them may become.
    """
    kept, way, scene, placed, path = step.kept, step.way, step.scene, step.placed, step.path
    lines, settings = step.lines, step.settings
    count, last, period = 0, way.shares.shape[0] - 1, settings.period
    for i in range(kept.rows.shape[0]):
        lines.nearest[i], lines.dips[i] = math.inf, 0.0
    for g in range(last + 1):
        if g < last:
            _place_on_way(way, path, path.start, g)
        else:
            for i in range(path.start.shape[0]):
                path.trial[i] = path.start[i]
        if last > 0:
            _measure_step(way, path, step.box, g, period)
            place_frames(step.chain, path.trial, scene, placed)
        place_bodies(scene, placed, step.time + way.meets[g, 0])
        span = period * way.meets[g, 1]
        place_obstacles(scene, placed, step.time, step.sample, way.meets[g, 0], span, period)
        screws = placed.first_screws
        if g < last:
            write_screws(step.kinematics, step.chain, path.trial, scene, placed)
            screws = placed.screws
        count = _collect_at(step, screws, report, g, count)
    for i in range(count):
        owner, g = int(lines.owners[i]), int(lines.points[i])
        row = layout.row_of(kept.rows[owner])
        least = lines.nearest[owner]
        give = max(settings.rate * (least - row.kept - lines.dips[owner]), -settings.recovery)
        lead = lines.value[i] - least - row.speed * way.meets[g, 0]
        give += lead / period - row.speed * way.meets[g, 1]
        lines.bounds[i], lines.required[i] = give + lines.alone[i], lines.value[i] - period * give
    return count


@inline
def _follow(times, memory, period):
    """Let the joints follow their target for a period, as far as that is known."""
    for i in range(memory.joint.shape[0]):
        left = 0.0
        if times[i] > 0.0:
            left = math.exp(-period / times[i])
        memory.joint[i] = memory.target[i] + (memory.joint[i] - memory.target[i]) * left


@inline
def _place_on_way(way, path, target, g):
    """Write the configuration at a point of the way to a target."""
    for i in range(target.shape[0]):
        path.trial[i] = path.joint[i] + way.shares[g, i] * (target[i] - path.joint[i])


@shared
def _measure_step(way, path, box, g, period):
    """Write how far inputs are from the last point of the way to this one, with any command of the box at most."""
    for j in range(path.step.shape[0]):
        i = int(way.coordinate[j])
        share = way.shares[g, i] - (0.0 if g == 0 else way.shares[g - 1, i])
        left = path.start[i] - path.joint[i]
        most = abs(left) + period * max(abs(box.low[j]), abs(box.high[j]))
        path.step[j], path.reach[j], path.off[j] = share * left, share * most, way.bent[i] * most


@shared
def _line_change(gradients, i, u):
    """Return how row i changes with an input, m/s or rad/s."""
    change = 0.0
    for j in range(u.shape[0]):
        change += gradients[i, j] * u[j]
    return change


@shared
def _keeps(kept, box, lines, count, u):
    """Return whether an input keeps box, rims and rows as they stand."""
    for j in range(u.shape[0]):
        if not box.low[j] <= u[j] <= box.high[j]:
            return False
    for i in range(count):
        if not _line_change(lines.gradients, i, u) + lines.bounds[i] >= -_SMALL * (
            1.0 + abs(lines.bounds[i])
        ):
            return False
    for k in range(kept.drives.shape[0]):
        j = int(kept.drives[k, 0]) - k
        if abs(u[j]) + kept.drives[k, RIM_LEVER] * abs(u[j + 1]) > kept.rims[k]:
            return False
    return True


@shared
def _place_after(step, u, g, screws):
    """Place everything where a point of the way leads to that an input gives, with screws if asked for."""
    way, scene, placed, path, period = step.way, step.scene, step.placed, step.path, step.settings.period
    for i in range(path.trial.shape[0]):
        path.trial[i] = path.start[i]
    advance(step.kept.drives, u, period, path.trial)
    if g < way.shares.shape[0] - 1:
        _place_on_way(way, path, path.trial, g)
    place_frames(step.chain, path.trial, scene, placed)
    span = period * way.meets[g, 1]
    place_bodies(scene, placed, step.time + way.meets[g, 0] + span)
    place_obstacles(scene, placed, step.time, step.sample, way.meets[g, 0] + span, span, period)
    if screws:
        write_screws(step.kinematics, step.chain, path.trial, scene, placed)


@shared
def _add_cut(way, lines, capacity, i, count, short, u):
    """Add the picture of row i at an input, whose line is written, where it is short by so much, m/s or rad/s."""
    if count >= capacity:
        return count
    g = int(lines.points[i])
    bound = -short
    for j in range(u.shape[0]):
        lines.gradients[count, j] = way.shares[g, int(way.coordinate[j])] * lines.line[j]
        bound -= lines.gradients[count, j] * u[j]
    lines.bounds[count], lines.owners[count], lines.points[count] = bound, lines.owners[i], lines.points[i]
    lines.required[count], lines.press[count] = lines.required[i], 0.0
    return count + 1


@shared
def _verify(step, originals, count, u, adds):
    """Compute what an input leads to; return the count with further rows, and the worst shortfalls, now and ahead.

    Distances from convex things whose line leaves more room than their curvature can take are sure, and not computed.
    """
    kept, way, scene, placed = step.kept, step.way, step.scene, step.placed
    lines, settings = step.lines, step.settings
    period, last, capacity = settings.period, way.shares.shape[0] - 1, settings.capacity
    worst, worst_ahead = 0.0, 0.0
    for g in range(last + 1):
        is_placed = False
        for i in range(originals):
            if int(lines.points[i]) != g:
                continue
            owner = int(lines.owners[i])
            row = layout.row_of(kept.rows[owner])
            spare = _line_change(lines.gradients, i, u) + lines.bounds[i]
            if row.kind == layout.APART and spare >= 0.5 * period * curvature(kept.levers[owner], u):
                continue
            if not is_placed:
                is_placed = True
                _place_after(step, u, g, adds)
            value = value_of(scene, placed, row)
            short = lines.required[i] - value
            worst = max(worst, short)
            if adds and short > _SHORT:
                write_line(scene, placed, row, placed.screws, lines.line)
                count = _add_cut(way, lines, capacity, i, count, short / period, u)
            if g == last and (
                row.kind == layout.INSIDE or row.kind == layout.AT_MOST or row.kind == layout.SIGHT
            ):
                ahead = look_ahead(scene, placed, row, value, u, 1.0 / settings.rate - period, lines.line)
                short = min(row.kept, lines.required[i]) - ahead
                worst_ahead = max(worst_ahead, short)
                if adds and short > _FAR_SHORT:
                    count = _add_cut(way, lines, capacity, i, count, short * settings.rate, u)
    return count, worst, worst_ahead


@inline
def _steps_to_rest(acceleration, period, speed):
    """Return how many periods after this one an input still moves that brakes as hard as it may."""
    return math.floor(abs(speed) / (acceleration * period))


@shared
def _brake_for(step, u, steps):
    """Write how far inputs lead that leave once and then brake for so many periods as hard as they may."""
    period, moved = step.settings.period, step.path.step
    for j in range(u.shape[0]):
        count = min(steps, _steps_to_rest(step.acceleration[j], period, u[j]))
        lost = 0.0 if count == 0.0 else 0.5 * step.acceleration[j] * period * count * (count + 1.0)
        moved[j] = math.copysign(period * ((count + 1.0) * abs(u[j]) - lost), u[j])


@shared
def _write_stop_line(step, u, steps, line):
    """Turn a picture of a distance into how it changes with an input that is braked for so many periods.

    Return by how much that was made smaller, s: a period more of an input counts as often as it still moves.
    """
    period, most = step.settings.period, 1.0 + steps
    for j in range(u.shape[0]):
        line[j] *= (1.0 + min(steps, _steps_to_rest(step.acceleration[j], period, u[j]))) / most
    return period * most


@shared
def _verify_stop(step, originals, count, u, adds):
    """Compute where an input leads if all brake after it as hard as they may; return further rows, and the shortfall.

    An input loses aT a period: after u > 0 it makes T Σ max(u − i aT, 0) in k further periods, i = 0 … k. Where all
    distances are kept on this way to rest, the first period of it is a command for the next sample, within limits of
    joints and accelerations, and the rest of the way is its own way to rest: there always is a command that keeps
    everything, however late the rows that slow a motion down came. As many points of the way as `_STOP_POINTS` are
    looked at, the last one where all rest; obstacles are then where their motion leads to.
    """
    kept, scene, placed, path = step.kept, step.scene, step.placed, step.path
    lines, settings = step.lines, step.settings
    period, capacity, worst, longest = settings.period, settings.capacity, 0.0, 0.0
    if step.way.shares.shape[0] > 1:
        return count, worst
    for j in range(u.shape[0]):
        longest = max(longest, _steps_to_rest(step.acceleration[j], period, u[j]))
    if longest == 0.0:
        return count, worst
    last_point = -1.0
    for k in range(_STOP_POINTS):
        steps = math.ceil(longest * (k + 1.0) / _STOP_POINTS)
        if steps == last_point:
            continue
        last_point = steps
        span, is_placed = period * (steps + 1.0), False
        _brake_for(step, u, steps)
        for i in range(originals):
            owner = int(lines.owners[i])
            row = layout.row_of(kept.rows[owner])
            value, unforeseen = lines.value[i], row.speed * span
            nearest = value - span * _speed_of_obstacle(scene, placed, row)
            for j in range(u.shape[0]):
                nearest -= kept.levers[owner, j] * abs(path.step[j])
            needed = min(row.kept + unforeseen, value)
            if nearest >= needed:
                continue
            if not is_placed:
                is_placed = True
                for j in range(path.trial.shape[0]):
                    path.trial[j] = path.start[j]
                advance(kept.drives, path.step, 1.0, path.trial)
                place_frames(step.chain, path.trial, scene, placed)
                place_bodies(scene, placed, step.time + span)
                place_obstacles(scene, placed, step.time, step.sample, span, period, period)
                if adds:
                    write_screws(step.kinematics, step.chain, path.trial, scene, placed)
            short = needed - value_of(scene, placed, row)
            worst = max(worst, short)
            if adds and short > _FAR_SHORT:
                write_line(scene, placed, row, placed.screws, lines.line)
                scale = _write_stop_line(step, u, steps, lines.line)
                count = _add_cut(step.way, lines, capacity, i, count, short / scale, u)
    return count, worst


@shared
def _fill_program(kept, box, lines, objective, memory, count, soft, m):
    """Write rows (−∇d·u ≤ bound), limits of rims, and limits of acceleration as soft rows; return how many rows."""
    drives = kept.drives.shape[0]
    rows = count + 4 * drives + (2 * m if soft else 0)
    program = active_set.unpack_program(memory, m, rows)
    for i in range(m):
        for j in range(m):
            program.hessian[i, j] = objective.hessian[i, j]
        program.gradient[i] = 0.0
        program.lower[i] = box.rough_low[i] if soft else box.low[i]
        program.upper[i] = box.rough_high[i] if soft else box.high[i]
    for i in range(count):
        program.bounds[i], program.softness[i], program.equal[i] = lines.bounds[i], 0.0, 0.0
        for j in range(m):
            program.columns[j, i] = -lines.gradients[i, j]
    place = count
    for k in range(drives):
        at = int(kept.drives[k, 0]) - k
        for side in range(4):
            for j in range(m):
                program.columns[j, place] = 0.0
            program.columns[at, place] = 1.0 if side < 2 else -1.0
            program.columns[at + 1, place] = kept.drives[k, RIM_LEVER] * (1.0 if side % 2 == 0 else -1.0)
            program.bounds[place], program.softness[place], program.equal[place] = kept.rims[k], 0.0, 0.0
            place += 1
    if soft:
        for j in range(m):
            for side in range(2):
                for i in range(m):
                    program.columns[i, place] = 0.0
                program.columns[j, place] = 1.0 if side == 0 else -1.0
                program.bounds[place] = box.high[j] if side == 0 else -box.low[j]
                program.softness[place], program.equal[place] = _SOFT, 0.0
                place += 1
    return rows


@shared
def _solve(kept, box, lines, objective, work, chosen, count, u, soft):
    """Solve the program about the wish; return the status, and write how hard rows press."""
    m = u.shape[0]
    rows = _fill_program(kept, box, lines, objective, work.program, count, soft, m)
    program = active_set.unpack_program(work.program, m, rows)
    room = layout.room_for_soft(m)
    memory = active_set.unpack_scratch(work.solver, m, rows, room)
    if not active_set.invert_factor(program.hessian, memory.inverse, m):
        return active_set.INDEFINITE
    for j in range(m):
        memory.center[j] = objective.wish[j]
    chosen[0] = 0
    status = active_set.solve_centered(program, memory, chosen[0 : room + 2], m, rows, _ITERATIONS, u)
    for i in range(count):
        lines.press[i] = 0.0
    if status == active_set.SOLVED:
        for j in range(chosen[0]):
            if chosen[1 + j] < count:
                lines.press[chosen[1 + j]] = memory.multipliers[j]
    return status


@shared
def _solve_levels(kept, box, low, high, lines, objective, work, chosen, levels, count, u):
    """Violate the rows least, level by level; limits of rims and a box hold."""
    m = u.shape[0]
    rows = _fill_program(kept, box, lines, objective, work.program, count, False, m)
    program = active_set.unpack_program(work.program, m, rows)
    most = 0
    for i in range(rows):
        level = int(layout.row_of(kept.rows[int(lines.owners[i])]).level) + 1 if i < count else 0
        levels[i] = level
        most = max(most, level)
    for i in range(m):
        program.gradient[i] = 0.0
        program.lower[i], program.upper[i] = low[i], high[i]
        for j in range(m):
            program.gradient[i] -= program.hessian[i, j] * objective.wish[j]
    return solve_by_levels(
        work.program, levels[0:rows], most + 1, m, rows, _ITERATIONS, work.levels, u, chosen
    )


@shared
def _hand_speed(hand, u, angular):
    """Return |[l ω ; v]| of the hand."""
    total = 0.0
    for k in range(6):
        value = 0.0
        for j in range(u.shape[0]):
            value += hand[k, j] * u[j]
        total += value * value * (angular if k < 3 else 1.0)
    return math.sqrt(total)


@shared
def _write_objective(objective, settings, metric, m):
    for i in range(m):
        for j in range(i + 1):
            value = settings.free if i == j else 0.0
            if metric.shape[0] > 0:
                value += metric[m * i + j]
            for k in range(6):
                value += objective.hand[k, i] * objective.hand[k, j] * (settings.angular if k < 3 else 1.0)
            objective.hessian[i, j] = value
            objective.hessian[j, i] = value


@shared
def _clip(u, low, high):
    for j in range(u.shape[0]):
        u[j] = min(max(u[j], low[j]), high[j])


@shared
def _scale_back(step, best, count, u, worst):
    """Halve an input that leaves a row short until it does not; return the share that is left, of the best one."""
    for j in range(u.shape[0]):
        best[j] = u[j]
    share, best_share = 1.0, 1.0
    for _ in range(_HALVINGS):
        share *= 0.5
        for j in range(u.shape[0]):
            u[j] *= 0.5
        _, short, _ = _verify(step, count, count, u, False)
        if short < worst:
            worst, best_share = short, share
            for j in range(u.shape[0]):
                best[j] = u[j]
        if worst <= _ACCEPTED:
            break
    for j in range(u.shape[0]):
        u[j] = best[j]
    return best_share


@shared
def _keep_more(step, objective, work, chosen, originals, count, u, worst):
    """Ask for more by as much as an input leaves rows short, until none is; return the worst shortfall that is left.

    Where a wish far beyond what a curved distance allows presses, pictures of it settle slowly: with each the command
    slides along it to where the others are least true.
    """
    box, lines, added = step.box, step.lines, 0.0
    for j in range(u.shape[0]):
        objective.best[j] = u[j]
    short = worst
    for _ in range(_ASKED_MORE):
        more = 1.1 * short / step.settings.period
        added += more
        for i in range(count):
            lines.bounds[i] -= more
        if _solve(step.kept, box, lines, objective, work, chosen, count, u, False) != active_set.SOLVED:
            break
        _clip(u, box.low, box.high)
        _, short, _ = _verify(step, originals, count, u, False)
        if short < worst:
            worst = short
            for j in range(u.shape[0]):
                objective.best[j] = u[j]
        if worst <= _ACCEPTED:
            break
    for i in range(count):
        lines.bounds[i] += added
    for j in range(u.shape[0]):
        u[j] = objective.best[j]
    return worst


@shared
def _let_shrink(step, originals, share):
    """Let distances come by so much of their room nearer in this period than before."""
    lines = step.lines
    for i in range(originals):
        room = lines.value[i] - layout.row_of(step.kept.rows[int(lines.owners[i])]).kept
        lines.required[i] -= share * max(room, 0.0)


@shared
def _stay_stoppable(step, objective, sent, originals, u):
    """Take an input from which all can brake to rest and keep everything; return whether there is one.

    It is the given one or between that and braking as hard as possible, which is taken if it keeps everything in this
    period. How fast distances shrink does not matter here.
    """
    box, lines, period, best = step.box, step.lines, step.settings.period, objective.best
    share, brake = 1.0 - step.settings.rate * period, step.path.off
    for j in range(u.shape[0]):
        change = step.acceleration[j] * period
        left = math.copysign(max(abs(sent[j]) - change, 0.0), sent[j])
        brake[j], best[j] = min(max(left, box.low[j]), box.high[j]), u[j]
    _let_shrink(step, originals, share)
    is_kept = False
    for k in range(_HALVINGS + 1):
        if k == _HALVINGS:
            for j in range(u.shape[0]):
                u[j] = brake[j]
        _, short, _ = _verify(step, originals, originals, u, False)
        is_kept = short <= _ACCEPTED
        if is_kept and k < _HALVINGS:
            _, short = _verify_stop(step, originals, originals, u, False)
            is_kept = short <= _STOP_SHORT
        if is_kept:
            break
        for j in range(u.shape[0]):
            u[j] = 0.5 * (u[j] + brake[j])
    if not is_kept:
        _let_shrink(step, originals, -share)
        for j in range(u.shape[0]):
            u[j] = best[j]
        return False
    for i in range(originals):
        slack = -_line_change(lines.gradients, i, u) - lines.bounds[i]
        if slack > 0.0:
            lines.press[i] = slack
            lines.bounds[i] += slack
    return True


@shared
def _constrain(step, objective, work, metric, report, sent, count, u):
    """Replace a wish that does not keep everything by the nearest command that does."""
    kept, box, lines, settings = step.kept, step.box, step.lines, step.settings
    m, originals = u.shape[0], count
    sets, most_rows = work.sets.view(np.intp), settings.capacity + 2 * m + 4 * kept.drives.shape[0]
    levels, chosen = sets[0:most_rows], sets[most_rows:]
    soft, is_violated, worst, stop = False, False, 0.0, 0.0
    can_brake = _longest_stop(step) > 0.0
    _write_objective(objective, settings, metric, m)
    for i in range(layout.ROUNDS):
        report.numbers[1] = i + 1.0
        status = _solve(kept, box, lines, objective, work, chosen, count, u, soft)
        if status != active_set.SOLVED and not soft and can_brake:
            low, high = box.low, box.high
            _solve_levels(kept, box, low, high, lines, objective, work, chosen, levels, count, u)
            _clip(u, low, high)
            if _stay_stoppable(step, objective, sent, originals, u):
                return count
            count = originals
        if status != active_set.SOLVED and not soft:
            soft = True
            status = _solve(kept, box, lines, objective, work, chosen, count, u, soft)
        if status != active_set.SOLVED:
            low, high = box.rough_low, box.rough_high
            _solve_levels(kept, box, low, high, lines, objective, work, chosen, levels, count, u)
            is_violated = True
        if soft or is_violated:
            _clip(u, box.rough_low, box.rough_high)
        else:
            _clip(u, box.low, box.high)
        if is_violated:
            break
        more, worst, _ = _verify(step, originals, count, u, True)
        if not soft:
            more, stop = _verify_stop(step, originals, more, u, True)
        if more == count:
            break
        count = more
    if worst > _ACCEPTED and not soft and not is_violated:
        worst = _keep_more(step, objective, work, chosen, originals, count, u, worst)
    is_sure = soft or is_violated or (worst <= _ACCEPTED and stop <= _STOP_SHORT)
    if can_brake and not is_sure and _stay_stoppable(step, objective, sent, originals, u):
        return count
    if worst > _ACCEPTED and not is_violated:
        report.numbers[2] = _scale_back(step, objective.best, originals, u, worst)
    return count


@shared
def _range_ends_pressed(limits, box, wish, u):
    """Return how many joints a command would move beyond their range, or too fast to stop at its end."""
    count = 0
    for j in range(u.shape[0]):
        up, down = box.rough_high[j], box.rough_low[j]
        if up < limits.velocity[j] and u[j] > up - _AT_BOUND and wish[j] > up:
            count += 1
        if down > -limits.velocity[j] and u[j] < down + _AT_BOUND and wish[j] < down:
            count += 1
    return count


@inline
def _place_in_range(number, j):
    """Return where in its range joint j is in a posture, 0 to 1: the middle at first, then spread evenly."""
    shift = 0.5 + number * (j + 1.0) * _GOLDEN
    return 0.5 + _MIDDLE * (shift - math.floor(shift) - 0.5)


@shared
def _move_to_posture(limits, coordinate, config, number, u):
    """Write speeds towards a posture, the fastest joint at its limit of velocity; return whether it is near.

    Inputs without both limits rest. A hand that is held at the end of a joint's range, or in its turning, is not freed
    by moving it aside: another posture of the arm is, one a try, spread over the ranges.
    """
    farthest, share = 0.0, 1.0
    for j in range(u.shape[0]):
        u[j] = 0.0
        span = limits.upper[j] - limits.lower[j]
        if span < math.inf:
            place = limits.lower[j] + span * _place_in_range(number, j)
            away = place - config[int(coordinate[j])]
            farthest = max(farthest, abs(away))
            u[j] = _RATE * away
            if abs(u[j]) > limits.velocity[j]:
                share = min(share, limits.velocity[j] / abs(u[j]))
    for j in range(u.shape[0]):
        u[j] *= share
    return farthest < _NEAR


@shared
def _go_to_posture(limits, coordinate, start, objective, memory, settings, u):
    """Replace the wish by a motion of the joints to another posture, as fast as the hand may go."""
    is_near = _move_to_posture(limits, coordinate, start, memory.escape[2] - 1.0, u)
    fast = _hand_speed(objective.hand, u, settings.angular)
    for j in range(u.shape[0]):
        if fast > settings.escape:
            u[j] *= settings.escape / fast
        objective.wish[j] = u[j]
    if is_near:
        memory.escape[1] = 0.0


@shared
def _go_aside(limits, coordinate, start, objective, solver, memory, settings, metric, u):
    """Replace the wish while the hand goes aside: by the least motion that moves it so and turns it little."""
    m = u.shape[0]
    memory.escape[1] -= settings.period
    if memory.aside[0] == 0.0 and memory.aside[1] == 0.0 and memory.aside[2] == 0.0:
        _go_to_posture(limits, coordinate, start, objective, memory, settings, u)
        return
    inverse = as_matrix(solver[0 : m * m], m, m)
    _write_objective(objective, settings, metric, m)
    if not active_set.invert_factor(objective.hessian, inverse, m):
        return
    for i in range(m):
        value = 0.0
        for k in range(i + 1):
            for axis in range(3):
                value += inverse[i, k] * objective.hand[3 + axis, k] * settings.escape * memory.aside[axis]
        objective.best[i] = value
    for k in range(m):
        value = 0.0
        for i in range(k, m):
            value += inverse[i, k] * objective.best[i]
        u[k] = value
        objective.wish[k] = value


@shared
def _watch_for_deadlock(limits, box, objective, memory, settings, report, u):
    """Let the hand go aside, next time another way, once it has been held: across where the law wants it to go.

    Where the end of a joint's range or its turning is what is held, the joints go to another posture.
    """
    asked, speed = report.numbers[4], report.numbers[5]
    is_held = report.numbers[0] > 0.0 and asked > _ASKED and speed < _STUCK * asked
    memory.escape[0] = memory.escape[0] + settings.period if is_held else 0.0
    if memory.escape[0] < _HELD_TIME + 1.5 * settings.period or memory.escape[2] >= _TRIES:
        return
    x, y, z = 0.0, 0.0, 0.0
    for j in range(objective.wish.shape[0]):
        x += objective.hand[3, j] * objective.wish[j]
        y += objective.hand[4, j] * objective.wish[j]
        z += objective.hand[5, j] * objective.wish[j]
    size = math.sqrt(x * x + y * y + z * z)
    memory.escape[0] = 0.0
    memory.escape[2] += 1.0
    if _range_ends_pressed(limits, box, objective.wish, u) > 0 or size < 0.5 * asked:
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
    memory.escape[1] = _ASIDE_TIME


@shared
def _report(limits, box, rows, lines, objective, report, settings, sent, originals, count, u):
    """Write which rows and ends of joints' ranges pressed, and which rows gave way."""
    for i in range(count):
        name = int(layout.row_of(rows[int(lines.owners[i])]).name)
        if lines.press[i] > 0.0:
            report.numbers[0] += 1.0
            report.pressure[name] += lines.press[i]
        if i < originals:
            slack = -_line_change(lines.gradients, i, u) - lines.bounds[i]
            if slack > _GAVE_WAY:
                report.slack[name] = max(report.slack[name], slack)
    report.numbers[0] += _range_ends_pressed(limits, box, objective.wish, u)
    for j in range(u.shape[0]):
        most = limits.acceleration[j] * settings.period
        if most < math.inf:
            report.numbers[3] = max(report.numbers[3], abs(u[j] - sent[j]) / most - 1.0)
    report.numbers[4] = _hand_speed(objective.hand, objective.wish, settings.angular)
    report.numbers[5] = _hand_speed(objective.hand, u, settings.angular)


@kernel(CONSTRAINT)
def keep_constraints(kinematics, chain, q, sample, k, twist_jacobian, metric, state, parameters, scratch, u):
    """Replace a command by the nearest one that keeps the constraints; one that keeps them stays as it is."""
    n, m = q.shape[0], u.shape[0]
    settings = layout.head(parameters)
    given, work = layout.parameters_of(parameters, n, m, settings), layout.work_of(scratch, n, m, settings)
    limits, way = layout.limits_of(given.limits, m), layout.way_of(given.way, n, m, settings)
    kept, scene = layout.kept_of(given.kept, m, settings), layout.scene_of(given.scene, settings)
    box, placed = layout.box_of(work.box, m), layout.placed_of(work.placed, m, settings)
    path, lines = layout.path_of(work.path, n, m), layout.lines_of(work.lines, m, settings)
    objective, report = layout.objective_of(work.objective, m), layout.report_of(work.report, settings.names)
    memory = layout.memory_of(state[state.shape[0] - 7 - 2 * n - m :], n, m)
    check = 0.0
    for j in range(m):
        objective.wish[j] = u[j]
        check += 0.0 * u[j]
    if check != 0.0:
        return NOT_FINITE
    for i in range(n):
        path.start[i] = q[i]
    for i in range(6):
        for j in range(m):
            objective.jacobian[i, j] = twist_jacobian[i, j]
    branches = settings.tree != 0
    if settings.integrates != 0.0:
        if memory.started[0] == 0.0:
            for i in range(n):
                memory.target[i] = memory.joint[i] = q[i]
        else:
            advance(kept.drives, memory.sent, settings.period, memory.target)
            _follow(way.times, memory, settings.period)
        for i in range(n):
            path.start[i], path.joint[i] = memory.target[i], memory.joint[i]
    if settings.integrates != 0.0 or branches:
        status = call_chain(kinematics, chain, path.start, placed.buffer)
        if status != OK:
            return status
        _, _, moved = split(placed.buffer)
        for i in range(6):
            for j in range(m):
                objective.jacobian[i, j] = moved[i, j]
    memory.started[0] = 1.0
    status = place_frames(chain, path.start, scene, placed)
    if status != OK:
        return status
    if branches:
        hand_jacobian(position(placed.buffer[0:8]), objective.jacobian, objective.hand)
        write_tree_screws(path.start, scene, placed)
    else:
        hand_jacobian(position(placed.frames[8 * n : 8 * n + 8]), objective.jacobian, objective.hand)
    for i in range(6):
        for j in range(placed.screws.shape[1]):
            placed.first_screws[i, j] = placed.screws[i, j] if branches else objective.jacobian[i, j]
    if memory.escape[1] > 0.0:
        _go_aside(limits, way.coordinate, path.start, objective, work.solver, memory, settings, metric, u)
    for i in range(settings.names):
        report.least[i], report.pressure[i], report.slack[i] = math.inf, 0.0, 0.0
    for i in range(report.numbers.shape[0]):
        report.numbers[i] = 0.0
    report.numbers[2], report.numbers[3] = 1.0, -1.0
    _set_box(limits, way.coordinate, box, memory.sent, path.start, settings.period)
    most = limits.acceleration
    step = _Step(
        kinematics, chain, kept, way, scene, placed, path, box, lines, most, settings, sample[TIME], k
    )
    originals = _collect(step, report)
    count, short, ahead = originals, math.inf, 0.0
    if _keeps(kept, box, lines, count, u):
        _, short, ahead = _verify(step, originals, count, u, False)
        _, stop = _verify_stop(step, originals, count, u, False)
        ahead = max(ahead, stop)
    if short > _ACCEPTED or ahead > _FAR_SHORT:
        count = _constrain(step, objective, work, metric, report, memory.sent, count, u)
    _report(limits, box, kept.rows, lines, objective, report, settings, memory.sent, originals, count, u)
    if settings.escape > 0.0 and memory.escape[1] <= 0.0:
        _watch_for_deadlock(limits, box, objective, memory, settings, report, u)
    return OK


# chain, configurations, times, numbers of samples, parameters, work, out (a value of each row)
VALUES = STATUS(READ2, READ2, READ, READ, READ, WRITE, WRITE2)


@kernel(VALUES)
def constraint_values(chain, q, times, samples, parameters, scratch, out):
    """Write the distances and angles of all rows at configurations and times."""
    settings = layout.head(parameters)
    n, m = q.shape[1], settings.inputs
    given, work = layout.parameters_of(parameters, n, m, settings), layout.work_of(scratch, n, m, settings)
    kept, scene = layout.kept_of(given.kept, m, settings), layout.scene_of(given.scene, settings)
    placed = layout.placed_of(work.placed, m, settings)
    for i in range(q.shape[0]):
        status = place_frames(chain, q[i], scene, placed)
        if status != OK:
            return status
        place_bodies(scene, placed, times[i])
        place_obstacles(scene, placed, times[i], int(samples[i]), 0.0, settings.period, settings.period)
        for k in range(kept.rows.shape[0]):
            out[i, k] = value_of(scene, placed, layout.row_of(kept.rows[k]))
    return OK
