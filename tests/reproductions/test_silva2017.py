"""Silva 2017 again: what must hold whatever the machine, on short forms of the experiments."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import reproductions as published
from dqcontrol.reproductions.catalogue import Conditions
from dqcontrol.reproductions.silva2017 import EXPERIMENTS, motors
from dqcontrol.reproductions.silva2017 import clamping_experiment as clamping
from dqcontrol.reproductions.silva2017 import comparison_experiment as comparison
from dqcontrol.reproductions.silva2017.gains_experiment import damping_ratio
from dqcontrol.reproductions.silva2017.motors import TiringMotors, gravity_torques
from dqcontrol.reproductions.silva2017.race import matched_gain
from dqcontrol.reproductions.silva2017.specs import FOLDER, printed, setting_of

ONE = Conditions(jobs=1)


def verdicts(table):
    return {row[1]: (row[2], row[3]) for row in table.rows}


def test_it_is_in_the_catalogue():
    assert published.names("silva2017") == [f"silva2017/{name}" for name in EXPERIMENTS]
    assert {path.stem for path in (FOLDER / "specs").glob("*.yaml")} >= set(EXPERIMENTS) - {"pick-and-drop"}


def test_gains_are_far_from_oscillation():
    """ζ = k_v/√k̄ of [S17]'s five sets; none overshoots."""
    done = published.reproduce("silva2017/gains", jobs=1)
    table, claims = done.tables
    assert (
        min(row[1] for row in table.rows)
        == pytest.approx(damping_ratio(0.6, 1))
        == pytest.approx(1.29, abs=0.01)
    )
    assert max(row[4] for row in table.rows) < 0.1  # %
    found = [verdict for verdict, _ in verdicts(claims).values()]
    assert found == ["not supported", "supported", "supported", "not supported", "supported"]


def test_the_comparison_matches_settling_times_and_tells_ratios():
    done = comparison.reproduce(ONE, count=3)
    table = done.tables[0]
    rows = {str(row[0]).partition(":")[0]: row for row in table.rows}
    assert rows["classic, matched"][2] == pytest.approx(rows["nonlinear"][2], rel=0.05)
    assert rows["nonlinear"][6] < 0.1 * rows["classic"][6]
    assert (printed("comparison", "nonlinear", "effort"), printed("comparison", "classic", "effort")) == (
        4.8729,
        9.2067,
    )
    for box in done.tables[1:3]:
        assert [row[0] for row in box.rows][:4] == ["nonlinear", "nonlinear as printed", "classic", "cascade"]
        remedy = box.rows[4]
        assert remedy[1:3] == [3, 3], "the remedy reaches all"
    assert len(done.tables[3].rows) == 6
    assert "figure-5.4" in done.figures


def test_matched_gains():
    assert matched_gain(lambda k: 100 / k, 400) == pytest.approx(0.25, rel=0.05)
    assert matched_gain(lambda k: 100 / k, float("nan")) is None
    assert matched_gain(lambda k: 1e6, 10) is None


def test_the_printed_goal_is_the_one_of_the_spec_to_all_digits():
    """p_d, half angle 1.4π and n_d as printed, up to half of their last digits. [S17 5.2.3.1]"""
    setting = setting_of("clamping")
    pose = setting.scene.samples[0, :8]
    position = dqc.algebra.translation(pose)
    np.testing.assert_allclose(position, [0.08, 0.07, 0.33], atol=0.005)
    w, v = pose[0] * np.sign(-pose[0]), pose[1:4] * np.sign(-pose[0])
    half = 2 * np.pi - np.arccos(w)
    assert half / np.pi == pytest.approx(1.4, abs=0.05)
    np.testing.assert_allclose(v / np.sin(half), [-0.61, 0.11, 0.78], atol=0.005)
    robot = setting.scene.robot
    start = robot.fkm(setting.scene.start)
    np.testing.assert_allclose(dqc.algebra.translation(start), [0.17, 0, 0.34], atol=0.005)
    np.testing.assert_allclose(abs(start[3]), 1.0, atol=1e-9)
    reached = robot.fkm([-2.412, -1.456, -1.462, 1.972, -0.148])
    np.testing.assert_allclose(np.sign(pose[0] * reached[0]) * reached, pose, atol=1e-8)


def test_clamping_finds_the_closest_pose_and_comes_back():
    done = clamping.reproduce(ONE, count=2)
    rows = {row[0]: row for row in done.tables[0].rows}
    nearest = rows["nearest within the limits, by search"][1]
    assert rows["modified clamping"][1] == pytest.approx(nearest, rel=0.02)
    assert rows["modified clamping"][2] == 0.0
    assert rows["modified clamping"][4] < 1e-5 < rows["original clamping"][4]
    assert rows["no clamping"][2] > 0.1


def test_gravity_torques_are_the_slope_of_the_potential():
    robot = setting_of("clamping-robot").scene.robot
    rng = np.random.default_rng(5)
    print("seed 5")
    for q in rng.uniform(-1, 1, (5, 8)):
        expected = [
            abs(_potential(robot, q, i, 1e-6) - _potential(robot, q, i, -1e-6)) / 2e-6 for i in range(5)
        ]
        np.testing.assert_allclose(gravity_torques(robot, q), expected, atol=1e-7)


def _potential(robot, q, i, step):
    moved = q.copy()
    moved[motors.FIRST + i] += step
    frames = robot.frames(moved)[motors.FIRST :]
    heights = dqc.algebra.translation(frames)[:, 2]
    ahead = dqc.algebra.multiply(
        frames[-1], dqc.algebra.pose(np.array([1.0, 0, 0, 0]), np.array([0.085, 0, 0]))
    )
    middles = [*(0.5 * (heights[:4] + heights[1:5])), dqc.algebra.translation(ahead)[2]]
    return motors.GRAVITY * float(np.dot(motors.MASSES, middles))


def test_motors_give_up_after_their_patience_and_stay():
    robot = setting_of("clamping-robot").scene.robot
    q = np.array([0, 0, 0, 0, 0.0, 0, 0, 0])  # stretched forward
    live = TiringMotors(torque=0.8, patience=0.5).start(robot, q, 0.1, 100, 0)
    command = np.array([0, 0, 0, 0.1, 0, 0, 0])
    for _ in range(20):
        live.step(command)
    assert live.fault == "joint_2 gave up"
    stopped = live.q[4]
    assert 0.04 < stopped < 0.08
    live.step(command)
    assert live.q[4] == stopped


def test_clamping_spares_the_motors_and_periods_are_tried_at_their_limit():
    claims = verdicts(published.reproduce("silva2017/clamping-robot", jobs=1).tables[-1])
    assert [verdict for verdict, _ in claims.values()] == ["not supported", "supported"]
    periods, limit = published.reproduce("silva2017/discretisation", jobs=1).tables
    first = np.array([row[4] / row[0] for row in periods.rows])
    np.testing.assert_allclose(first, first[0], rtol=0.01)  # the first command is proportional to T
    below, above = limit.rows
    assert below[3] < 1e-9 < 1e-2 < above[3]
