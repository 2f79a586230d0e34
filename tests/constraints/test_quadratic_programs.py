"""Quadratic programs against what makes a point their minimiser, and against DAQP; levels against least squares."""

import numpy as np
import pytest
from program_samples import (
    active_set,
    degenerate_levels,
    nearly_dependent_programs,
    optimality,
    packed_levels,
    programs_of_a_loop,
    random_programs,
    solve,
    solve_by_daqp,
    solve_levels,
    squares_by_level,
)

import dqcontrol as dqc

CASES = {
    "few rows": (7, 5, {}),
    "many rows": (7, 40, {}),
    "two arms": (14, 60, {}),
    "largest": (30, 200, {}),
    "one input": (1, 4, {}),
    "no rows": (7, 0, {}),
    "no box": (7, 40, {"box": False}),
    "equations": (7, 40, {"equalities": 3}),
    "dependent rows": (14, 60, {"rank": 6}),
}


@pytest.mark.parametrize("case", CASES)
def test_answers_are_minimisers(case):
    n, m, options = CASES[case]
    flat = random_programs(np.random.default_rng(1), 8 if n == 30 else 40, n, m, **options)
    answers, sets, statuses = solve(flat, n, m)
    assert (statuses == active_set.SOLVED).all()
    assert optimality(flat, answers, n, m).max() < 1e-9
    again, _, statuses = solve(flat, n, m, sets=sets.copy())
    assert (statuses == active_set.SOLVED).all()
    assert np.abs(again[:, :n] - answers[:, :n]).max() < 1e-10


def test_a_start_from_any_set_leads_to_the_same_answer():
    n, m = 7, 40
    rng = np.random.default_rng(2)
    flat = random_programs(rng, 40, n, m)
    answers, sets, _ = solve(flat, n, m)
    for each in sets:
        each[0] = 6
        each[1:7] = rng.choice(m + 2 * n, 6, replace=False)
    again, _, statuses = solve(flat, n, m, sets=sets)
    assert (statuses == active_set.SOLVED).all()
    assert np.abs(again[:, :n] - answers[:, :n]).max() < 1e-10


@pytest.mark.parametrize("equalities", [0, 2])
@pytest.mark.parametrize(("n", "m"), [(3, 12), (7, 40), (14, 40)])
def test_rows_that_nearly_depend_on_each_other(n, m, equalities):
    """Two rows with a sine of 1e-9 between them are two rows; both are kept, not one of them by 1e-8."""
    flat = nearly_dependent_programs(np.random.default_rng(8), 60, n, m, 1e-9, equalities=equalities)
    answers, _, statuses = solve(flat, n, m)
    assert (statuses == active_set.SOLVED).all()
    assert optimality(flat, answers, n, m).max() < 1e-11


def test_programs_of_a_control_loop():
    """Rows at what the last command led to are nearly those at where it started."""
    n = 7
    for flat, m in programs_of_a_loop(np.random.default_rng(9), 60):
        answers, sets, statuses = solve(flat[None], n, m)
        assert statuses == [active_set.SOLVED]
        assert optimality(flat[None], answers, n, m).max() < 1e-11
        again, _, _ = solve(flat[None], n, m, sets=sets)
        assert np.abs(again - answers).max() < 1e-9


def beyond_daqp(flat, n, m):
    """Return how many answers are not minimisers within 1e-9 of DAQP's."""
    answers, _, statuses = solve(flat, n, m)
    assert (statuses == active_set.SOLVED).all()
    assert optimality(flat, answers, n, m).max() < 1e-9
    return sum(
        np.abs(solve_by_daqp(each, n, m)[0] - answer[:n]).max() > 1e-9
        for each, answer in zip(flat, answers, strict=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("n", "m", "count"), [(7, 5, 40_000), (7, 40, 40_000), (14, 60, 15_000), (30, 100, 5_000)]
)
def test_a_hundred_thousand_programs(n, m, count):
    pytest.importorskip("daqp", reason="DAQP is the reference")
    assert beyond_daqp(random_programs(np.random.default_rng(3), count, n, m), n, m) == 0


@pytest.mark.slow
@pytest.mark.parametrize("n", range(2, 15))
def test_a_hundred_thousand_programs_of_nearly_dependent_rows(n):
    pytest.importorskip("daqp", reason="DAQP is the reference")
    rng = np.random.default_rng(n)
    assert (
        sum(beyond_daqp(nearly_dependent_programs(rng, 1925, n, m, 1e-6), n, m) for m in (5, 12, 25, 40)) == 0
    )


def test_contradictory_rows_get_the_least_violation():
    """u ≤ 1 and u ≥ 2: half of the gap each; the box holds."""
    found = dqc.constraints.quadratic_program([[1.0]], [0.0], [[1], [-1]], [1, -2])
    assert found.status == "infeasible"
    assert found.u == pytest.approx([1.5], abs=1e-9)
    assert found.violations == pytest.approx([0.5, 0.5], abs=1e-9)
    boxed = dqc.constraints.quadratic_program([[1.0]], [0.0], [[-1.0]], [-2], lower=[-1], upper=[1])
    assert boxed.status == "infeasible"
    assert boxed.u == pytest.approx([1.0], abs=1e-15)
    both = dqc.constraints.quadratic_program(np.eye(2), [0, 0], [[1, 0], [2, 0]], [1, 3], equalities=2)
    assert both.status == "infeasible"
    assert both.u == pytest.approx([1.4, 0], abs=1e-9)


def test_equations_that_depend_on_others_are_solved():
    found = dqc.constraints.quadratic_program(
        np.eye(2), [0, -3], [[1, 0], [2, 0], [0, 0], [0, 1]], [1, 2, 0, 1], equalities=3
    )
    assert found.status == "solved"
    assert found.u == pytest.approx([1, 1])
    assert found.multipliers[3] == pytest.approx(2)


def test_multipliers_balance_the_objective():
    h, g = np.diag([1.0, 2, 3]), np.array([-5.0, 4, 1])
    rows, bounds = np.array([[1.0, 1, 0], [0, 1, 1]]), np.array([0.5, 0.2])
    found = dqc.constraints.quadratic_program(h, g, rows, bounds, lower=[-1] * 3, upper=[1] * 3)
    balance = h @ found.u + g + rows.T @ found.multipliers + found.bound_multipliers
    assert np.abs(balance).max() < 1e-12
    assert sorted(found.active) == sorted(
        [
            *np.flatnonzero(found.multipliers),
            *(2 + np.flatnonzero(found.bound_multipliers > 0)),
            *(5 + np.flatnonzero(found.bound_multipliers < 0)),
        ]
    )


def test_the_limit_of_iterations_leaves_an_answer_inside_the_box():
    n, m = 7, 40
    flat = random_programs(np.random.default_rng(4), 20, n, m)
    answers, _, statuses = solve(flat, n, m, limit=2)
    assert (statuses == active_set.LIMIT).all()
    assert np.isfinite(answers).all()


def test_levels_of_equations_against_null_spaces():
    """Pseudoinverses in the null space of what comes before; ranks are lost within and between levels."""
    rng = np.random.default_rng(5)
    for _ in range(10):
        levels, rows, bounds, _ = degenerate_levels(rng)
        n, expected, free = rows.shape[1], np.zeros(rows.shape[1]), np.eye(rows.shape[1])
        for level in range(3):
            a, b = rows[levels == level], bounds[levels == level]
            reduced = a @ free
            expected += free @ np.linalg.pinv(reduced, rcond=1e-9) @ (b - a @ expected)
            _, singular, right = np.linalg.svd(reduced)
            free = free @ right[int((singular > 1e-9).sum()) :].T
        u, status = solve_levels(*packed_levels(levels, rows, bounds, list(range(len(rows))), 3, np.inf))
        assert status == active_set.SOLVED
        everything = list(range(len(rows)))
        reached = squares_by_level(levels, rows, bounds, everything, u)
        best = squares_by_level(levels, rows, bounds, everything, expected)
        assert reached[0] - best[0] < 1e-9
        assert reached[1] - best[1] < 1e-8
        assert n == len(u)


def lost(case):
    """Return what levels 0 and 1 lose by the levels after them, and the status."""
    full, status = solve_levels(*packed_levels(*case, 3))
    assert np.abs(full).max() <= 1 + 1e-9
    reached = squares_by_level(*case, full)
    losses = [
        reached[k] - squares_by_level(*case, solve_levels(*packed_levels(*case, k + 1))[0])[k] for k in (0, 1)
    ]
    return max(losses), status


def test_upper_levels_lose_nothing():
    rng = np.random.default_rng(6)
    losses, statuses = zip(*(lost(degenerate_levels(rng)) for _ in range(100)), strict=True)
    assert set(statuses) == {active_set.SOLVED}
    assert max(losses) < 1e-9


def test_levels_that_depend_on_those_before_are_solved():
    """Rows that are within rounding of what upper levels have fixed were taken for contradictions."""
    rng = np.random.default_rng(7)
    loss, status = lost([degenerate_levels(rng) for _ in range(680)][-1])
    assert status == active_set.SOLVED
    assert loss < 1e-9


@pytest.mark.slow
def test_a_hundred_thousand_degenerate_levels():
    rng = np.random.default_rng(7)
    losses, statuses = zip(*(lost(degenerate_levels(rng)) for _ in range(100_000)), strict=True)
    assert set(statuses) == {active_set.SOLVED}
    assert max(losses) < 1e-9


def test_rows_that_gave_way_are_named():
    found = dqc.constraints.lexicographic_program(
        [0, 0, 1], [[1, 0], [-1, 0], [0, 1]], [1, -2, 5], lower=[-3, -3], upper=[3, 3], equalities=[2],
        names=["wall", "ball", "reach"],
    )  # fmt: skip
    assert found.gave_way == ("reach", "wall", "ball")
    assert found.u == pytest.approx([1.5, 3], abs=1e-9)
    free = dqc.constraints.lexicographic_program([], np.zeros((0, 2)), [], hessian=np.eye(2), gradient=[1, 1])
    assert free.u.tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"hessian": [[1, 0], [0, -1]]}, "least eigenvalue is -1"),
        ({"hessian": [[1, 2], [0, 1]]}, "symmetric"),
        ({"gradient": [1, np.nan]}, "gradient: must be finite"),
        ({"rows": [[1, 0, 0]]}, "rows: expected"),
        ({"bounds": [1, 2]}, "bounds: expected"),
        ({"bounds": [np.nan]}, "bounds: must be finite"),
        ({"lower": [2, 0], "upper": [1, 1]}, "lower: must be ≤ upper, got 2 > 1 of input 0"),
        ({"equalities": 2}, "equalities: there are 1 rows"),
        ({"active": [9]}, "active: expected numbers of constraints, 0 … 4"),
        ({"bounds": [np.inf], "equalities": 1}, "of equations must be finite"),
    ],
)
def test_bad_input_is_named(change, words):
    given = {"hessian": np.eye(2), "gradient": [0, 0], "rows": [[1, 1]], "bounds": [1]} | change
    with pytest.raises(dqc.Error, match=words):
        dqc.constraints.quadratic_program(**given)
