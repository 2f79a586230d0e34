"""Inverse kinematics, compiled: damped Newton steps inside the joint limits, from several starts.

The residual is what the end effector still has to turn (rotation vector, rad) and to move (m), inertial axes. A step
minimises
|e − J Δq|² + λ|Δq|²; joints that would leave their limits are set on them and the rest is solved again, so that every
iterate lies inside. [Levenberg 1944; Marquardt 1963; Sugihara 2011] `solve` is for the end effector of a chain; with
six rows a task, `solve_tasks` does the same for one or several tasks of a tree at once.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import half_turn, position, translation
from dqcontrol.algebra.symmetric import cholesky, cholesky_solve
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.kinematics import kinematics_kernels as chains
from dqcontrol.robots.kinematics.pose_task_kernels import task_twist_kinematics

# Iterations in a row that hardly reduce the error, after which a start is given up: of random starts of an iiwa 7 that
# lets 82 % succeed, 2 iterations 75 % (tests/robots/test_inverse_kinematics.py).
PATIENCE = 6
STALL_RATIO = 0.95  # of the squared residual: what reduces it by less hardly does
# Times the squared residual, so that the last steps are Newton's: near starts take 3.4 iterations, of 100 times that
# 4.5.
DAMPING = 0.15
LEAST_DAMPING = 1e-9  # relative to the trace of JJᵀ: 10⁷ times its rounding, so that the factors exist


def work_size(joints: int) -> int:
    """Return the length of the work array for an arm of so many joints."""
    return 16 * joints + 36 + 4 * 6 + 3 + 4


@inline
def _residual(chain, q, target, position, turns, moves, jacobian, out, turn):
    """Write the residual (6) and the Jacobian (n × 6, a row a joint) at q; return the residual's square."""
    n = chain.shape[0] - 1
    w, x, y, z, px, py, pz = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, chain[i])
        zx, zy, zz = chains.z_axis(w, x, y, z)
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = zx, zy, zz
        jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = px, py, pz
        sine, cosine = chains.half_sine_cosine(q[i])
        w, x, y, z, px, py, pz = chains.move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, chain[i, 7], q[i], sine, cosine
        )
    w, x, y, z, px, py, pz = chains.compose_fixed(w, x, y, z, px, py, pz, chain[n])
    for i in range(n):
        zx, zy, zz = jacobian[i, 0], jacobian[i, 1], jacobian[i, 2]
        if chain[i, 7] != chains.REVOLUTE:
            jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = 0.0, 0.0, 0.0
            jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = moves * zx, moves * zy, moves * zz
        else:
            ax, ay, az = px - jacobian[i, 3], py - jacobian[i, 4], pz - jacobian[i, 5]
            jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = turns * zx, turns * zy, turns * zz
            jacobian[i, 3] = moves * (zy * az - zz * ay)
            jacobian[i, 4] = moves * (zz * ax - zx * az)
            jacobian[i, 5] = moves * (zx * ay - zy * ax)
    half_turn((w, x, y, z), target, turn, out)
    out[0], out[1], out[2] = turns * 2.0 * out[0], turns * 2.0 * out[1], turns * 2.0 * out[2]
    out[3], out[4], out[5] = (
        moves * (position[0] - px),
        moves * (position[1] - py),
        moves * (position[2] - pz),
    )
    square = 0.0
    for k in range(6):
        square += out[k] * out[k]
    return square


@inline
def _factor(gram):
    """Factor the lower triangle of a 6 × 6 matrix in place, L with reciprocal pivots; return if it is positive."""
    for j in range(6):
        pivot = gram[j, j]
        for k in range(j):
            pivot -= gram[j, k] * gram[j, k]
        if not pivot > 0.0:
            return False
        pivot = 1.0 / math.sqrt(pivot)
        gram[j, j] = pivot
        for i in range(j + 1, 6):
            value = gram[i, j]
            for k in range(j):
                value -= gram[i, k] * gram[j, k]
            gram[i, j] = value * pivot
    return True


@inline
def _substitute(factor, y):
    """Solve LLᵀ y = y in place."""
    for i in range(6):
        value = y[i]
        for k in range(i):
            value -= factor[i, k] * y[k]
        y[i] = value * factor[i, i]
    for i in range(5, -1, -1):
        value = y[i]
        for k in range(i + 1, 6):
            value -= factor[k, i] * y[k]
        y[i] = value * factor[i, i]


@inline
def _step(jacobian, residual, q, limits, damping, gram, y, left, held, out):
    """Write the configuration after one damped step inside the limits; return whether it could be computed.

    Δq = Jᵀ(JJᵀ + λI)⁻¹(e − J_h Δq_h), J without the columns of the held joints h, which end on their limits.
    """
    n = q.shape[0]
    for i in range(n):
        held[i] = 0.0
    for k in range(6):
        left[k] = residual[k]
    for _ in range(n + 1):
        trace = 0.0
        for i in range(6):
            for j in range(i + 1):
                gram[i, j] = 0.0
        for m in range(n):
            if held[m] == 0.0:
                for i in range(6):
                    for j in range(i + 1):
                        gram[i, j] += jacobian[m, i] * jacobian[m, j]
        for i in range(6):
            trace += gram[i, i]
        extra = damping + LEAST_DAMPING * trace + 1e-300  # where all joints are held, the trace is 0
        for i in range(6):
            gram[i, i] += extra
            y[i] = left[i]
        if not _factor(gram):
            return False
        _substitute(gram, y)
        inside = True
        for m in range(n):
            if held[m] == 0.0:
                change = 0.0
                for k in range(6):
                    change += jacobian[m, k] * y[k]
                value = q[m] + change
                if value < limits[0, m] or value > limits[1, m]:
                    inside = False
                    value = limits[0, m] if value < limits[0, m] else limits[1, m]
                    held[m] = 1.0
                    change = value - q[m]
                    for k in range(6):
                        left[k] -= jacobian[m, k] * change
                out[m] = value
        if inside:
            return True
    return True


@inline
def _reached(residual, turns, moves, position_tolerance, orientation_tolerance):
    """Return whether the errors that count are within their tolerances."""
    turned = residual[0] * residual[0] + residual[1] * residual[1] + residual[2] * residual[2]
    moved = residual[3] * residual[3] + residual[4] * residual[4] + residual[5] * residual[5]
    return (turns == 0.0 or turned <= orientation_tolerance * orientation_tolerance) and (
        moves == 0.0 or moved <= position_tolerance * position_tolerance
    )


# options: tolerances of position (m) and orientation (rad), largest number of iterations a start
# report of a pose: position error (m), orientation error (rad), iterations, starts
# arguments: chain, limits (2 × n), starts (K × n), poses (N × 8), options, q (N × n), reports (N × 4), work
@kernel(STATUS(READ2, READ2, READ2, READ2, READ, WRITE2, WRITE2, WRITE))
def solve(chain, limits, starts, poses, options, q, reports, work):
    """Solve each pose from the q given, then from the starts in turn; keep the best q and its errors."""
    n = chain.shape[0] - 1
    position_tolerance, orientation_tolerance, most = options[0], options[1], int(options[2])
    moves = 0.0 if math.isinf(position_tolerance) else 1.0
    turns = 0.0 if math.isinf(orientation_tolerance) else 1.0
    here = as_matrix(work[0 : 6 * n], n, 6)
    there = as_matrix(work[6 * n : 12 * n], n, 6)
    now, trial, held, best = (
        work[12 * n : 13 * n],
        work[13 * n : 14 * n],
        work[14 * n : 15 * n],
        work[15 * n : 16 * n],
    )
    rest = work[16 * n :]
    gram = as_matrix(rest[0:36], 6, 6)
    residual, after, y, left = rest[36:42], rest[42:48], rest[48:54], rest[54:60]
    position, turn = rest[60:63], rest[63:67]
    for row in range(poses.shape[0]):
        target = poses[row]
        translation(target, position)
        least = math.inf
        total, tried = 0, 0
        for start in range(-1, starts.shape[0]):
            for m in range(n):
                now[m] = q[row, m] if start < 0 else starts[start, m]
            tried += 1
            square = _residual(chain, now, target, position, turns, moves, here, residual, turn)
            factor, waited = 1.0, 0
            for _ in range(most):
                if _reached(residual, turns, moves, position_tolerance, orientation_tolerance):
                    break
                total += 1
                damping = factor * DAMPING * square
                before = square
                if _step(here, residual, now, limits, damping, gram, y, left, held, trial):
                    new = _residual(chain, trial, target, position, turns, moves, there, after, turn)
                else:
                    new = math.inf
                if new < square:
                    square = new
                    for m in range(n):
                        now[m] = trial[m]
                        for k in range(6):
                            here[m, k] = there[m, k]
                    for k in range(6):
                        residual[k] = after[k]
                    factor = max(0.25 * factor, 1e-6)
                else:
                    factor *= 8.0
                waited = waited + 1 if square > STALL_RATIO * before else 0
                if waited >= PATIENCE:
                    break
            done = _reached(residual, turns, moves, position_tolerance, orientation_tolerance)
            if done or square < least:
                least = square
                for m in range(n):
                    best[m] = now[m]
            if done:
                break
        _residual(chain, best, target, position, 1.0, 1.0, here, residual, turn)  # also what does not count
        reports[row, 0] = math.sqrt(residual[3] ** 2 + residual[4] ** 2 + residual[5] ** 2)
        reports[row, 1] = math.sqrt(residual[0] ** 2 + residual[1] ** 2 + residual[2] ** 2)
        for m in range(n):
            q[row, m] = best[m]
        reports[row, 2], reports[row, 3] = total, tried
    return OK


class TaskSolverWork(NamedTuple):
    """Scratch for k tasks and n coordinates."""

    here: Annotated[Array, "6 * k", "n"]
    there: Annotated[Array, "6 * k", "n"]
    gram: Annotated[Array, "6 * k", "6 * k"]
    now: Annotated[Array, "n"]
    trial: Annotated[Array, "n"]
    held: Annotated[Array, "n"]
    best: Annotated[Array, "n"]
    residual: Annotated[Array, "6 * k"]
    after: Annotated[Array, "6 * k"]
    y: Annotated[Array, "6 * k"]
    left: Annotated[Array, "6 * k"]
    pose: Annotated[Array, 8]
    at: Annotated[Array, 3]
    turn: Annotated[Array, 4]
    twist: Annotated[Array, 6, "n"]
    scratch: Annotated[Array, "8 * n"]


task_solver_work: MemoryLayout[TaskSolverWork] = MemoryLayout(TaskSolverWork, "k", "n")


@inline
def _task_residual(tables, begins, q, target, options, weighted, own, jacobian, out):
    """Write residuals and Jacobian of all tasks at q, those that do not count as 0; return the residual's square."""
    square = 0.0
    for k in range(begins.shape[0] - 1):
        wanted = target[8 * k : 8 * k + 8]
        moves = 0.0 if weighted and math.isinf(options[1 + 2 * k]) else 1.0
        turns = 0.0 if weighted and math.isinf(options[2 + 2 * k]) else 1.0
        task_twist_kinematics(
            tables[int(begins[k]) : int(begins[k + 1])], q, own.pose, own.twist, own.scratch
        )
        px, py, pz = position(own.pose)
        rows, error = jacobian[6 * k : 6 * k + 6], out[6 * k : 6 * k + 6]
        chains.hand_jacobian((px, py, pz), own.twist, rows)
        for j in range(q.shape[0]):
            for i in range(3):
                rows[i, j] *= turns
                rows[3 + i, j] *= moves
        half_turn(own.pose, wanted, own.turn, error)
        translation(wanted, own.at)
        error[0], error[1], error[2] = turns * 2.0 * error[0], turns * 2.0 * error[1], turns * 2.0 * error[2]
        error[3], error[4], error[5] = (
            moves * (own.at[0] - px),
            moves * (own.at[1] - py),
            moves * (own.at[2] - pz),
        )
        for i in range(6):
            square += error[i] * error[i]
    return square


@inline
def _length(error, first):
    return math.sqrt(
        error[first] * error[first]
        + error[first + 1] * error[first + 1]
        + error[first + 2] * error[first + 2]
    )


@inline
def _tasks_reached(residual, options):
    """Return whether the errors that count are within their tolerances."""
    for k in range(residual.shape[0] // 6):
        if _length(residual, 6 * k + 3) > options[1 + 2 * k] or _length(residual, 6 * k) > options[2 + 2 * k]:
            return False
    return True


@inline
def _task_step(own, q, limits, damping):
    """Write the configuration after one damped step inside the limits; return whether it could be computed."""
    n, rows = q.shape[0], own.residual.shape[0]
    jacobian, gram, y, left, held, out = own.here, own.gram, own.y, own.left, own.held, own.trial
    for i in range(n):
        held[i] = 0.0
    for i in range(rows):
        left[i] = own.residual[i]
    for _ in range(n + 1):
        trace = 0.0
        for i in range(rows):
            for j in range(i + 1):
                value = 0.0
                for m in range(n):
                    value += (1.0 - held[m]) * jacobian[i, m] * jacobian[j, m]
                gram[i, j] = value
            trace += gram[i, i]
        for i in range(rows):
            gram[i, i] += damping + LEAST_DAMPING * trace + 1e-300
            y[i] = left[i]
        if not cholesky(gram, rows):
            return False
        cholesky_solve(gram, rows, y)
        inside = True
        for m in range(n):
            if held[m] == 0.0:
                change = 0.0
                for k in range(rows):
                    change += jacobian[k, m] * y[k]
                value = q[m] + change
                if value < limits[0, m] or value > limits[1, m]:
                    inside = False
                    value = limits[0, m] if value < limits[0, m] else limits[1, m]
                    held[m] = 1.0
                    for k in range(rows):
                        left[k] -= jacobian[k, m] * (value - q[m])
                out[m] = value
        if inside:
            return True
    return True


# tables of all tasks (rows × 13), where each begins (K + 1), limits (2 × n), starts (S × n), poses (N × 8 K), options,
# q (N × n), reports (N × 4), work
# options: iterations, then tolerances of position (m) and orientation (rad) of each task
# report of a row: largest position error (m), largest orientation error (rad), iterations, starts
@kernel(STATUS(READ2, READ, READ2, READ2, READ2, READ, WRITE2, WRITE2, WRITE))
def solve_tasks(tables, begins, limits, starts, poses, options, q, reports, work):
    """Solve each row of poses from the q given, then from the starts in turn; keep the best q and its errors."""
    n, count = q.shape[1], begins.shape[0] - 1
    own = task_solver_work(work, count, n)
    now, trial, best = own.now, own.trial, own.best
    most = int(options[0])
    for row in range(poses.shape[0]):
        target = poses[row]
        least = math.inf
        total, tried = 0, 0
        for start in range(-1, starts.shape[0]):
            for m in range(n):
                now[m] = q[row, m] if start < 0 else starts[start, m]
            tried += 1
            square = _task_residual(tables, begins, now, target, options, True, own, own.here, own.residual)
            factor, waited = 1.0, 0
            for _ in range(most):
                if _tasks_reached(own.residual, options):
                    break
                total += 1
                damping = factor * DAMPING * square
                before = square
                new = math.inf
                if _task_step(own, now, limits, damping):
                    new = _task_residual(
                        tables, begins, trial, target, options, True, own, own.there, own.after
                    )
                if new < square:
                    square = new
                    for m in range(n):
                        now[m] = trial[m]
                        for k in range(6 * count):
                            own.here[k, m] = own.there[k, m]
                    for k in range(6 * count):
                        own.residual[k] = own.after[k]
                    factor = max(0.25 * factor, 1e-6)
                else:
                    factor *= 8.0
                waited = waited + 1 if square > STALL_RATIO * before else 0
                if waited >= PATIENCE:
                    break
            done = _tasks_reached(own.residual, options)
            if done or square < least:
                least = square
                for m in range(n):
                    best[m] = now[m]
            if done:
                break
        _task_residual(tables, begins, best, target, options, False, own, own.here, own.residual)
        reports[row, 0], reports[row, 1] = 0.0, 0.0
        for k in range(count):
            reports[row, 0] = max(reports[row, 0], _length(own.residual, 6 * k + 3))
            reports[row, 1] = max(reports[row, 1], _length(own.residual, 6 * k))
        for m in range(n):
            q[row, m] = best[m]
        reports[row, 2], reports[row, 3] = total, tried
    return OK
