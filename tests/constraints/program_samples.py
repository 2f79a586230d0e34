"""Random quadratic programs, and what shows that an answer is right."""

import numpy as np
from constraint_scenes import HOME, random_constraints, random_goal

import dqcontrol as dqc
from dqcontrol.constraints import active_set, levels as levels_code
from dqcontrol.constraints.constraint_layout import box_of, head, objective_of, work_of


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


def nearly_dependent_programs(rng, count, n, m, closest, *, equalities=0):
    """Return programs whose rows come in pairs of nearly one direction: their sines are between `closest` and 0.1."""
    flat = random_programs(rng, count, n, m)
    for each in flat:
        program = active_set.unpack_program(each, n, m)
        pairs = m // 2
        sine = 10.0 ** rng.uniform(np.log10(closest), -1, pairs)
        first = rng.normal(size=(pairs, n))
        slack = rng.exponential(0.3, pairs)
        other = np.maximum(slack + sine * rng.normal(size=pairs) * rng.choice([0, 1, 1], pairs), 0)
        slack[: equalities // 2] = other[: equalities // 2] = 0
        program.columns[:, 0 : 2 * pairs : 2] = first.T
        program.columns[:, 1 : 2 * pairs : 2] = (first + sine[:, None] * rng.normal(size=(pairs, n))).T
        inside = rng.uniform(-0.5, 0.5, n)
        program.bounds[:] = inside @ program.columns
        program.bounds[0 : 2 * pairs : 2] += slack
        program.bounds[1 : 2 * pairs : 2] += other
        program.equal[:equalities] = 1
    return flat


def programs_of_a_loop(rng, count, period=0.005):
    """Return so many programs that a Panda among obstacles solved in its loop: packed, with numbers of their rows."""
    arm, found = dqc.load_robot("panda"), []
    n = len(HOME)
    while len(found) < count:
        given = random_constraints(rng, arm, HOME, acceleration=float(rng.uniform(5, 20)))
        goal = random_goal(rng, arm)
        law = dqc.laws.Proportional(gain=3.0, constraints=given).prepare(arm, goal, period)
        assert law.constraints is not None
        scratch, state, q = law._parts.constraint_work, law.initial_state(HOME), HOME
        work = work_of(scratch, n, n, head(law.constraints.parameters))
        box, objective = box_of(work.box, n), objective_of(work.objective, n)
        for i in range(300):
            scratch[:] = np.nan  # what is a number afterwards belongs to the programs of this step
            u = law.command(q, goal.at(i * period), state).copy()
            law.sent(state, u)
            q = q + period * u
            m = (int(np.isfinite(work.program).sum()) - n * n - 3 * n) // (n + 3)
            if m < 1:  # no program was solved, or one without rows
                continue
            flat = work.program[: active_set.program_size(n, m)].copy()
            program = active_set.unpack_program(flat, n, m)
            if not (program.softness == 0).all() or (program.lower != box.low).any():
                continue  # it was solved by softer ones after this
            program.gradient[:] = -program.hessian @ objective.wish
            found.append((flat, m))
    return found[:count]


def solve_by_daqp(flat, n, m):
    """Return DAQP's answer of one packed program, and the seconds that its own timer says."""
    import daqp

    program = active_set.unpack_program(flat, n, m)
    sense = np.zeros(n + m, np.int32)
    sense[n:][program.equal > 0] = 5  # active, and never to be taken away
    u, _, flag, about = daqp.solve(
        program.hessian.copy(),
        program.gradient.copy(),
        np.ascontiguousarray(program.columns.T),
        np.concatenate([program.upper, program.bounds]),
        np.concatenate([program.lower, np.where(program.equal > 0, program.bounds, -1e30)]),
        sense,
        primal_tol=1e-12,
    )
    assert flag == 1
    return u, about["setup_time"] + about["solve_time"]


def solve(flat, n, m, sets=None, limit=500):
    """Return answers, sets and statuses of packed programs."""
    count = len(flat)
    room = active_set.room_for(n, m, soft=False)
    if sets is None:
        sets = np.zeros((count, room + 2), np.intp)
    answers = np.empty((count, 3 * n + m))
    active_set.solve_programs(flat, n, m, limit, answers, sets, np.empty(active_set.scratch_size(n, m, room)))
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
            np.abs(up[finite] * (program.upper - u)[finite]).max(initial=0),
            np.abs(low[finite] * (u - program.lower)[finite]).max(initial=0),
        )
        signs = min(y[free].min(initial=0), up.min(), low.min())
        worst = np.maximum(worst, [-kept, -signs / scale, np.abs(balance).max() / scale, rest / scale])
    return worst


def degenerate_levels(rng, n=14):
    """Return levels, rows, bounds and equations: contradictory walls, a task of lost rank, one that depends on both."""
    walls = rng.normal(size=(8, 3)) @ rng.normal(size=(3, n))
    walls[6:] = -walls[:2] * rng.choice([1.0, 0.1, 10.0])  # from both sides, too near each other
    task = rng.normal(size=(6, 4)) @ rng.normal(size=(4, n))
    posture = np.vstack([rng.normal(size=(5, n)), task[:2] + walls[:2], np.zeros((1, n)), 2 * task[:1]])
    rows = np.vstack([walls, task, posture])
    levels = np.repeat([0, 1, 2], [8, 6, 9])
    bounds = rng.normal(size=len(rows)) * rng.choice([0.1, 1.0])
    bounds[6:8] = -bounds[:2] * np.linalg.norm(walls[6]) / np.linalg.norm(walls[0]) - 0.1
    return levels, rows, bounds, list(range(8, len(rows)))


def packed_levels(levels, rows, bounds, equations, upto, side=1.0):
    """Return a packed program of the rows of the first levels, with u inside ±side."""
    kept = levels < upto
    m, n = int(kept.sum()), rows.shape[1]
    flat = np.zeros(active_set.program_size(n, m))
    program = active_set.unpack_program(flat, n, m)
    program.hessian[:] = np.eye(n)
    program.columns[:], program.bounds[:] = rows[kept].T, bounds[kept]
    program.equal[equations[: m - (len(rows) - len(equations))]] = 1
    program.lower[:], program.upper[:] = -side, side
    return flat, levels[kept].astype(np.intp), n, m


def solve_levels(flat, levels, n, m):
    """Return u and the status."""
    u, chosen = np.zeros(n), np.zeros(levels_code.room_for_levels(n, m) + 2, np.intp)
    count, memory = int(levels.max(initial=-1)) + 1, np.empty(levels_code.levels_size(n, m))
    return u, levels_code.solve_levels(flat, levels, count, n, m, 500, memory, u, chosen)


def squares_by_level(levels, rows, bounds, equations, u):
    """Return half the sum of the squares of the violations of each level."""
    violation = rows @ u - bounds
    inequality = np.setdiff1d(np.arange(len(rows)), equations)
    violation[inequality] = np.maximum(violation[inequality], 0)
    return np.array([np.sqrt((violation[levels == k] ** 2).sum()) for k in range(int(levels.max()) + 1)])
