"""MoveIt Servo's topics on a controller, with a simulated robot in a process of its own."""

from importlib.util import find_spec
from types import SimpleNamespace as Fields

import numpy as np
import pytest
from nodes import PATIENT, read_until

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.loop.control import Control
from dqcontrol.loop.targets import JogTarget, TwistTarget
from dqcontrol.ros2.loading import load
from dqcontrol.ros2.messages import RefusedError

SERVO = {
    "name": "servo", "robot": "panda", "start": [0, -0.785, 0, -2.356, 0, 1.571, 0.785], "period": 0.01,
    "reference": {"kind": "set-point", "duration": 60.0},
    "law": {"kind": "proportional-feedforward", "gain": 5.0},
    "plant": {"kind": "servo", "time_constant": 0.05},
    "supervisor": {"stale_after": 0.5},
}  # fmt: skip


def driven(loaded, target, periods, ask):
    """Hand positions of a simulated robot that is asked something before each period."""
    plant = loaded.case.plant.start(loaded.robot, loaded.case.scene.start, loaded.period, periods, 0)
    control = Control(loaded.prepared_law("servo"), target, loaded.prepared_supervisor("position"))
    control.activate(plant.measured.copy())
    found = np.empty((periods, len(plant.q)))
    for k in range(periods):
        ask(control.time, k * loaded.period)
        control.step(k * loaded.period, plant.measured.copy(), 0.0)
        plant.step(control.command)
        found[k] = plant.q
    return found


@pytest.mark.parametrize("axis", range(3))
def test_a_minute_of_pure_rotation_leaves_the_hand_where_it_is(axis):
    loaded = load(SERVO)
    target = TwistTarget(loaded.speeds)
    turn = 0.3 * np.eye(3)[axis]

    def ask(time, now):
        target.ask(time, np.zeros(3), turn * (1 if now % 4 < 2 else -1), of_hand=True)

    q = driven(loaded, target, 6000, ask)
    hand = algebra.translation(loaded.robot.fkm(q))
    assert np.ptp(q, axis=0).max() > 0.3
    assert np.linalg.norm(hand - hand[0], axis=1).max() < 1e-4


def test_joints_that_are_not_jogged_stand():
    loaded = load(SERVO)
    target, rates = JogTarget(7), np.zeros(7)
    rates[3] = 0.2

    def ask(time, now):
        if now < 1.0:
            target.ask(time, rates)

    q = driven(loaded, target, 200, ask)
    assert 0.15 < q[-1, 3] - q[0, 3] < 0.25  # a second, and the ramp of the supervisor
    assert np.array_equal(np.delete(q, 3, axis=1), np.broadcast_to(np.delete(q[0], 3), (200, 6)))
    assert np.ptp(q[-50:, 3]) < 1e-4


def topics_of(node, spec, **parameters):
    """A controller in this process that follows ``servo``, configured."""
    from dqcontrol.ros2.controller_node import ControllerNode

    controller = ControllerNode(spec(**SERVO), source="servo", interface="position")
    node.host(controller)
    controller.configure()
    return controller


def test_joint_jogs_of_unknown_joints_are_refused(node, spec):
    following = topics_of(node, spec).following
    servo = following._servo
    with pytest.raises(RefusedError, match="no joint 'elbow'"):
        servo.hear_jog(Fields(joint_names=["elbow"], velocities=[0.1]))
    with pytest.raises(RefusedError, match="expected 1 numbers, got 2"):
        servo.hear_jog(Fields(joint_names=["panda_joint1"], velocities=[0.1, 0.2]))
    servo.hear_jog(Fields(joint_names=["panda_joint2"], velocities=[0.1]))
    assert isinstance(following.control.target, JogTarget)
    assert following.control.target.rates(following.control.time).tolist() == [0, 0.1, 0, 0, 0, 0, 0]


@pytest.mark.slow
def test_users_of_moveit_servo_change_one_line(spec, start, node):
    from geometry_msgs.msg import PoseStamped, TwistStamped
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Int8
    from std_srvs.srv import SetBool

    arm, q, codes = dqc.load_robot("panda"), [], []
    path = spec(**SERVO)
    node.create_subscription(JointState, "/joint_states", lambda m: q.append(np.array(m.position)), 1)
    node.create_subscription(Int8, "/servo_node/status", lambda m: codes.append(m.data), 1)
    start("robot", path, "--interface", "position")
    first = "active" if find_spec("control_msgs") else "not offered, control_msgs is not installed"
    controller = start(
        "controller", path, "--follow", "servo", "--interface", "position", "--name", "servo_node", "--autostart",
        *PATIENT, "-p", "base_frame:=panda_link0", "-p", "tool_frame:=panda_hand", "-p", "twist_timeout:=1.0",
        "-p", "command_in_type:=unitless", until=first,
    )  # fmt: skip
    if first != "active":
        read_until(controller, "active")
    assert node.serve(lambda: q and codes and codes[-1] == 0)
    begin = arm.fkm(q[-1])

    def moved():
        return algebra.translation(arm.fkm(q[-1])) - algebra.translation(begin)

    twists = node.create_publisher(TwistStamped, "/servo_node/delta_twist_cmds", 1)
    up = TwistStamped()
    up.header.frame_id, up.twist.linear.z = "panda_link0", 0.5  # of 0.1 m/s
    assert node.publish(twists, up, lambda: moved()[2] > 0.02)
    assert np.abs(moved()[:2]).max() < 2e-3

    pause = node.create_client(SetBool, "/servo_node/pause_servo")
    paused = pause.call_async(SetBool.Request(data=True))
    assert node.serve(paused.done)
    assert paused.result().success

    poses = node.create_publisher(PoseStamped, "/servo_node/pose_target_cmds", 1)
    back = PoseStamped()
    back.header.frame_id = "panda_link0"
    place, turn = algebra.translation(begin), begin[:4]
    back.pose.position.x, back.pose.position.y, back.pose.position.z = map(float, place)
    orientation = back.pose.orientation
    orientation.w, orientation.x, orientation.y, orientation.z = map(float, turn)
    q.clear()
    assert node.serve(lambda: len(q) > 50 and np.ptp(q[-50:], axis=0).max() < 1e-6)  # it rests
    high = moved()[2]
    for _ in range(20):
        node.publish(poses, back, lambda: True)
        node.serve(seconds=0.01)
    assert abs(moved()[2] - high) < 1e-3  # it does not listen
    heard = pause.call_async(SetBool.Request(data=False))
    assert node.serve(heard.done)
    assert node.publish(poses, back, lambda: np.abs(moved()).max() < 2e-3)
