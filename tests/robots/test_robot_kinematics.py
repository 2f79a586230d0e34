"""LeRobot's interface to kinematics: the same poses as the robot's, and calm where a target leads out of reach."""

import re
from pathlib import Path

import numpy as np
import pytest

from dqcontrol import algebra
from dqcontrol.errors import ShapeError, ValueRangeError
from dqcontrol.robots import RobotKinematics, load_robot

ARM = str(Path(__file__).parents[2] / "examples/robots/six-axis.urdf")
Q = np.array([0.0, 24, 98, 0, 58, 0])
BACK = 3.0  # degrees: a joint that turns so far against a step as far before swings to and fro


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return an arm as fast as the SO-101 is said to be."""
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    text = re.sub('velocity="[0-9.]+"', 'velocity="10"', Path(ARM).read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    return str(file)


@pytest.fixture(scope="module")
def arm(path):
    return RobotKinematics(path, "tool")


def led(arm, goals, q, **weights):
    """Return the angles of all frames, each begun where the last one ended."""
    out = [np.array(q, float)]
    for goal in goals:
        out.append(arm.inverse_kinematics(out[-1], goal, **weights))
    return np.array(out)


def out_and_back(start, way, frames=60):
    goals = np.tile(start, (2 * frames, 1, 1))
    goals[:, :3, 3] += np.concatenate([np.linspace(0, 1, frames), np.linspace(1, 0, frames)])[:, None] * way
    return goals


def away(arm, q, goal):
    return 1e3 * np.linalg.norm(arm.forward_kinematics(q)[:3, 3] - goal[:3, 3])


def test_poses_are_those_of_the_robot(arm):
    robot, rng = load_robot(ARM, tip_link="tool"), np.random.default_rng(0)
    for _ in range(10):
        q = rng.uniform(-90, 90, 6)
        expected = robot.fkm(np.deg2rad(q))
        found = arm.forward_kinematics([*q, 17.0])  # what follows the joints does not count
        np.testing.assert_allclose(found, algebra.matrix_from_pose(expected), atol=1e-12)


@pytest.mark.parametrize("weight", [0.01, 1.0])
def test_steps_in_reach_arrive_within_three_frames(arm, weight):
    """As lerobot#3613 asks: 100 mm, of which one Newton step at a time leaves 29."""
    start = arm.forward_kinematics(Q)
    for way in ([-0.1, 0, 0], [0, 0.1, 0], [0, 0, -0.1], [-0.06, 0.06, 0.05]):
        goal = start.copy()
        goal[:3, 3] += way
        q = led(arm, [goal] * 3, Q, orientation_weight=weight)[-1]
        assert away(arm, q, goal) < 1e-3  # mm


@pytest.mark.parametrize("weight", [0.0, 0.01, 1.0])
@pytest.mark.parametrize("way", [[0.8, 0.1, 0.2], [0.5, -0.6, 0.4], [0, 0, 1.0]])
def test_no_joint_swings_to_and_fro_out_of_reach(arm, weight, way):
    """As in lerobot#1966: led out of reach and back."""
    start = arm.forward_kinematics(Q)
    goals = np.concatenate([out_and_back(start, way), np.tile(start, (5, 1, 1))])
    q = led(arm, goals, Q, orientation_weight=weight)
    steps = np.diff(q, axis=0)
    most = np.rad2deg(arm.robot.limits.velocity) / 30
    assert (np.abs(steps) <= most + 1e-9).all()
    left = np.array([away(arm, each, goal) for each, goal in zip(q[1:], goals, strict=True)])
    turned = (steps[1:] * steps[:-1] < 0) & (np.minimum(np.abs(steps[1:]), np.abs(steps[:-1])) > BACK)
    # Out of reach is what was so on the way out: at the edge, stretched, joints must turn fast and back.
    way_off = np.linalg.norm(goals[1:, :3, 3] - start[:3, 3], axis=1)
    beyond = way_off > way_off[np.flatnonzero(left > 1.0)[0] + 2]
    assert beyond.sum() > 20
    assert turned[beyond].sum() == 0
    assert away(arm, q[-1], start) < 1.0


def test_limits_hold_and_what_follows_the_joints_stays(arm):
    goal = arm.forward_kinematics(Q)
    goal[:3, 3] = [-0.3, 0.3, 0.1]
    q = led(arm, [goal] * 60, [*Q, 42.0])
    limits = arm.robot.limits
    assert (np.deg2rad(q[:, :6]) >= limits.lower - 1e-9).all()
    assert (np.deg2rad(q[:, :6]) <= limits.upper + 1e-9).all()
    assert (q[:, 6] == 42.0).all()


def test_another_order_of_the_joints(arm, path):
    names = list(reversed(arm.joint_names))
    turned = RobotKinematics(path, "tool", names)
    np.testing.assert_array_equal(turned.forward_kinematics(Q[::-1]), arm.forward_kinematics(Q))
    goal = arm.forward_kinematics(Q + 3)
    np.testing.assert_allclose(
        turned.inverse_kinematics(Q[::-1], goal)[::-1], arm.inverse_kinematics(Q, goal)
    )


def test_bad_input(arm):
    with pytest.raises(ShapeError, match="joint_names: expected those of the chain"):
        RobotKinematics(ARM, "tool", ["a", "b"])
    with pytest.raises(ShapeError, match="joint_pos: expected 6 angles or more, got 2"):
        arm.forward_kinematics([0, 0])
    with pytest.raises(ValueRangeError, match="position_weight, orientation_weight: must be > 0 and ≥ 0"):
        arm.inverse_kinematics(Q, np.eye(4), position_weight=0)
    with pytest.raises(ValueRangeError, match="desired_ee_pose"):
        arm.inverse_kinematics(Q, np.full((4, 4), np.nan))
    with pytest.raises(ShapeError, match="is no arm of one chain"):
        RobotKinematics("two-pandas")
