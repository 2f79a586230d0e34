"""Inverse kinematics of one or several tasks of a tree at once, compiled.

The same damped Newton steps inside the joint limits as those of chains (`inverse_kernels`, whose 6 × 6 system is
written for one end effector), with six rows a task.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import (
    half_angle,
    position,
    quaternion_product,
    translation,
)
from dqcontrol.algebra.symmetric import cholesky, cholesky_solve
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.inverse.inverse_kernels import DAMPING, LEAST_DAMPING, PATIENCE, STALL_RATIO
from dqcontrol.robots.kinematics.kinematics_kernels import hand_jacobian
from dqcontrol.robots.kinematics.pose_task_kernels import task_twist_kinematics

# tables of all tasks (rows × 13), where each begins (K + 1), limits (2 × n), starts (S × n), poses (N × 8 K), options,
# q (N × n), reports (N × 4), work
# options: iterations, then tolerances of position (m) and orientation (rad) of each task
# report of a row: largest position error (m), largest orientation error (rad), iterations, starts
SOLVE_TASKS = STATUS(READ2, READ, READ2, READ2, READ2, READ, WRITE2, WRITE2, WRITE)


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
def _residual(tables, begins, q, target, options, weighted, own, jacobian, out):
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
        hand_jacobian((px, py, pz), own.twist, rows)
        for j in range(q.shape[0]):
            for i in range(3):
                rows[i, j] *= turns
                rows[3 + i, j] *= moves
        pose, turn = own.pose, own.turn
        quaternion_product(wanted, (pose[0], -pose[1], -pose[2], -pose[3]), turn)
        if turn[0] < 0.0:  # the short way round
            turn[0], turn[1], turn[2], turn[3] = -turn[0], -turn[1], -turn[2], -turn[3]
        half_angle(turn, error)
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
def _reached(residual, options):
    """Return whether the errors that count are within their tolerances."""
    for k in range(residual.shape[0] // 6):
        if _length(residual, 6 * k + 3) > options[1 + 2 * k] or _length(residual, 6 * k) > options[2 + 2 * k]:
            return False
    return True


@inline
def _step(own, q, limits, damping):
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


@kernel(SOLVE_TASKS)
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
            square = _residual(tables, begins, now, target, options, True, own, own.here, own.residual)
            factor, waited = 1.0, 0
            for _ in range(most):
                if _reached(own.residual, options):
                    break
                total += 1
                damping = factor * DAMPING * square
                before = square
                new = math.inf
                if _step(own, now, limits, damping):
                    new = _residual(tables, begins, trial, target, options, True, own, own.there, own.after)
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
            done = _reached(own.residual, options)
            if done or square < least:
                least = square
                for m in range(n):
                    best[m] = now[m]
            if done:
                break
        _residual(tables, begins, best, target, options, False, own, own.here, own.residual)
        reports[row, 0], reports[row, 1] = 0.0, 0.0
        for k in range(count):
            reports[row, 0] = max(reports[row, 0], _length(own.residual, 6 * k + 3))
            reports[row, 1] = max(reports[row, 1], _length(own.residual, 6 * k))
        for m in range(n):
            q[row, m] = best[m]
        reports[row, 2], reports[row, 3] = total, tried
    return OK
