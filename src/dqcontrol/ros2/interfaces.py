"""Topics of ros2_control, and what commands look like on them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from dqcontrol.errors import Error

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

_FLUSH = Duration(seconds=0.2)


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

    Attributes
    ----------
    topic
        Its name, after ROS's renaming.
    """

    def __init__(self, node: Node, interface: str, joints: Sequence[str], period: float) -> None:
        topic, self._kind = COMMANDS[interface]
        self._node, self._interface, self._joints = node, interface, list(joints)
        self.topic = node.resolve_topic_name(topic)
        self._publisher: Publisher | None = None
        self._period = Duration(seconds=period).to_msg()

    def claim(self) -> None:
        """Be a publisher of the topic until `release`: other controllers see that it is taken.

        Two that do so at once are `rivals` afterwards.

        Raises
        ------
        Error
            If nobody listens.
        """
        if self._publisher is None:
            if not self._node.count_subscribers(self.topic):
                raise Error(f"activate: nobody listens on {self.topic}")
            self._publisher = self._node.create_publisher(self._kind, self.topic, SENT)

    def release(self) -> None:
        """Leave the topic to others, once all that was sent has arrived."""
        if self._publisher is not None:
            self._publisher.wait_for_all_acked(_FLUSH)
            self._node.destroy_publisher(self._publisher)
            self._publisher = None

    @property
    def rivals(self) -> list[str]:
        """Names of other nodes that publish on the topic."""
        own = 1 if self._publisher is not None else 0
        if self._node.count_publishers(self.topic) <= own:  # a tenth of the time that the names take
            return []
        names = publishers_of(self._node, self.topic)
        if own and self._node.get_fully_qualified_name() in names:
            names.remove(self._node.get_fully_qualified_name())
        return names

    def send(self, position: NDArray[Any], rate: NDArray[Any]) -> None:
        """Publish a position command (m,), rad or m, and its rate (m,), rad/s or m/s."""
        if self._publisher is None:
            return
        if self._interface == "velocity":
            message = Float64MultiArray(data=rate.tolist())
        elif self._interface == "position":
            message = Float64MultiArray(data=position.tolist())
        else:  # without a stamp: from now on
            point = JointTrajectoryPoint(positions=position.tolist(), velocities=rate.tolist())
            point.time_from_start = self._period
            message = JointTrajectory(joint_names=self._joints, points=[point])
        self._publisher.publish(message)


def publishers_of(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that publish on a topic, one for each of their publishers."""
    found = node.get_publishers_info_by_topic(topic)
    return [f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in found]
