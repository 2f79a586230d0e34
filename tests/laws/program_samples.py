"""Random quadratic programs, and what shows that an answer is right."""

import numpy as np

from dqcontrol.laws.constrained import active_set


def random_programs(rng, count, n, m, *, feasible=True, box=True, equalities=0, rank=None):
    """Return so many programs, packed, whose unconstrained minimisers are well outside of their constraints."""
    flat = np.zeros((count, active_set.program_size(n, m)))
    factor = rng.normal(size=(count, n, n))
    hessian = factor @ factor.transpose(0, 2, 1) + 0.1 * np.eye(n)
    rows = rng.normal(size=(count, m, n))
    if rank is not None:  # rows that depend on a few, scaled copies among them
        rows = rng.normal(size=(count, m, rank)) @ rows[:, :rank]
        rows[:, m // 2 :] = rows[:, : m - m // 2] * rng.choice([1e-2, 1.0, 1e2], size=(count, m - m // 2, 1))
    inside = rng.uniform(-0.5, 0.5, (count, n))
    bounds = np.einsum("cmn,cn->cm", rows, inside)
    bounds[:, equalities:] += rng.exponential(0.5, (count, m - equalities)) if feasible else -0.3
    for i in range(count):
        program = active_set.unpack_program(flat[i], n, m)
        program.hessian[:], program.gradient[:] = hessian[i], 5 * rng.normal(size=n)
        program.columns[:], program.bounds[:] = rows[i].T, bounds[i]
        program.equal[:equalities] = 1
        program.lower[:], program.upper[:] = (-1, 1) if box else (-np.inf, np.inf)
    return flat


def solve(flat, n, m, sets=None, limit=500):
    """Return answers, sets and statuses of packed programs."""
    count = len(flat)
    room = active_set.room_for(n, m, soft=False)
    if sets is None:
        sets = np.zeros((count, room + 2), np.intp)
    answers = np.empty((count, 3 * n + m))
    active_set.solve_programs(
        flat, n, m, limit, answers, sets, np.empty(active_set.scratch_size(n, m, room))
    )
    return answers, sets, sets[:, -1]


def optimality(flat, answers, n, m):
    """Return the worst breach of what makes a point the minimiser: bounds kept, multipliers' signs, balance, rest."""
    worst = np.zeros(4)
    for each, answer in zip(flat, answers, strict=True):
        program = active_set.unpack_program(each, n, m)
        u, rows = answer[:n], program.columns.T
        y, up, low = np.split(answer[n:], [m, m + n])
        free = program.equal == 0
        slack = program.bounds - rows @ u
        balance = program.hessian @ u + program.gradient + rows.T @ y + up - low
        scale = 1 + np.abs(y).max(initial=0) + np.abs(up).max() + np.abs(low).max()
        kept = min(
            slack[free].min(initial=0),
            -np.abs(slack[~free]).max(initial=0),
            (program.upper - u).min(),
            (u - program.lower).min(),
        )
        finite = np.isfinite(program.upper)
        rest = max(
            np.abs(y[free] * slack[free]).max(initial=0),
            np.abs(up * (program.upper - u))[finite].max(initial=0),
            np.abs(low * (u - program.lower))[finite].max(initial=0),
        )
        signs = min(y[free].min(initial=0), up.min(), low.min())
        worst = np.maximum(worst, [-kept, -signs / scale, np.abs(balance).max() / scale, rest / scale])
    return worst
