"""Topics of ros2_control, and what commands look like on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

JOINT_STATES = "/joint_states"
WRENCH = "/force_torque_sensor_broadcaster/wrench"
COMMANDS: dict[str, tuple[str, Any]] = {
    "velocity": ("/forward_velocity_controller/commands", Float64MultiArray),
    "position": ("/forward_position_controller/commands", Float64MultiArray),
    "trajectory": ("/joint_trajectory_controller/joint_trajectory", JointTrajectory),
}

# What was sent before the latest message is of no use. Publishers are reliable: reliable subscribers hear them too.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SENT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)


class Commands:
    """Publishes commands on the topic of an interface.

    Parameters
    ----------
    node
        Whose.
    interface
        A key of `COMMANDS`.
    joints
        Names, in the order of the numbers.
    period
        Time in which a trajectory's point is to be reached, s.
    """

    def __init__(self, node: Node, interface: str, joints: Sequence[str], period: float) -> None:
        topic, kind = COMMANDS[interface]
        self._interface, self._joints = interface, list(joints)
        self._publisher = node.create_publisher(kind, topic, SENT)
        self._period = Duration(seconds=period).to_msg()

    @property
    def topic(self) -> str:
        """Name of the topic, after ROS's renaming."""
        return self._publisher.topic_name

    @property
    def is_heard(self) -> bool:
        """Whether anybody listens."""
        return self._publisher.get_subscription_count() > 0

    def send(self, position: NDArray[Any], rate: NDArray[Any]) -> None:
        """Publish a position command (m,), rad or m, and its rate (m,), rad/s or m/s."""
        if self._interface == "velocity":
            message = Float64MultiArray(data=rate.tolist())
        elif self._interface == "position":
            message = Float64MultiArray(data=position.tolist())
        else:  # without a stamp: from now on
            point = JointTrajectoryPoint(positions=position.tolist(), velocities=rate.tolist())
            point.time_from_start = self._period
            message = JointTrajectory(joint_names=self._joints, points=[point])
        self._publisher.publish(message)
