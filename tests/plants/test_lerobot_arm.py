"""Arms of LeRobot: the driver against a double of LeRobot; with LeRobot itself in tests/lerobot."""

import lerobot_double
import numpy as np
import pytest
from robot_doubles import own_address

import dqcontrol as dqc
from dqcontrol.errors import Error, ShapeError, UnknownNameError, ValueRangeError
from dqcontrol.experiments import run_in_real_time
from dqcontrol.plants import LeRobotArm

ROBOT = "example-robot-data:so_arm_description/urdf/so101.urdf"
START = [0.0, -0.5, 0.8, 0.4, 0.0]
ARM = {"type": "so101_follower", "port": f"/dev/{own_address()}"}  # one lock a process of the tests
SPEC = {
    "name": "so101", "robot": ROBOT, "start": START, "period": 0.02,
    "reference": {"kind": "circle", "radius": 0.02, "duration": 2.0, "plane": "xz"},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "supervisor": {"stale_after": 1.0, "frozen_after": 1.0},  # a loaded machine wakes this process late
    "plant": {"kind": "lerobot", "robot": ARM, "timeout": 1.0},
}  # fmt: skip


@pytest.fixture
def follower(monkeypatch):
    pytest.importorskip("cmeel", reason="the file of an SO-101 comes with example-robot-data")
    double = lerobot_double.install(monkeypatch)
    monkeypatch.setattr(double, "start", [*np.degrees(START), 30.0])
    return double


def started(start=START, **options):
    plant = LeRobotArm(**{"robot": ARM, "timeout": 1.0, **options})
    return plant.start(dqc.load_robot(ROBOT), np.array(start), 0.02, 10, 0)


def test_a_spec_runs_in_degrees_and_leaves_the_gripper_alone(follower, tmp_path):
    done = run_in_real_time(SPEC, tmp_path / "run", figures=False)
    arm = follower.last
    assert done.record.stopped == "duration"
    assert done.record.q.std(axis=0).max() > 0.01
    assert done.record.position_error.max() < 0.02
    assert not any("gripper.pos" in action for action in arm.sent)
    assert arm.q[5] == 30.0
    assert (arm.is_connected, arm.config.disable_torque_on_disconnect) == (False, False)
    np.testing.assert_allclose(arm.q[:5], np.degrees(done.record.q[-1]), atol=1.0)


def test_a_bus_that_fails_is_a_fault(follower):
    live = started()
    live.step(np.full(5, 0.1))
    follower.last.fails = "There is no status packet!"
    live.step(np.full(5, 0.1))
    assert live.fault.endswith("There is no status packet!")
    live.close()


def refused(error, words, **options):
    with pytest.raises(error, match=words):
        started(**options)
    assert lerobot_double.Follower.last is None or not lerobot_double.Follower.last.sent


def test_what_is_wrong_is_said_in_one_line_and_nothing_moves(follower, monkeypatch):
    refused(ValueRangeError, "must lie in", start=np.degrees(START))
    refused(ShapeError, "plant.joints: expected 5 names, got 2", joints=["a", "b"])
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_flex", "wrist_roll"]
    refused(UnknownNameError, "plant.joints: no 'elbow' on it", joints=names)
    refused(UnknownNameError, "LeRobot has no 'so102'", robot={"type": "so102"})
    refused(ValueRangeError, "needs 'type'", robot={"port": "/dev/ttyACM0"})
    refused(ValueRangeError, "use_degrees: must be true", robot={**ARM, "use_degrees": False})
    refused(ValueRangeError, "stands elsewhere: joint 1 .* at 0, not at 0.3", start=[0.3, *START[1:]])
    monkeypatch.setattr(follower, "calibrated", False)
    refused(Error, "is not calibrated")
    monkeypatch.setattr(follower, "there", False)
    refused(Error, "Failed to open port")


def test_an_arm_that_moves_is_left_alone(follower, monkeypatch):
    made = follower.__init__

    def moving(self, config):
        made(self, config)
        self.drift = 10.0

    monkeypatch.setattr(follower, "__init__", moving)
    refused(Error, r"moves, joint . .* at 0\.\d+ rad/s; it must stand")
