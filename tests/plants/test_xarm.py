"""xArms by their maker's SDK: what only they have; the rest is in test_makers_arms.py."""

import time

import numpy as np
import pytest
from makers_arms import XARM, XARM7

import dqcontrol as dqc
from dqcontrol.errors import Error

wrapper = pytest.importorskip("xarm.wrapper", reason="xarm-python-sdk is not installed")


@pytest.fixture
def robot():
    XARM.skip_without_client()
    with XARM.double_of() as double:
        yield double


def test_a_naive_loop_trips_it(robot):
    arm = dqc.load_robot(XARM7)
    law = dqc.laws.Proportional(gain=50.0).prepare(arm, None, 0.01)
    command, state, sample = np.zeros(7), law.initial_state(np.array(XARM.start)), np.zeros(21)
    sample[:8] = arm.fkm(np.array(XARM.start) + 0.4)
    client = wrapper.XArmAPI(robot.host, is_radian=True)
    client.motion_enable(enable=True)
    client.set_mode(1)
    client.set_state(0)
    client.set_servo_angle_j(XARM.start)
    for k in range(200):
        _, (q,) = client.get_joint_states(num=1)
        law.step(np.array(q), sample, k, state, command)
        if client.set_servo_angle_j((q + 0.01 * command).tolist()):
            break
        time.sleep(0.01)
    assert client.get_err_warn_code() == (0, [24, 0])  # speed exceeds limit
    client.disconnect()
    assert robot.state()["fault"] == "C24"


def test_velocities_beyond_the_arm_s_are_a_fault_with_its_name(robot):
    live = XARM.started(robot)
    robot.state(error=31)
    live.step(np.zeros(7))
    assert live.fault.endswith("error C31, Collision Caused Abnormal Current; clear it on the robot")
    live.close()


def test_somebody_who_takes_it_is_noticed(robot):
    live = XARM.started(robot)
    robot.state(mode=0)
    late = time.monotonic() + 30
    while not live.fault and time.monotonic() < late:
        live.step(np.zeros(7))
        time.sleep(0.01)
    assert "somebody else has taken or stopped it" in live.fault
    live.close()


def test_a_host_may_have_a_name(robot):
    with pytest.raises(Error, match="not known"):
        dqc.plants.XArm(host="no-such-arm.invalid").start(
            dqc.load_robot(XARM7), np.array(XARM.start), 0.01, 10, 0
        )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"error": 2}, "error C2, .*; clear it on the robot"),
        ({"version": "v1.8.103"}, "its firmware is 1.8.103; 1.9.0 is needed"),
    ],
)
def test_robots_that_refuse_are_left_alone(options, words):
    XARM.skip_without_client()
    with XARM.double_of(**options) as double:
        XARM.refused(double, Error, words)
