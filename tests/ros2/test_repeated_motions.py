"""Motions that tell servos, and learning from repetition, on a robot in another process."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from nodes import PATIENCE, PATIENT

import dqcontrol as dqc
from dqcontrol.errors import Error
from dqcontrol.ros2.repeated_motion import RobotBehindTopics, slow_time
from dqcontrol.ros2.tracked_hand import read_tracked

WAITS = ("--", "-p", "command_timeout:=0.5")  # a robot that does not brake where a busy machine is late
SERVO = {"kind": "servo", "time_constant": 0.06, "delay": 0.02}


@pytest.mark.slow
def test_servos_are_identified_from_a_motion_over_ros(start, tmp_path):
    """The delay that messages add is theirs: lag and delay together are the servo's and a period or two.

    Of a machine that lets processes wait the stamps are wrong, and some joints may be refused.
    """
    motion = dqc.excite("iiwa7", [0, 0.6, 0, 1.6, 0, 0.6, 0], duration=28, period=0.02, amplitude=0.2)
    motion.save(tmp_path / "excite")
    path = tmp_path / "excite" / "excite.yaml"
    spec = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(spec | {"plant": SERVO}))
    start("robot", path, *WAITS)
    out = tmp_path / "run"
    controller = start("controller", path, "--autostart", "--out", out, *PATIENT)
    log, _ = controller.communicate(timeout=PATIENCE)
    assert controller.returncode == 0, log
    found = dqc.identify(out / "record.mcap", "iiwa7")
    print(found, file=sys.stderr)
    assert len(found.fitted) >= 4, str(found)
    assert np.median([joint.lag for joint in found.fitted]) == pytest.approx(0.06, rel=0.15), str(found)
    assert 0.015 < np.median([joint.delay for joint in found.fitted]) < 0.08, str(found)


@pytest.mark.slow
def test_a_motion_is_learnt_over_ros_and_the_robot_goes_back_slowly(start, tmp_path):
    """The robot is another process that never starts anew: its joints end each repeat where the next one begins."""
    path = tmp_path / "learn.yaml"
    spec = {
        "name": "again",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.02,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 6, "ramp": 0.5},
        "law": {"kind": "proportional", "gain": 3},
        "plant": SERVO | {"delay": 0.03},
        "learn": {"uncertainty": {"lag": 0.2, "delay": 0.03}},
    }
    path.write_text(yaml.safe_dump(spec))
    start("robot", path, *WAITS)
    robot = RobotBehindTopics(tmp_path / "repeats", ros_arguments=PATIENT[1:])
    found = dqc.learn(path, 3, runner=robot)
    errors = [each.position for each in found.repeats]
    print(f"errors over ROS 2, mm: {errors}", file=sys.stderr)
    assert found.gain > 3, errors
    home = np.array(spec["start"])
    for number in range(len(errors)):
        back = dqc.recording.load_record(
            tmp_path / "repeats" / f"repeat-{number}" / "back" / "run" / "record.mcap"
        )
        assert np.abs(back.measured[-1] - home).max() < 5e-3
        fastest = np.abs(np.diff(back.measured, axis=0)).max() / 0.02
        assert fastest < 0.3 * dqc.load_robot("iiwa7").limits.velocity.max()
    found.save(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "learning.json").read_text())["repeats"][0]["outcome"] == "first"


@pytest.mark.slow
def test_a_tracker_teaches_over_ros_what_encoders_do_not_see(start, tmp_path):
    """The robot's tool is 6 mm longer than the controller knows; a tracker sees its hand, the encoders do not."""
    model = yaml.safe_load((Path(dqc.robots.__file__).parent / "models" / "iiwa7.yaml").read_text())
    model["joints"][-1]["dh"]["d"] += 6e-3
    (tmp_path / "longer.yaml").write_text(yaml.safe_dump(model))
    spec = {
        "name": "seen",
        "robot": "iiwa7",
        "start": [0, 0.6, 0, 1.6, 0, 0.6, 0],
        "period": 0.02,
        "reference": {"kind": "circle", "radius": 0.05, "duration": 8, "ramp": 0.5},
        "law": {"kind": "proportional-feedforward", "gain": 3},
        "plant": SERVO | {"delay": 0.03},
        "learn": {
            "measured_by": "tracker",
            "tracker": {"topic": "/camera/hand"},
            "uncertainty": {"lag": 0.2, "delay": 0.03},
            "skip": 0.6,
        },
    }
    path, there = tmp_path / "learn.yaml", tmp_path / "there.yaml"
    path.write_text(yaml.safe_dump(spec))
    there.write_text(yaml.safe_dump(spec | {"robot": "longer.yaml"}))
    start("robot", there, "--tracker", "/camera/hand", *WAITS)
    robot = RobotBehindTopics(tmp_path / "repeats", ros_arguments=PATIENT[1:])
    found = dqc.learn(path, 3, runner=robot)
    errors = [each.position for each in found.repeats]
    print(f"errors over ROS 2 as a tracker sees them, mm: {errors}", file=sys.stderr)
    assert errors[0] > 5.5
    assert errors[found.best] < errors[0] / 2


def test_the_way_back_keeps_well_below_the_joints_speeds():
    arm = dqc.load_robot("iiwa7")
    home = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    far = home + 1.0
    time = slow_time(arm, far, home)
    share = np.linspace(0, 1, 2001)
    shape = share**3 * (10 - 15 * share + 6 * share**2)
    assert (np.diff(shape).max() * 2000 / time <= 0.1501 * arm.limits.velocity).all()
    assert slow_time(arm, home, home) == 2.0


def test_a_tracker_that_was_silent_for_long_teaches_nothing(tmp_path):
    stamps = np.arange(-0.03, 2.1, 0.05)
    poses = np.zeros((len(stamps), 8))
    poses[:, 0], poses[:, 5] = 1.0, 0.5 * 0.1 * stamps  # 0.1 m/s along x
    file, time = tmp_path / "tracked.csv", 0.01 * np.arange(200)

    def write(kept):
        np.savetxt(file, np.column_stack([stamps, poses])[kept], "%.17g", ",", header="time, …", comments="")

    write(stamps < 9)
    seen = read_tracked(file, time)
    assert np.abs(dqc.algebra.translation(seen) - np.outer(0.1 * time, [1, 0, 0])).max() < 1e-9
    write((stamps < 0.5) | (stamps > 0.9))
    with pytest.raises(
        Error, match=r"the tracker was silent for 0\.4\d? s; learning needs a pose every 0\.2 s"
    ):
        read_tracked(file, time)
