"""Inverse kinematics, compiled: damped Newton steps inside the joint limits, from several starts.

The residual is what the end effector still has to turn (rotation vector, rad) and to move (m), inertial axes. A step
minimises
|e − J Δq|² + λ|Δq|²; joints that would leave their limits are set on them and the rest is solved again, so that every
iterate lies inside. [Levenberg 1944; Marquardt 1963; Sugihara 2011]
"""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import half_angle, quaternion_product, translation
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, inline, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.robots.kinematics.kinematics_kernels import (
    REVOLUTE,
    compose_fixed,
    half_sine_cosine,
    move_joint,
    z_axis,
)

# options: tolerances of position (m) and orientation (rad), largest number of iterations a start
# report of a pose: position error (m), orientation error (rad), iterations, starts
# arguments: chain, limits (2 × n), starts (K × n), poses (N × 8), options, q (N × n), reports (N × 4), work
SOLVE = STATUS(READ2, READ2, READ2, READ2, READ, WRITE2, WRITE2, WRITE)

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
        w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[i])
        zx, zy, zz = z_axis(w, x, y, z)
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = zx, zy, zz
        jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = px, py, pz
        sine, cosine = half_sine_cosine(q[i])
        w, x, y, z, px, py, pz = move_joint(
            w, x, y, z, px, py, pz, zx, zy, zz, chain[i, 7], q[i], sine, cosine
        )
    w, x, y, z, px, py, pz = compose_fixed(w, x, y, z, px, py, pz, chain[n])
    for i in range(n):
        zx, zy, zz = jacobian[i, 0], jacobian[i, 1], jacobian[i, 2]
        if chain[i, 7] != REVOLUTE:
            jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = 0.0, 0.0, 0.0
            jacobian[i, 3], jacobian[i, 4], jacobian[i, 5] = moves * zx, moves * zy, moves * zz
        else:
            ax, ay, az = px - jacobian[i, 3], py - jacobian[i, 4], pz - jacobian[i, 5]
            jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = turns * zx, turns * zy, turns * zz
            jacobian[i, 3] = moves * (zy * az - zz * ay)
            jacobian[i, 4] = moves * (zz * ax - zx * az)
            jacobian[i, 5] = moves * (zx * ay - zy * ax)
    quaternion_product(target, (w, -x, -y, -z), turn)
    if turn[0] < 0.0:  # the short way round
        turn[0], turn[1], turn[2], turn[3] = -turn[0], -turn[1], -turn[2], -turn[3]
    half_angle(turn, out)
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


@kernel(SOLVE)
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
