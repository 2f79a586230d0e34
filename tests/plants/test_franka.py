"""Franka arms by ``franky`` and ``pylibfranka``: what only they have; the rest is in test_makers_arms.py."""

import subprocess
import sys
from importlib.util import find_spec

import pytest
from makers_arms import FRANKA

from dqcontrol.errors import Error

pytest.importorskip("franky", reason="franky-control has no wheel here")

NAIVE = """
import sys, numpy as np, pylibfranka, dqcontrol as dqc
start, panda = np.array({start}), dqc.load_robot("panda")
law = dqc.laws.Proportional(gain=5.0).prepare(panda, None, 0.001)
command, state, sample = np.zeros(7), law.initial_state(start), np.zeros(21)
sample[:8] = panda.fkm(start + 0.2)
law.step(start, sample, 0, state, command)  # compiled now
arm = pylibfranka.Robot(sys.argv[1], pylibfranka.RealtimeConfig.kIgnore)
control = arm.start_joint_velocity_control(pylibfranka.ControllerMode.JointImpedance)
try:
    for k in range(500):
        measured, _ = control.readOnce()
        law.step(np.array(measured.q), sample, k, state, command)
        control.writeOnce(pylibfranka.JointVelocities(command.tolist()))
except pylibfranka.ControlException as error:
    print(error)
"""


@pytest.fixture
def robot():
    with FRANKA.double_of() as double:
        yield double


def test_a_naive_loop_trips_it(robot):
    if find_spec("pylibfranka") is None:
        pytest.skip("pylibfranka has no wheel here")
    naive = [
        sys.executable,
        "-c",
        NAIVE.format(start=FRANKA.start),
        robot.host,
    ]  # one process takes one client
    said = subprocess.run(naive, capture_output=True, text=True, check=True, timeout=120).stdout
    assert "joint_motion_generator_velocity_discontinuity" in said
    assert robot.state()["fault"] == "joint_motion_generator_velocity_discontinuity"


def test_periods_that_franky_does_not_bear_are_refused(robot):
    FRANKA.refused(robot, Error, "period: must be 0.002 … 0.05 s", period=0.001)


def test_a_robot_that_is_stopped_is_left_alone(robot):
    robot.state(mode=5)
    FRANKA.refused(robot, Error, "robot mode UserStopped")


def test_another_version_is_left_alone():
    with FRANKA.double_of(version=9) as double:
        FRANKA.refused(double, Error, "[Ii]ncompatible")
