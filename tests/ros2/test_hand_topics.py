"""Poses and twists of topics drive a live robot as any device does."""

import time

import numpy as np
import pytest

import dqcontrol as dqc
from dqcontrol import algebra
from dqcontrol.devices import Teleoperation
from dqcontrol.loop import Live
from dqcontrol.loop.targets import Speeds
from dqcontrol.ros2 import middleware

Q0 = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])


@pytest.fixture
def topics(domain):
    from dqcontrol.ros2.hand_topics import HandTopics

    with middleware.ros((), ["hand", "teller"]):
        from rclpy.node import Node

        device, teller = HandTopics("hand", speeds=Speeds(linear=0.2, angular=0.5)), Node("teller")
        yield device, teller
        device.close()
        teller.destroy_node()


def told_until(publisher, message, condition):
    """Send a message until it has come: nodes need a while to find each other."""
    while not condition():
        publisher.publish(message)
        time.sleep(0.01)


def test_a_pose_moves_the_hand_while_the_clutch_is_held_and_no_longer(topics):
    from geometry_msgs.msg import PoseStamped, TwistStamped
    from std_msgs.msg import Bool

    device, teller = topics
    poses = teller.create_publisher(PoseStamped, "/hand/pose", 1)
    twists = teller.create_publisher(TwistStamped, "/hand/twist", 1)
    clutch = teller.create_publisher(Bool, "/hand/clutch", 1)
    live = Live(
        dqc.load_robot("iiwa7"), dqc.laws.Proportional(gain=5.0), dqc.plants.Integrator(), 0.01, start=Q0
    )
    driven, start = Teleoperation(live), algebra.translation(live.state.pose)

    def drive(count, now):
        for k in range(count):
            told = device.read()
            driven.take(told and told._replace(stamp=now + 0.01 * k), now + 0.01 * k)
            live.step()
        return now + 0.01 * count

    def pose(x, frame="base_link"):
        message = PoseStamped()
        message.header.frame_id = frame
        message.pose.orientation.w, message.pose.position.x = 1.0, x
        return message

    told_until(poses, pose(0.0), lambda: device.read() is not None)
    assert not device.read().clutch
    told_until(clutch, Bool(data=True), lambda: device._clutch)
    told_until(poses, pose(0.0), lambda: device.read().clutch)
    now = drive(50, 0.0)
    assert np.abs(algebra.translation(live.state.pose) - start).max() < 1e-6
    told_until(poses, pose(0.1), lambda: algebra.translation(device.read().pose)[0] == 0.1)
    now = drive(400, now)
    moved = algebra.translation(live.state.pose) - start
    np.testing.assert_allclose(moved, [0.1, 0, 0], atol=1e-3)

    twist = TwistStamped()
    twist.header.frame_id = "base_link"
    twist.twist.linear.z = 0.1
    told_until(twists, twist, lambda: device.read().pose is None)
    np.testing.assert_allclose(device.read().linear, [0, 0, 0.5])  # of 0.2 m/s

    told_until(poses, pose(0.0, "elsewhere"), lambda: device.read() is None)  # is refused
    told_until(poses, pose(0.1), lambda: device.read() is not None)
    told_until(clutch, Bool(data=False), lambda: device.read() is None)
    drive(10, now)
    assert not driven.is_engaged
