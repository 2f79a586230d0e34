"""What S17 cites: parsimonious control at its optimum, and the experiments that run the cited laws."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants import Integrator
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.silva2017 import (
    baselines_experiment as baselines,
    far_goals_experiment as far_goals,
)
from dqcontrol_theses.silva2017.parsimonious import parsimonious_law

pytest.importorskip("scipy")

GAIN, WEIGHT, T = 0.5, 0.9, 0.05
ONE = Conditions(jobs=1)


@pytest.fixture(scope="module")
def task():
    """Return Little John, a configuration and the pose of another one."""
    robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    return robot, q, dqc.Sample(robot.fkm(q + 0.1 * np.array([1, -1, 2, 1, -1, 1, 1, -1])))


def cost(robot, q, goal, u):
    error = robot.fkm(q) - goal.pose * np.sign(goal.pose[:4] @ robot.fkm(q)[:4])
    left = robot.pose_jacobian(q) @ u + GAIN * error
    return WEIGHT * np.abs(left).sum() + (1 - WEIGHT) * np.abs(u).sum()


def test_no_change_of_the_inputs_lowers_the_cost(task):
    """The problem is convex: what no small step improves is the least."""
    robot, q, goal = task
    u = parsimonious_law(robot, GAIN, WEIGHT).command(robot, q, goal, T)
    least, rng = cost(robot, q, goal, u), np.random.default_rng(5)
    steps = rng.normal(size=(2000, robot.input_size)) * 10 ** rng.uniform(-6, 0, (2000, 1))
    steps[::2] *= rng.random((1000, robot.input_size)) < 0.3
    assert min(cost(robot, q, goal, u + step) for step in steps) >= least - 1e-12
    assert (np.abs(u) > 1e-9).sum() < robot.input_size
    assert least < cost(robot, q, goal, dqc.laws.Proportional(gain=GAIN).command(robot, q, goal, T))


def test_the_command_is_proportional_to_the_error_and_rests_if_motion_is_dear(task):
    robot, q, goal = task
    once, twice = (
        parsimonious_law(robot, gain, WEIGHT).command(robot, q, goal, T) for gain in (GAIN, 2 * GAIN)
    )
    np.testing.assert_allclose(twice, 2 * once, atol=1e-9)
    np.testing.assert_array_equal(parsimonious_law(robot, GAIN, 0.1).command(robot, q, goal, T), 0)


def test_its_own_constraints_keep_wheels_speeds_and_joints_within_their_limits(task):
    robot, q, goal = task
    q = q.copy()
    q[5] = robot.limits.upper[5] - 1e-3
    free = parsimonious_law(robot, 20.0).command(robot, q, goal, T)
    u = parsimonious_law(robot, 20.0, limits_period=T).command(robot, q, goal, T)
    rim = [abs(each[0]) + robot.drives[0, 3] * abs(each[1]) for each in (u, free)]
    assert rim[0] <= 0.5 + 1e-9 < rim[1]
    assert (np.abs(u) <= robot.limits.velocity + 1e-9).all()
    after = robot.integrate(q, u, T)
    assert (after <= robot.limits.upper + 1e-9).all()


def test_it_drives_an_arm_to_its_goal():
    arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    goal = dqc.references.SetPoint(arm.fkm(q + 0.2))
    run = dqc.simulate(arm, goal, parsimonious_law(arm, 5.0, 0.99), Integrator(), q, T, 3.0)
    assert run.error[-1] < 1e-5 < 0.1 < run.error[0]


@pytest.mark.parametrize("weight", [0, 1, 2])
def test_bad_weight(weight):
    with pytest.raises(ValueRangeError, match=rf"weight: must be in \(0, 1\), got {weight}"):
        parsimonious_law(dqc.load_robot("little-john"), 1.0, weight)


@pytest.mark.slow
def test_the_cited_laws_on_the_goal_of_the_comparison():
    done = baselines.reproduce(ONE, count=1, programs=1)
    rows = {str(row[0]): row for row in done.tables[0].rows}
    assert rows["S17"][1:3] == [139, 248]
    assert rows["reduced gradient"][6] < 6.1
    assert rows[baselines.PARSIMONIOUS][6] < 6.1 < 6.9 < rows["least inputs"][6]
    assert len(done.tables[1].rows) == len(rows)
    assert [str(row[2]) for row in done.tables[2].rows] == ["supported"] * 3
    assert "2.00 times as fast" in done.tables[2].rows[2][3]  # 1 + |A|²
    assert set(done.figures) == {"inputs", "errors"}


@pytest.mark.slow
def test_far_goals_are_counted_without_and_with_limits():
    pytest.importorskip("mujoco")
    done = far_goals.reproduce(ONE, count=2, in_physics=1)
    for table in done.tables[:2]:
        by_law = {str(row[0]): row for row in table.rows}
        assert [by_law["remedy: guided K along a planned way"][k] for k in (1, 2)] == ["2, 2, 2"] * 2
        in_physics = [column.title for column in table.columns].index(
            "Of the first 1, with limits, in physics"
        )
        assert by_law["S17"][in_physics]
        assert not by_law["S17 with (3.13)"][in_physics]
    in_range, along_plan = done.tables[2].rows
    assert [str(along_plan[k]) for k in (2, 4)] == ["not supported", "supported"], "S17's own law, ours"
    assert {str(in_range[k]) for k in (2, 4)} <= {
        "cannot be decided: it says what is necessary, not what is enough",
        "cannot be decided",
    }
    assert str(in_range[1]).startswith("the whole-body asymptotic stability")
