"""Links of mobile manipulators touch tables, walls, the floor and each other in MuJoCo."""

import re
from typing import Any

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.errors import ValueRangeError
from dqcontrol.geometry import Capsule
from dqcontrol.plants import Gripper, MobilePlant
from dqcontrol.world import Body

mujoco: Any = pytest.importorskip("mujoco")

T = 0.02
HOME = [0.0, 0.0, 0.0, 0.0, -0.504, 1.397, 0.0, 0.0]
LITTLE_JOHN = dqc.load_robot("little-john")
SHAPES = LITTLE_JOHN.shapes
assert SHAPES is not None
AWAY = {"post": Body(box=0.1, position=(9, 9, 0.05))}


def among(robot, q0, bodies=AWAY, **keys):
    return MobilePlant(world=dqc.World(bodies=bodies), **keys).start(robot, np.array(q0), T, 100, 0)


@pytest.mark.parametrize("robot", [LITTLE_JOHN, dqc.load_robot("examples/robots/arms-on-wheels.yaml")])
def test_shapes_are_where_constraints_have_them(robot):
    home = HOME if len(HOME) == robot.configuration_size else ARMS
    live = among(robot, home)
    for q in np.random.default_rng(1).uniform(-0.3, 0.3, (5, robot.configuration_size)) + home:
        live.place(q)
        mujoco.mj_kinematics(live.model, live.data)
        for each, shape in zip(robot.shapes.shapes, robot.shapes.moved(robot, q), strict=True):
            if each.frame > 3:
                assert isinstance(shape, Capsule)
                there = live.data.geom(f"link: {each.name}").xpos
                assert there == pytest.approx(0.5 * (shape.start + shape.end), abs=1e-9)


ARMS = [0, 0, 0, -0.1, -0.5, 0.1, -2.2, 0.1, 1.7, 0.8, 0.3, -0.7, -0.2, -2.1, -0.1, 1.5, 0.7]


def spec(move, world, start=HOME, **keys):
    return {
        "name": "mobile",
        "robot": "little-john",
        "start": start,
        "period": T,
        "reference": {"kind": "set-point", "offset": {"translation": move}, "duration": 3.0},
        "law": {"kind": "proportional", "gain": 2, "inverse": {"kind": "damped", "damping": 0.05}},
        "plant": {"kind": "mobile"},
        "world": world,
        **keys,
    }


SCENES = {
    "table": (
        spec([0, 0, -0.15], {"table": {"box": [0.3, 0.6, 0.04], "position": [0.5, 0, 0.11]}}),
        r"hit table: link_\d [\d.]+ N, [\d.]+ mm deep at [\d.]+ s",
    ),
    "wall": (
        spec([0.5, 0, 0], {"wall": {"box": [0.1, 2, 1], "position": [0.6, 0, 0.5]}}),
        r"hit wall: link_\d [\d.]+ N",
    ),
    "chassis against a wall": (
        spec([0.6, 0, 0], {"step": {"box": [0.1, 2, 0.1], "position": [0.6, 0, 0.05]}}),
        r"hit step: chassis [\d.]+ N",
    ),
    "floor": (spec([0, 0, -0.2], {"floor": True}), r"hit floor: link_5 [\d.]+ N"),
}


@pytest.mark.parametrize("scene", SCENES)
def test_what_an_arm_on_wheels_hits_is_said(scene):
    given, words = SCENES[scene]
    verdict = dqc.run(given).verdict
    assert re.search(words, verdict.words), verdict.words
    assert verdict.failure == "contact"


def test_the_table_holds_the_arm():
    """What the servos press with is what the table bears; the arm stays above it."""
    table = Body(box=[0.3, 0.6, 0.04], position=(0.45, 0, 0.11))
    live = among(LITTLE_JOHN, HOME, {"table": table})
    for _ in range(100):
        live.step([0, 0, 0, 0.3, 0, 0, 0])  # the upper arm turns down
    found = dict(zip([channel.name for channel in live.channels], _split(live), strict=True))
    assert found["penetration"][0] < 5e-4
    assert found["contact_force"][0] > 1.0
    free = among(LITTLE_JOHN, HOME)
    for _ in range(100):
        free.step([0, 0, 0, 0.3, 0, 0, 0])
    assert live.q[4] < free.q[4] - 0.1


def _split(live):
    return np.split(live.readings, np.cumsum([channel.size for channel in live.channels])[:-1])


def test_a_link_stops_at_another_one():
    """The forearm folds until it lies against the first link."""
    live, free = among(LITTLE_JOHN, HOME), MobilePlant().start(LITTLE_JOHN, np.array(HOME), T, 200, 0)
    for each in (live, free):
        for _ in range(150):
            each.step([0, 0, 0, 0, 0.5, 0, 0])
    found = dict(zip([channel.name for channel in live.channels], _split(live), strict=True))
    assert found["contact_force"][-1] > 1.0  # of itself
    assert found["penetration"][-1] < 5e-4
    assert {SHAPES.names[int(each)] for each in found["contact_link"][-2:]} == {"link_1", "link_5"}
    assert live.q[5] < free.q[5] - 0.1


def test_a_start_in_something_is_refused():
    hand = dqc.algebra.translation(LITTLE_JOHN.fkm(np.array(HOME)))
    with pytest.raises(ValueRangeError, match=r"start: link_5 is [\d.]+ mm deep in post; start elsewhere"):
        among(LITTLE_JOHN, HOME, {"post": Body(box=0.05, position=tuple(hand))})


def test_links_without_shapes_are_refused():
    arm = dqc.SerialArm.from_dh(theta=[0, 0], d=[0.3, 0], a=[0.1, 0.1], alpha=[0, 0])
    robot = dqc.WholeBody([LITTLE_JOHN.parts[0], arm])
    with pytest.raises(ValueRangeError, match="has no shapes to touch it with"):
        among(robot, np.zeros(5))


def test_a_link_ends_where_the_fingers_begin():
    """Little John's last capsule reaches to the hand's point, which lies between the fingers."""
    gripper = Gripper(closes="y")
    last, tool = SHAPES.shapes[-1].shape, LITTLE_JOHN.chain[-1]
    cut = gripper.behind_fingers(last, tool)
    assert cut.start == pytest.approx(last.start)
    assert np.linalg.norm(cut.end) + cut.radius == pytest.approx(0.17 + 0.012 - gripper.length)
    assert Gripper(closes="y", length=0.01).behind_fingers(last, tool) is last
