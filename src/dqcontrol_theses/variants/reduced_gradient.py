"""The reduced gradient: freedom spent in the inputs that the task leaves, in place of a projection."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled import LAW, OK, MemoryLayout, inline, kernel
from dqcontrol.laws import PoseLaw, parts
from dqcontrol.robots import Robot

_KEPT = 2.0  # times that a pivot in use counts: the choice changes only for a clearly better one


class ReducedGradientState(NamedTuple):
    """What it keeps: the sign of the error, and which inputs the task uses, 1 or 0."""

    sign: Annotated[Array, 1]
    in_use: Annotated[Array, "m"]


class ReducedGradientWork(NamedTuple):
    """Its scratch for m inputs, r of which the task uses; ``matrix`` is eliminated, ``basis`` has their columns."""

    preferred: Annotated[Array, "m"]
    error: Annotated[Array, 8]
    target: Annotated[Array, 8]
    matrix: Annotated[Array, 6, "m"]
    row_done: Annotated[Array, 6]
    chosen: Annotated[Array, "m"]
    basis: Annotated[Array, 6, "r"]
    nothing: Annotated[Array, "r"]
    task_inputs: Annotated[Array, "r"]
    share: Annotated[Array, "r"]
    solver: Annotated[Array, parts.twist_work.sized("r")]


reduced_gradient_state: MemoryLayout[ReducedGradientState] = MemoryLayout(ReducedGradientState, "m")
reduced_gradient_work: MemoryLayout[ReducedGradientWork] = MemoryLayout(ReducedGradientWork, "m", "r")


@inline
def choose_inputs(twist_jacobian, pose, length, own, in_use):
    """Mark the r inputs whose columns of [ℓω ; ṗ] elimination with complete pivoting takes first."""
    matrix, row_done, chosen = own.matrix, own.row_done, own.chosen
    m, r = matrix.shape[1], own.nothing.shape[0]
    for j in range(m):
        column = parts.twist_at_end_effector(twist_jacobian[:, j], pose)
        for i in range(6):
            matrix[i, j] = length * column[i] if i < 3 else column[i]
        chosen[j] = 0.0
    for i in range(6):
        row_done[i] = 0.0
    for _ in range(r):
        best, row, col = -1.0, 0, 0
        for j in range(m):
            weight = _KEPT if in_use[j] == 1.0 else 1.0
            for i in range(6):
                size = weight * abs(matrix[i, j])
                if chosen[j] == 0.0 and row_done[i] == 0.0 and size > best:
                    best, row, col = size, i, j
        chosen[col], row_done[row] = 1.0, 1.0
        pivot = matrix[row, col]
        for i in range(6):
            if row_done[i] == 0.0 and pivot != 0.0:
                factor = matrix[i, col] / pivot
                for j in range(m):
                    matrix[i, j] -= factor * matrix[row, j]
    for j in range(m):
        in_use[j] = chosen[j]


@kernel(LAW)
def reduced_gradient(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write u_b = z_b − Aᵀ z_a and u_a = J_a⁺ y − A u_b, A = J_a⁺ J_b, y the twist of N⁺ K vec8(e)."""
    m = out.shape[0]
    given, kept = parts.pose_parameters(parameters), reduced_gradient_state(state, m)
    own = reduced_gradient_work(work, m, min(m, 6))
    parts.left_error(pose, sample, given.hysteresis, kept.sign, own.error)
    for i in range(8):
        own.target[i] = given.gain[i] * own.error[i]
    twist = parts.left_error_twist(own.target, own.error, pose, given.inverse)
    choose_inputs(twist_jacobian, pose, parts.inverse_parameters(given.inverse).length, own, kept.in_use)
    used = 0
    for j in range(m):
        if own.chosen[j] == 1.0:
            for i in range(6):
                own.basis[i, used] = twist_jacobian[i, j]
            own.nothing[used] = 0.0
            used += 1
    missing = parts.pose_error(pose, sample)
    status = parts.solve_hand_twist(
        pose, own.basis, twist, missing, own.nothing, given.inverse, own.solver, own.task_inputs
    )
    for j in range(m):
        if own.chosen[j] == 0.0 and status == OK:
            column = parts.twist_at_end_effector(twist_jacobian[:, j], pose)
            status = parts.solve_hand_twist(
                pose, own.basis, column, missing, own.nothing, given.inverse, own.solver, own.share
            )
            free, a = own.preferred[j], 0
            for i in range(m):
                if own.chosen[i] == 1.0:
                    free -= own.share[a] * own.preferred[i]
                    a += 1
            out[j] = free
            for a in range(used):
                own.task_inputs[a] -= own.share[a] * free
    a = 0
    for j in range(m):
        if own.chosen[j] == 1.0:
            out[j] = own.task_inputs[a]
            a += 1
    return status


class ReducedGradient(PoseLaw, frozen=True, kw_only=True, tag="reduced-gradient"):
    """K that spends its freedom along the reduced gradient. [De Luca and Oriolo 1991; for drives De Luca et al. 2006]

    The inputs are parted into u_a, as many as the task needs, and the others, u_b, whose gradient of an objective H is
    that of H along the motions that keep the task. With the motion z = −α∇H that ``null_space`` prefers and y the twist
    of the hand that `Proportional` asks for:

    u_b = z_b − Aᵀ z_a,   u_a = J_a⁻¹ y − A u_b,   A = J_a⁻¹ J_b.

    J u = y exactly, and u = J_a⁻¹ y + Z Zᵀ z with Z = [−A ; I]. `Proportional` has the orthogonal projection
    Z (ZᵀZ)⁻¹ Zᵀ in place of Z Zᵀ. Both descend H where the task lets them, this one by more at the same α, as all
    eigenvalues of ZᵀZ are at least 1. With one input to spare both move along the same line, this one 1 + |A|² times
    as fast: its better optimisation is a larger step, which a larger α gives `Proportional` too. At z = 0 the inputs
    u_b rest, while the least inputs of `Proportional` move all. Where J has lost rank the projection is onto all that
    the task leaves, and u_b are still only so many as there are inputs beyond six.

    u_a are chosen by elimination with complete pivoting of the Jacobian of [ℓω ; ṗ], those in use counting double.
    Where the choice changes, the command jumps.

    Sampling limits and choice of K: those of `Proportional`.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, eight diagonal entries, or a `Schedule` of k.
    inverse
        How J_a is inverted, and ℓ.
    hysteresis
        How far Re(x*x_d) must pass 0 before the sign of x_d changes.
    null_space
        z; with None the inputs that the task does not need rest.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import ReducedGradient
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0.2, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target = dqc.Sample(arm.fkm(q + 0.02))
    >>> laws = [law(gain=2.0) for law in (ReducedGradient, dqc.laws.Proportional)]
    >>> commands = [law.command(arm, q, target, period=0.01) for law in laws]
    >>> np.allclose(*(arm.twist_jacobian(q) @ u for u in commands)), int((commands[0] == 0).sum())
    (True, 1)
    """

    kernel = reduced_gradient

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign of the error and a mark for each input."""
        return reduced_gradient_state.size(robot.input_size)

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and scratch."""
        return reduced_gradient_work.size(robot.input_size, min(robot.input_size, 6))
