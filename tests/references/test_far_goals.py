"""Far goals with all limits on: planned and followed within them, by bases of all kinds, and what cannot be reached."""

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import Error, UnreachableGoalError, ValueRangeError
from dqcontrol.plants import Integrator, MobilePlant
from dqcontrol.references import DriveTo, random_goals
from dqcontrol.references.base_ways import arcs_and_lines, rolled
from dqcontrol.robots import nearest_pose

SEED = 20261209
_file = Path(__file__).parents[2] / "benchmarks" / "far_goals.py"
_spec = importlib.util.spec_from_file_location("far_goals", _file)
assert _spec is not None
assert _spec.loader is not None
far_goals = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(far_goals)
HOME = np.array([0, 0, 0, *far_goals.ARM])
BODIES = far_goals.bodies()


def run(name, count, plant, rest):
    robot = BODIES[name]
    goals = robot.fkm(random_goals(robot, HOME, count, reach=far_goals.REACH, seed=far_goals.SEED))
    records = [far_goals.follow(robot, goal, plant, rest) for goal in goals]
    return robot, records


@pytest.mark.parametrize(
    ("count", "least"),
    [(7, {}), pytest.param(100, {"differential": 97, "car-like": 95}, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", BODIES)
def test_random_goals_are_reached_within_all_limits(name, count, least):
    robot, records = run(name, count, Integrator(), 2.0)
    reached = sum(bool((record.error[-20:] < 1e-3).all()) for record in records)
    assert reached >= least.get(name, count)
    assert max(far_goals.beyond_limits(robot, record, far_goals.PERIOD) for record in records) < 1e-9


@pytest.mark.parametrize(("count", "least"), [(1, 1), pytest.param(100, 95, marks=pytest.mark.slow)])
def test_random_goals_are_reached_in_physics_by_odometry(count, least):
    pytest.importorskip("mujoco")
    _, records = run("differential", count, MobilePlant(location="odometry"), 8.0)
    assert sum(record.position_error[-1] < 0.01 for record in records) >= least


def test_arcs_lead_to_the_goal_and_are_no_longer_than_they_need_be():
    """Longer than the straight line; parking beside needs the three arcs of Reeds and Shepp, known in closed form."""
    rng = np.random.default_rng(SEED)
    print("seed", SEED)
    for _ in range(200):
        start, goal = rng.uniform(-2, 2, (2, 3))
        pieces = arcs_and_lines(start, goal, 0.7)
        here = start[None]
        for piece in pieces:
            assert abs(piece.angle) <= abs(piece.length) / 0.7 + 1e-12
            here = rolled(here, np.array([piece.length]), np.array([piece.angle]))
        np.testing.assert_allclose(here[0, :2], goal[:2], atol=1e-9)
        assert math.remainder(here[0, 2] - goal[2], math.tau) == pytest.approx(0, abs=1e-9)
        assert sum(abs(piece.length) for piece in pieces) >= np.linalg.norm(goal[:2] - start[:2]) - 1e-9
    turn = arcs_and_lines(np.zeros(3), np.array([0, 0, math.pi]), 1.0)  # on the spot: three arcs of 60°
    assert sum(abs(piece.length) for piece in turn) == pytest.approx(math.pi)
    ahead = arcs_and_lines(np.zeros(3), np.array([1.5, 0, 0]), 1.0)
    assert sum(abs(piece.length) for piece in ahead) == pytest.approx(1.5)
    assert sum(abs(piece.length) for piece in arcs_and_lines(np.zeros(3), np.zeros(3), 1.0)) == 0


@pytest.mark.parametrize("name", BODIES)
def test_a_plan_keeps_its_share_of_accelerations_and_rims(name):
    robot = BODIES[name]
    way = DriveTo(
        robot, HOME, HOME + np.array([1.0, 0.7, 2.5, 0.5, 0.3, -0.4, 0.2, 0.6]), 0.8, acceleration=1.0
    )
    times = np.linspace(0, way.duration, 4001)
    u = way.mean_inputs(times, 1e-3)
    rates = np.abs(np.diff(u, axis=0)) / np.diff(times)[:, None]
    share = (rates / robot.acceleration_limits("", 1.0)).max()
    assert 0.5 < share < 0.81
    for drive in robot.drives:
        assert (np.abs(u[:, 0]) + drive[5] * np.abs(u[:, 1])).max() <= 0.8 * 0.5 + 1e-9


def test_what_cannot_be_reached_says_which_limit_and_how_near():
    arm = dqc.load_robot("ax18")
    q = np.array(far_goals.ARM, dtype=float)
    beyond = q.copy()
    beyond[2] = arm.limits.upper[2] + 0.4
    tip = arm.fkm(q)
    assert nearest_pose(arm, tip, q).position_error < 1e-8
    found = nearest_pose(arm, arm.fkm(beyond), q)
    # the least error that many other searches find is no less
    others = arm.solve(
        np.tile(arm.fkm(beyond), (50, 1)), np.random.default_rng(SEED).uniform(-1, 1, (50, 5)), restarts=0
    )
    least = np.hypot(others.position_error, 0.3 * others.orientation_error).min()
    assert 1e-3 < math.hypot(found.position_error, 0.3 * found.orientation_error) <= least + 1e-9
    assert found.held_by
    assert all("limit" in each for each in found.held_by)
    assert ((found.q >= arm.limits.lower) & (found.q <= arm.limits.upper)).all()


def test_a_goal_above_the_arm_is_refused_with_the_nearest_pose():
    robot = BODIES["differential"]
    with pytest.raises(UnreachableGoalError, match=r"the nearest found within all limits is .* mm") as caught:
        DriveTo.pose(robot, HOME, dqc.algebra.pose([1, 0, 0, 0], [1, 1, 1.5]))
    assert caught.value.nearest.position_error > 0.5


def test_bad_input():
    robot, car = BODIES["differential"], BODIES["car-like"]
    with pytest.raises(Error, match="acceleration: expected 7 numbers, one an input, got 3"):
        DriveTo(robot, HOME, HOME, acceleration=[1, 1, 1])
    with pytest.raises(Error, match="acceleration: must be > 0, got -1"):
        DriveTo(robot, HOME, HOME, acceleration=-1)
    with pytest.raises(Error, match="via: expected a robot with one base, which turns on the spot"):
        DriveTo(car, HOME, HOME, via=[[1, 1]])
    with pytest.raises(ValueRangeError, match="car-like steers; plan with its form 'constrained'"):
        DriveTo(car.in_form("unconstrained"), HOME, HOME)
    with pytest.raises(Error, match=r"via\[0\]"):
        DriveTo(robot, HOME, HOME, via=[[1, 1, 1]])


def test_check_says_why_a_goal_is_out_of_reach():
    spec = {
        "name": "high",
        "robot": "little-john",
        "start": HOME.tolist(),
        "reference": {"kind": "drive-to", "offset": {"translation": [1, 0.5, 0.4]}, "acceleration": 2.0},
        "period": 0.05,
        "law": {"kind": "guided-proportional", "gain": 1.0},
        "plant": {"kind": "integrator"},
    }
    with pytest.raises(
        Error, match=r"unreachable: .* beyond the reach of little-john; the nearest found within"
    ):
        dqc.experiments.check(spec)
