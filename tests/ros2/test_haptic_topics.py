"""A leader behind topics feels what the arm does: a mass with a damper here, the arm in processes of its own."""

import numpy as np
import pytest
import yaml
from msgspec.structs import replace

pytest.importorskip("rclpy", reason="needs ROS 2: pip install 'dqcontrol[ros2]'")

from geometry_msgs.msg import PoseStamped, WrenchStamped
from nodes import PATIENT
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.contact.admittance import exact_step
from dqcontrol.errors import Error
from dqcontrol.loop.control import Control, Phase
from dqcontrol.ros2.haptic_topics import stiffness_borne
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.messages import nanoseconds

IIWA, START = dqc.load_robot("iiwa7"), [0, 0.6, 0, -1.6, 0, 0.9, 0]
# On a busy machine the way once around takes up to 0.3 s, and a loop of D/K = 0.33 s bears half a second.
MASS, DAMPING, STIFFNESS, GAP, PUSH = 0.5, 200.0, 600.0, 0.002, 5.0
HEIGHT = algebra.translation(IIWA.fkm(np.array(START, dtype=float)))[2]
LONGEST = 0.02  # s that the leader moves on for at once


def changes(stiffness=STIFFNESS):
    board = {"box": [0.6, 0.6, 0.2], "position": [0.55, 0, float(HEIGHT) - GAP - 0.1]}
    return {
        "start": START,
        "period": 0.005,
        "reference": {"kind": "set-point"},
        "duration": 100,
        "law": {"kind": "proportional-feedforward", "gain": 1},
        "contact": {"axes": "base", "translation": {"mass": MASS, "damping": DAMPING}},
        "world": {"board": {**board, "stiffness": stiffness}},
        "plant": {"kind": "servo", "time_constant": 0.01, "delay": 0.004, "wrist": {}},
    }


class Leader:
    """A mass with a damper, 5 m away, that a hand pushes and the wrench pushes back."""

    def __init__(self, node):
        self.hand, self.told = np.zeros(3), None
        self.forces, self._seen = [], None
        self._place, self._speed = np.array([5.0, 0, 0]), np.zeros(3)
        self._begin = self._place.copy()
        self._poses = node.create_publisher(PoseStamped, "/dqcontrol/pose", 1)
        node.create_subscription(WrenchStamped, "/dqcontrol/wrench", self._hear, 1)

    @property
    def way(self):
        return self._place - self._begin

    def _hear(self, message):
        force = np.array([getattr(message.wrench.force, axis) for axis in "xyz"])
        assert message.header.frame_id == "base_link"
        now, before = nanoseconds(message.header.stamp) * 1e-9, self._seen
        self.forces.append(force)
        self._seen = now
        if before is not None and now > before:
            step = exact_step(MASS, DAMPING, 0.0, min(now - before, LONGEST))
            total = force + self.hand
            self._place, self._speed = (
                self._place + step[1] * self._speed + step[2] * total,
                step[4] * self._speed + step[5] * total,
            )
        self.tell()

    def tell(self, height=None):
        message = PoseStamped()
        message.header.frame_id, message.pose.orientation.w = "base_link", 1.0
        place = message.pose.position
        place.x, place.y, place.z = self._place.tolist()
        if self.told is not None:
            place.z = self.told
        self._poses.publish(message)


@pytest.mark.slow
def test_the_leader_feels_the_wall_and_without_poses_the_arm_stays(spec, start, node):
    path, heights = spec(**changes()), []
    leader = Leader(node)

    def see(message):
        heights.append(algebra.translation(IIWA.fkm(np.array(message.position)))[2] - HEIGHT)

    node.create_subscription(JointState, "/joint_states", see, 1)
    start("robot", path)
    more = ("-p", "pose_timeout:=10.0", "-p", "start_tolerance:=3.0")
    start("controller", path, "--follow", "haptics", "--autostart", *PATIENT, *more, until="active")
    assert node.serve(lambda: leader.tell() or len(leader.forces) > 10)
    assert np.abs(leader.forces[-1]).max() < 0.1  # in the air
    leader.hand[2] = -PUSH
    last = slice(-40, None)

    def rests():
        felt = np.array(leader.forces[last])[:, 2]
        return len(felt) == 40 and np.abs(felt - PUSH).max() < 0.1

    assert node.serve(rests), leader.forces[last]
    assert np.mean(heights[last]) == pytest.approx(-GAP - PUSH / STIFFNESS, rel=0.05)
    assert leader.way[2] == pytest.approx(heights[-1], abs=1e-3)  # both went the same way
    leader.told = np.nan  # which is no pose
    assert node.serve(lambda: not leader.forces[-1].any())  # nothing is felt any more
    stays, way = heights[-1], leader.way[2]
    assert node.serve(lambda: leader.way[2] < way - 0.02)  # which is pushed on
    assert heights[-1] == pytest.approx(stays, abs=3e-3)  # late messages have it overshoot
    leader.hand[:], leader.told = 0.0, None
    assert node.serve(lambda: leader.forces[-1].any())  # and again, from where both are
    assert heights[-1] == pytest.approx(stays, abs=3e-3)


@pytest.fixture(scope="module")
def limit(tmp_path_factory):
    path = tmp_path_factory.mktemp("limit") / "spec.yaml"
    path.write_text(yaml.safe_dump({"robot": "iiwa7", "name": "limit", **changes()}))
    loaded = load(path)
    numbers = {"force_scale": 1.0, "leader_delay": 0.0}
    return stiffness_borne(loaded, loaded.law, numbers)


@pytest.mark.parametrize(("share", "swings"), [(0.9, False), (1.5, True)])
def test_leader_and_arm_are_quiet_below_what_it_says_and_swing_above(spec, limit, share, swings):
    """Period by period, as messages come on a quiet machine; how late these are at most is in the limit."""
    loaded = load(spec(**changes(share * limit), supervisor={"tracking_error": 6.0, "ramp": 0.0}))
    target, period = loaded.target("haptics"), loaded.period
    target.speeds.linear = 2.0
    control = Control(loaded.prepared_law("haptics"), target, loaded.prepared_supervisor("velocity"))
    plant = loaded.case.plant.start(loaded.robot, loaded.case.scene.start, period, 2000, 0)
    control.activate(plant.measured.copy())
    sensor = replace(loaded.law.contact, axes="base").start(period)
    step, felt, forces = exact_step(MASS, DAMPING, 0.0, period), np.zeros(6), []
    place, speed, sent = np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(1500):
        target.ask(control.time, algebra.pose([1, 0, 0, 0], sent))  # what it told a period ago
        control.step(k * period, plant.measured.copy(), 0.0)
        sent, total = place, felt[3:] - [0, 0, PUSH]
        place, speed = place + step[1] * speed + step[2] * total, step[4] * speed + step[5] * total
        plant.step(control.command)
        felt = sensor.contact_wrench(loaded.robot.fkm(plant.measured), plant.wrench)
        forces.append(felt[5])
    assert control.phase is Phase.ACTIVE, control.reason
    swing = np.ptp(forces[-200:]) / PUSH
    assert swing > 0.5 if swings else swing < 0.02


def test_a_wall_that_leader_and_arm_do_not_bear_is_refused(spec, node):
    from dqcontrol.ros2.controller_node import ControllerNode

    controller = ControllerNode(spec(**changes()), source="haptics")
    controller.configure()
    (done,) = controller.set_parameters([Parameter("force_scale", value=2.0)])
    assert done.successful, done.reason
    (refused,) = controller.set_parameters([Parameter("contact.translation.damping", value=3.0)])
    assert "world.board has 600 N/m, with which leader and arm are unstable together" in refused.reason
    (refused,) = controller.set_parameters([Parameter("leader_delay", value=1.0)])
    assert "leader and arm are unstable together" in refused.reason
    (done,) = controller.set_parameters([Parameter("leader_delay", value=0.05)])
    assert done.successful, done.reason
    controller.destroy_node()
    numb = changes()
    del numb["contact"]
    without = ControllerNode(spec(**numb), source="haptics", name="without")
    with pytest.raises(Error, match="contact: with --follow haptics it says how the leader gives way"):
        without.configure()
    without.destroy_node()
