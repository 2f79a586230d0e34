"""Random goals: within what was asked for, all of it, and the same each time."""

import math

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.errors import ValueRangeError
from dqcontrol.references import random_goals

START = np.array([0.3, -0.2, 0.5, 0, -0.9, 0.9, 0.9, 0])


def test_they_fill_the_ranges_asked_for():
    robot = dqc.load_robot("little-john")
    found = random_goals(robot, START, 2000, reach=1.5, heading=0.8, arm=2.0, lowest=-math.inf, seed=3)
    expected = np.array([1.5, 1.5, 0.8, 2, 2, 2, 2, 2])
    lower = np.maximum(START - expected, robot.limits.lower)
    upper = np.minimum(START + expected, robot.limits.upper)
    assert (found >= lower).all()
    assert (found <= upper).all()
    np.testing.assert_allclose(found.mean(axis=0), (lower + upper) / 2, atol=0.1)
    np.testing.assert_allclose(found.std(axis=0), (upper - lower) / math.sqrt(12), rtol=0.05)


def test_the_hand_is_high_enough_and_the_seed_decides():
    robot = dqc.load_robot("little-john")
    found = random_goals(robot, START, 50, reach=0.5, lowest=0.4, seed=1)
    assert algebra.translation(robot.fkm(found))[:, 2].min() >= 0.4
    np.testing.assert_array_equal(found, random_goals(robot, START, 50, reach=0.5, lowest=0.4, seed=1))
    np.testing.assert_array_equal(found[:7], random_goals(robot, START, 7, reach=0.5, lowest=0.4, seed=1))
    assert not np.array_equal(found, random_goals(robot, START, 50, reach=0.5, lowest=0.4, seed=2))


def test_arms_stay_within_their_limits():
    arm = dqc.load_robot("iiwa7")
    found = random_goals(arm, np.zeros(7), 20, reach=1.0)
    assert ((found >= arm.limits.lower) & (found <= arm.limits.upper)).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reach": -1.0}, "reach: must be ≥ 0, got -1"),
        ({"arm": float("nan")}, "arm: must be finite"),
        ({"lowest": 3.0}, "lowest: 3 m is higher than the end effector comes"),
        ({"start": START + 3, "arm": 0.1}, "start: joint_1 is outside its limits"),
        ({"reach": math.inf}, "reach: must be finite"),
    ],
)
def test_bad_input(changes, message):
    with pytest.raises(ValueRangeError, match=message):
        random_goals(dqc.load_robot("little-john"), **{"start": START, "count": 5, "reach": 0.5} | changes)
