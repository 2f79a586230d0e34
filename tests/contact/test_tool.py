"""A tool found from noisy readings, judged by the force it leaves in other poses."""

import numpy as np
import pytest

from dqcontrol import algebra
from dqcontrol.contact import identify_tool, tool_orientations
from dqcontrol.errors import Error

MASS, CENTER = 1.2, np.array([0.01, -0.02, 0.06])
FORCE, TORQUE = np.array([0.4, -0.3, 0.8]), np.array([0.02, -0.01, 0.03])


def readings(turns, rng=None, count=1):
    poses = [algebra.pose(turn, [0.4, 0.1, 0.3]) for turn in turns]
    wrenches = []
    for pose in poses:
        weight = MASS * algebra.matrix_from_pose(pose)[:3, :3].T @ [0, 0, -9.81]
        true = np.concatenate([weight + FORCE, np.cross(CENTER, weight) + TORQUE])
        noise = 0.0
        if rng is not None:
            noise = (rng.standard_normal((count, 6)) * np.repeat([0.5, 0.02], 3)).mean(axis=0)
        wrenches.append(true + noise)
    return np.array(poses), np.array(wrenches)


def random_turns(rng, count):
    turns = rng.standard_normal((count, 4))
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


def test_exact_without_noise():
    rng = np.random.default_rng(0)
    for turns in (tool_orientations(), random_turns(rng, 30)):
        found = identify_tool(*readings(turns))
        assert abs(found.tool.mass - MASS) < 1e-12
        assert np.abs(found.tool.center - CENTER).max() < 1e-12
        assert np.abs(found.tool.force_bias - FORCE).max() < 1e-12
        assert np.abs(found.tool.torque_bias - TORQUE).max() < 1e-12
    assert max(found.force_condition, found.torque_condition) < 2


def test_six_poses_of_a_hundred_readings_leave_little_in_others():
    """Root mean square over tools of the 0.05 N and 0.005 N·m that are wanted."""
    rng, force, torque = np.random.default_rng(1), [], []
    for _ in range(50):
        tool = identify_tool(*readings(tool_orientations(), rng, 100)).tool
        for pose, wrench in zip(*readings(random_turns(rng, 10)), strict=True):
            weight = tool.mass * algebra.matrix_from_pose(pose)[:3, :3].T @ [0, 0, -9.81]
            force.append(np.sum((wrench[:3] - weight - tool.force_bias) ** 2) / 3)
            torque.append(np.sum((wrench[3:] - np.cross(tool.center, weight) - tool.torque_bias) ** 2) / 3)
    assert np.sqrt(np.mean(force)) < 0.05
    assert np.sqrt(np.mean(torque)) < 0.005


@pytest.mark.parametrize(
    ("turns", "text"),
    [
        ([algebra.rotation_from_rpy([a, b, 0])[:4] for a in (-0.2, 0, 0.2) for b in (-0.2, 0.2)], "too much alike"),
        (tool_orientations()[:2], "too much alike"),
        (tool_orientations()[:1], "too much alike"),
    ],
)  # fmt: skip
def test_poses_that_tell_too_little_are_refused(turns, text):
    with pytest.raises(Error, match=text):
        identify_tool(*readings(turns))


def test_wrenches_of_the_wrong_sign_or_number_are_refused():
    poses, wrenches = readings(tool_orientations())
    with pytest.raises(Error, match=r"mass comes out as -1\.2 kg"):
        identify_tool(poses, -wrenches)
    with pytest.raises(Error, match="wrenches: expected one a pose"):
        identify_tool(poses, wrenches[:4])
