"""Motors that tire: torques of the links' weight, patience, and what stays afterwards."""

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ShapeError
from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol_theses.variants import TiringMotors
from dqcontrol_theses.variants.tiring_motors import GRAVITY

ARM = 3  # coordinate of the arm's first joint


@pytest.fixture(scope="module")
def body():
    return dqc.load_robot("little-john")


def potential(plant, robot, q):
    frames = robot.frames(q)[ARM:]
    heights = dqc.algebra.translation(frames)[:, 2]
    ahead = dqc.algebra.multiply(frames[-1], dqc.algebra.pose([1.0, 0, 0, 0], [plant.hand, 0, 0]))
    middles = [*(0.5 * (heights[:4] + heights[1:5])), dqc.algebra.translation(ahead)[2]]
    return GRAVITY * float(np.dot(plant.masses, middles))


def test_gravity_torques_are_the_slope_of_the_potential(body):
    plant, rng = TiringMotors(), np.random.default_rng(5)
    print("seed 5")
    for q in rng.uniform(-1, 1, (5, 8)):
        steps = 1e-6 * np.eye(8)[ARM:]
        slopes = [
            (potential(plant, body, q + step) - potential(plant, body, q - step)) / 2e-6 for step in steps
        ]
        np.testing.assert_allclose(plant.gravity_torques(body, q), np.abs(slopes), atol=1e-7)


def test_motors_give_up_after_their_patience_and_stay(body):
    live = TiringMotors(torque=0.8, patience=0.5).start(body, np.zeros(8), 0.1, 100, 0)  # stretched forward
    command = np.array([0, 0, 0, 0.1, 0, 0, 0])
    for _ in range(20):
        live.step(command)
    assert live.fault == "joint_2 gave up"
    stopped = live.q[4]
    assert 0.04 < stopped < 0.08
    live.step(command)
    assert live.q[4] == stopped


def test_specs_name_them():
    spec = {
        "name": "tired",
        "robot": "little-john",
        "start": [0, 0, 0, 0, 0, 0, 0, 0],
        "period": 0.05,
        "reference": {"kind": "set-point", "duration": 2},
        "law": {"kind": "feedback-linearization", "stiffness": 0.6, "damping": 0.5},
        "plant": {"kind": "tiring-motors", "torque": 0.5},
    }
    assert prepare(spec).cases[0].plant == TiringMotors(torque=0.5)


def test_more_masses_than_joints(body):
    with pytest.raises(ShapeError, match=r"^plant.masses: little-john has 8 joints, got 9 masses"):
        TiringMotors(masses=[0.1] * 9).start(body, np.zeros(8), 0.1, 1, 0)
