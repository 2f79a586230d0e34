"""Hands that go through the floor or through their own base are told of, before and after."""

import warnings

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import CollisionWarning
from dqcontrol.experiments import run
from dqcontrol.experiments.clearance import hand_clearance

START = [0, 0, 0, 0, -0.5, 1.4, 0, 0]


def spec(height, start=START):
    robot = dqc.load_robot("little-john")
    position = dqc.algebra.translation(robot.fkm(np.array(start, dtype=float)))
    goal = [float(position[0]) + 0.3, float(position[1]), height]
    return {
        "name": "low",
        "robot": "little-john",
        "start": start,
        "period": 0.02,
        "reference": {"kind": "set-point", "duration": 6, "start": {"position": goal}},
        "law": {"kind": "proportional", "gain": 2},
        "plant": {"kind": "servo"},
        "limits": {"velocity": True},
    }


def test_a_goal_below_the_floor_is_said_before_and_in_the_run():
    with pytest.warns(CollisionWarning) as said:
        done = run(spec(-0.027))
    before, after = (str(each.message) for each in said)
    assert before == (
        "reference: at t = 0 s the hand shall be 27 mm below the floor (z = 0), which does not stop it"
    )
    assert after.startswith("proportional · servo: through the floor: link_5 −3")
    assert done.verdict.failure == "contact"
    assert done.metrics.hand_clearance == pytest.approx(done.record.position[:, 2].min())
    assert done.metrics.hand_clearance < -0.02


def test_a_goal_above_is_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error", CollisionWarning)
        done = run(spec(0.15))
    assert done.metrics.hand_clearance > 0.1


def test_a_hand_that_rests_on_the_floor_goes_through_nothing():
    scara = dqc.SerialArm.from_dh(
        theta=[0, 0, 0], d=[0.2, 0, 0.1], a=[0.4, 0.3, 0], alpha=[0, np.pi, 0],
        joint_types=["revolute", "revolute", "prismatic"], name="scara",
    )  # fmt: skip
    still = {
        "name": "still",
        "robot": scara,
        "start": [0.3, 0.4, 0.1],
        "period": 0.01,
        "reference": {"kind": "set-point", "duration": 0.2},
        "law": {"kind": "partial-proportional", "part": "position", "gain": 4.0},
        "plant": {"kind": "servo"},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error", CollisionWarning)
        done = run(still)
    assert -1e-9 < done.record.position[:, 2].min() < 0


def test_the_chassis_counts_and_arms_have_no_floor():
    robot = dqc.load_robot("little-john")
    points = np.array([[0.0, 0, 0.05], [0.0, 0, 0.1], [0.2, 0, 0.05], [0.3, 0, -0.01]])
    wanted = [-0.03, 0.005, 0.035, -0.01]
    assert hand_clearance(robot, np.zeros((4, 8)), points) == pytest.approx(wanted)
    assert np.isinf(hand_clearance(dqc.load_robot("iiwa7"), np.zeros((4, 7)), points)).all()
