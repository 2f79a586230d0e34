"""What a verdict says of a recording, breach by breach: what happened is written into the samples."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol.experiments.verdict import Judge
from dqcontrol.loop import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.metrics import metrics_of
from dqcontrol.measures.task_result import task_result
from dqcontrol.plants import Integrator, MobilePlant
from dqcontrol.plants.mujoco.gripper import Gripper, GripperEvent
from dqcontrol.supervisor import KeepOutZones, Supervisor, WorkspaceBox
from dqcontrol.world import Body, World

TIME = np.linspace(0.0, 2.0, 201)
ARM, START = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
BASE, STANDS = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.5, 1.4, 0, 0])


def recorded(robot, q, command=None, **readings):
    """Return a run through configurations, (N, n) or one, whose hand is where it shall be at each sample."""
    q = np.array(np.broadcast_to(q, (len(TIME), robot.configuration_size)))
    pose = robot.fkm(q)
    desired = np.hstack([pose, np.zeros((len(TIME), 13))])
    command = np.zeros((len(TIME), robot.input_size)) if command is None else command
    signals = {
        name: Signal(
            name, tuple(f"{name} {k}" for k in range(values.shape[1])), ("m",) * values.shape[1], values
        )
        for name, values in readings.items()
    }
    return Record(TIME, q, q, command, pose, desired, robot.joint_names, robot.input_names, readings=signals)


def said(record, robot, plant=None, *, supervisor=None, world=None):
    """Return the words on a run, and in what way it failed."""
    result = task_result(record, robot=robot)
    asked = {"reference": None, "period": 1.0, "surroundings": world, "outcome": None}
    spec = SimpleNamespace(supervisor_of=lambda _: supervisor, **asked)
    return Judge(robot, None, plant or Integrator(), spec).verdict(
        record, metrics_of(record, result, robot.limits, 0.0), result
    )


PRESSED = {"contact_force": 14.0, "penetration": 1.4e-3, "contact_link": 6.0}


def to_and_fro(size):
    """Return numbers that go from 0 to a size, at 1 s, and back, shape (N,)."""
    return size * np.sin(0.5 * np.pi * TIME) ** 2


def test_a_base_in_a_zone_of_the_supervisor():
    q = STANDS + np.outer(to_and_fro(0.5), np.eye(8)[0])
    stairs = Body(cylinder=(0.2, 1.0), position=(0.8, 0.0, 0.5))
    zones = KeepOutZones(world=World(bodies={"stairs": stairs}), footprint=0.17)
    words, failure = said(recorded(BASE, q), BASE, supervisor=Supervisor(keep_out=zones))
    assert words == "crossed: stairs −70 mm (base) at 1 s; reached"
    assert failure == "crossed"


def test_a_hand_outside_the_box_of_the_supervisor():
    q = START + np.outer(to_and_fro(-0.3), np.eye(7)[0])
    record = recorded(ARM, q)
    y = record.position[:, 1]
    box = WorkspaceBox(lower=(-2, -2, -2), upper=(2, float(y.max()) - 0.1, 2))
    words, failure = said(record, ARM, supervisor=Supervisor(workspace=box))
    assert words == "crossed: workspace −100 mm (end effector) at 1 s; reached"
    assert failure == "crossed"


def test_joints_beyond_limits_of_position_and_velocity():
    beyond = START + np.outer(to_and_fro(ARM.limits.upper[3] - START[3] + 0.1), np.eye(7)[3])
    words, failure = said(recorded(ARM, beyond), ARM)
    assert words.startswith("beyond its limit: joint_4 by 5.7° at 1 s")
    assert failure == "limits"
    fast = np.outer(to_and_fro(2.0 * ARM.limits.velocity[1]), np.eye(7)[1])
    words, failure = said(recorded(ARM, START, fast), ARM)
    assert words == "too fast: joint_2 commanded at 200 % of its velocity limit at 1 s; reached"
    assert failure == "limits"


@pytest.mark.parametrize(
    ("opening", "place", "words", "failure"),
    [
        ([0.03] * 2, [0.6, 0.5, 0.05], "reached; placed 1 of 1; stands (tilt ≤ 0°)", ""),
        ([0.0] * 2, [0.6, 0.2, 0.015], "gripped nothing at 0.2 s; not placed: cube 220 mm ", "grip"),
        ([0.03, 0.0], [0.6, 0.2, 0.015], "dropped at 1.7 s; not placed: cube 220 mm from basket", "grip"),
        ([0.03] * 2, [0.6, 0.35, 0.015], "not placed: cube 70 mm from basket; reached", "grip"),
    ],
)
def test_what_was_to_be_gripped_and_placed(opening, place, words, failure):
    """The gripper closes from 0.2 s to 1.9 s; how far it is open up to 1.7 s, and then."""
    schedule = [GripperEvent(time=0.2, closed=True), GripperEvent(time=1.9, closed=False)]
    cube = Body(box=0.03, position=(0.6, 0.2, 0.015), mass=0.02)
    basket = Body(container=(0.16, 0.16, 0.08), position=(0.6, 0.5, 0.0))
    plant = MobilePlant(gripper=Gripper(closes="y", schedule=schedule))
    plant = plant.in_world(World(bodies={"cube": cube, "basket": basket}))
    width = np.select([TIME < 0.2, TIME < 1.7, TIME <= 1.9], [0.06, *opening], 0.06)[:, None]
    zero = np.zeros((len(TIME), 1))
    record = recorded(
        BASE,
        STANDS,
        gripper_opening=width,
        cube_position=np.tile(np.array(place, float), (len(TIME), 1)),
        tilt=zero,
        wheel_slip=zero,
    )
    found = said(record, BASE, plant=plant)
    assert found.words.startswith(words)
    assert found.failure == failure


def test_both_links_that_touch_each_other_are_named():
    press = {
        "contact_force": np.outer(to_and_fro(30.0), [1]),
        "penetration": np.outer(to_and_fro(2e-3), [1]),
        "contact_link": np.tile([5.0, 1.0], (len(TIME), 1)),
    }
    parts = {name: ("itself", "other")[: values.shape[1]] for name, values in press.items()}
    readings = {name: Signal(name, parts[name], ("",) * len(parts[name]), press[name]) for name in press}
    words, failure = said(replace(recorded(ARM, START), readings=readings), ARM)
    assert words.startswith("hit itself: link_6 and link_2 30 N, 2 mm deep at 1 s")
    assert failure == "contact"


def test_a_box_that_two_hands_let_go():
    force = np.where(TIME[:, None] < 1.2, 20.0, 0.0) * np.ones(2)
    words, failure = said(recorded(ARM, START, grip_force=force), ARM)
    assert words == "let go of the box at 1.2 s; reached"
    assert failure == "grip"


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        (
            {name: np.outer(to_and_fro(size), [1, 0]) for name, size in PRESSED.items()},
            "hit contact_force 0: link_7 14 N, 1.4 mm deep at 1 s; not reached: rests",
        ),
        (
            {"wheel_slip": np.outer(to_and_fro(0.4), [1, 0])},
            "slipping: wheels slide at up to 0.4 m/s, for ",
        ),
    ],
)
def test_why_a_goal_was_not_reached(readings, words):
    record = recorded(ARM, START, **readings)
    away = dqc.algebra.pose(record.pose[0, :4], np.add(record.position[0], [0, 0, 0.1]))
    desired = np.hstack([np.tile(away, (len(TIME), 1)), np.zeros((len(TIME), 13))])
    record = Record(
        TIME, record.q, record.q, record.command, record.pose, desired, ARM.joint_names, readings=record.readings
    )  # fmt: skip
    pad = Body(sphere=0.1, position=(5, 0, 0), stiffness=1e4)
    words_, failure = said(record, ARM, world=World(bodies={"contact_force 0": pad}))
    assert words_.startswith(words)
    assert failure == "task"
