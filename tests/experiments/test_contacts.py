"""Hands that go through the floor or through their own base are told of, before and after."""

import math
import warnings

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.compiled.compile import Kernel
from dqcontrol.errors import CollisionWarning
from dqcontrol.experiments import run
from dqcontrol.experiments.contact_kernels import pair_distances
from dqcontrol.experiments.contacts import Contacts
from dqcontrol.loop import Record

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
    assert before == ("reference: at t = 0 s the hand shall be 27 mm below the floor (z = 0)")
    assert after.startswith("proportional · servo: through the floor: link_5 −3")
    assert done.verdict.failure == "contact"


def test_a_goal_above_is_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error", CollisionWarning)
        done = run(spec(0.15))
    assert done.verdict.failure == ""


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


@pytest.mark.parametrize(
    ("point", "depth"),
    [
        ([0.0, 0, 0.05], 0.03),
        ([0.0, 0, 0.1], None),
        ([0.15, 0, 0.05], 0.015),
        ([0.2, 0, 0.05], None),
    ],
)
def test_a_hand_inside_its_own_chassis_is_found(point, depth):
    """Of little-john, whose chassis is a disc from 20 to 95 mm of 165 mm radius."""
    robot = dqc.load_robot("little-john")
    pose = np.tile(dqc.algebra.pose([1.0, 0, 0, 0], point), (2, 1))
    still = np.zeros((2, 8))
    q = still + np.array(START)
    desired = np.hstack([pose, np.zeros((2, 13))])
    record = Record(
        np.array([0.0, 1.0]), q, q, still[:, :7], pose, desired, robot.joint_names, robot.input_names
    )
    found = [each for each in Contacts(robot).of_run(record) if each.words.startswith("in its own base")]
    assert [each.depth for each in found] == ([] if depth is None else [pytest.approx(depth)])


def test_a_run_beside_one_that_touched_nothing_is_looked_at_where_it_goes_farther():
    robot, home = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    free = home + 0.1 * np.sin(np.linspace(0, 6, 300))[:, None]
    low = free.copy()
    low[100:200] += np.array([0, 1.4, 0, -1.6, 0, -0.6, 0])  # stretched, and below the floor
    contacts, found = Contacts(robot), []
    for q in (free, free + 0.01, low, free):
        samples = np.hstack([robot.fkm(q), np.zeros((300, 13))])
        record = Record(np.arange(300.0), q, q, q, robot.fkm(q), samples, robot.joint_names)
        assert contacts._has_room(q) == (len(found) in (1, 3))
        found.append(contacts.of_run(record))
        assert found[-1] == Contacts(robot).of_run(record)
    assert [bool(each) for each in found] == [False, False, True, False]


def test_python_finds_the_distances_that_machine_code_finds(monkeypatch):
    robot = dqc.load_robot("panda")
    contacts = Contacts(robot)
    q = np.random.default_rng(4).uniform(robot.limits.lower, robot.limits.upper, (20, 7))
    found = []
    for few in (0, math.inf):
        seldom = Kernel(pair_distances.function, pair_distances.signature)
        monkeypatch.setattr("dqcontrol.experiments.contacts.pair_distances", seldom)
        monkeypatch.setattr("dqcontrol.experiments.contacts._FEW", few)
        monkeypatch.setattr(Kernel, "_is_kept", False)
        found.append(contacts._distances(q, np.arange(20.0)))
        assert ("compiled" in vars(seldom)) == (few == 0)
    assert np.ptp(found[0]) > 1.0
    np.testing.assert_allclose(*found, atol=1e-12)
