"""Topics of ros2_control and of mobile bases, and what commands look like on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.robots import DifferentialDrive, WholeBody
from dqcontrol.robots.bases import RollerBase
from dqcontrol.ros2.loading import Loaded, RobotParts

JOINT_STATES, ODOMETRY = "/joint_states", "/odom"
WRENCH = "/force_torque_sensor_broadcaster/wrench"
COMMANDS: dict[str, tuple[str, Any]] = {
    "velocity": ("/forward_velocity_controller/commands", Float64MultiArray),
    "position": ("/forward_position_controller/commands", Float64MultiArray),
    "trajectory": ("/joint_trajectory_controller/joint_trajectory", JointTrajectory),
    "humanoid": ("/humanoid_command", JointTrajectory),
    "effort": ("/forward_effort_controller/commands", Float64MultiArray),
}
BASE_COMMANDS: dict[str, tuple[str, Any]] = {
    "twist": ("/cmd_vel", Twist),
    "twist-stamped": ("/cmd_vel", TwistStamped),
    "wheels": ("/wheel_velocity_controller/commands", Float64MultiArray),
}

# What was sent before the latest message is of no use. Publishers are reliable: reliable subscribers hear them too.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
SENT = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)

_FLUSH = Duration(seconds=0.2)


class Port(NamedTuple):
    """A topic of commands.

    Attributes
    ----------
    topic, kind
        Its name before ROS's renaming, and the type of its messages.
    message
        Makes one of the position command and its rate, shape (m,) each, and the measured configuration (n,).
    """

    topic: str
    kind: Any
    message: Callable[[Array, Array, Array], Any]


class Commands:
    """Publishes commands on the topics of a robot.

    Parameters
    ----------
    node
        Whose.
    ports
        Where commands go.

    Attributes
    ----------
    topics
        Their names, after ROS's renaming.
    """

    def __init__(self, node: Node, ports: Sequence[Port]) -> None:
        self._node, self._ports = node, list(ports)
        self.topics: list[str] = [node.resolve_topic_name(port.topic) for port in ports]
        self._publishers: list[Publisher] = []

    def claim(self) -> None:
        """Be a publisher of the topics until `release`: other controllers see that they are taken.

        Two that do so at once are `rivals` afterwards.

        Raises
        ------
        Error
            If nobody listens.
        """
        if self._publishers:
            return
        for topic in self.topics:
            if not self._node.count_subscribers(topic):
                raise Error(f"activate: nobody listens on {topic}")
        self._publishers = [
            self._node.create_publisher(port.kind, topic, SENT)
            for port, topic in zip(self._ports, self.topics, strict=True)
        ]

    def release(self) -> None:
        """Leave the topics to others, once all that was sent has arrived."""
        for publisher in self._publishers:
            publisher.wait_for_all_acked(_FLUSH)
            self._node.destroy_publisher(publisher)
        self._publishers = []

    @property
    def rivals(self) -> str:
        """Who else publishes on one of the topics, in words; empty if nobody does."""
        own = 1 if self._publishers else 0
        for topic in self.topics:
            if self._node.count_publishers(topic) <= own:  # a tenth of the time that the names take
                continue
            names = publishers_of(self._node, topic)
            if own and self._node.get_fully_qualified_name() in names:
                names.remove(self._node.get_fully_qualified_name())
            return f"{', '.join(names)} publishes on {topic} too"
        return ""

    def send(self, position: Array, rate: Array, measured: Array) -> None:
        """Publish a position command and its rate, (m,), rad or m and rad/s or m/s, of a robot at measured (n,)."""
        for port, publisher in zip(self._ports, self._publishers, strict=False):
            publisher.publish(port.message(position, rate, measured))


def joint_port(
    loaded: Loaded, interface: str, joints: Sequence[str], effort: Callable[[Array, Array, Array], Array]
) -> Port:
    """Return where commands of joints go; a trajectory's point is to be reached in a control period.

    Parameters
    ----------
    loaded
        The spec.
    interface
        A key of `COMMANDS`.
    joints
        Names in messages, in the order of the robot's joints.
    effort
        What ``effort`` commands are, of measured joints, position command and rate, shape (n,) each.
    """
    topic, kind = COMMANDS[interface]
    soon, own = Duration(seconds=loaded.period).to_msg(), loaded.parts.joint_inputs
    # what humanoid commands tell joint controllers beside
    control = loaded.case.plant.joint_control(len(joints))
    beside = {"effort": control.stiffness, "velocities": control.slew_rate, "accelerations": control.asked}
    told = {name: values.tolist() for name, values in beside.items() if values is not None}

    def message(position: Array, rate: Array, measured: Array) -> Any:
        if kind is Float64MultiArray:
            if interface == "effort":
                data = effort(measured, position, rate)
            else:
                data = (rate if interface == "velocity" else position)[own]
            return Float64MultiArray(data=data.tolist())
        point = JointTrajectoryPoint(positions=position[own].tolist())
        whole = JointTrajectory(joint_names=list(joints), points=[point])  # without a stamp: from now on
        if interface == "humanoid":
            whole.header.frame_id = control.mode
            for name, values in told.items():
                setattr(point, name, values)
        else:
            point.velocities, point.time_from_start = rate[own].tolist(), soon
        return whole

    return Port(topic, kind, message)


def base_port(parts: RobotParts, interface: str, node: Node, frame: str) -> Port:
    """Return where commands of the base go.

    Parameters
    ----------
    parts
        The robot.
    interface
        A key of `BASE_COMMANDS`.
    node, frame
        Whose clock stamps them, and the frame of the base that they name, where they have stamps.

    Raises
    ------
    ValueRangeError
        If they are to be those of wheels, and the base has none that are known.
    """
    topic, kind = BASE_COMMANDS[interface]
    if interface == "wheels":
        check_wheels(parts)

    def message(_: Array, rate: Array, measured: Array) -> Any:
        if interface == "wheels":
            return Float64MultiArray(data=wheel_speeds(parts, rate, measured))
        ahead, left, turn = parts.base_twist(measured, rate)
        twist = Twist()
        twist.linear.x, twist.linear.y, twist.angular.z = ahead, left, turn
        if interface == "twist":
            return twist
        stamped = TwistStamped(twist=twist)
        stamped.header.stamp, stamped.header.frame_id = node.get_clock().now().to_msg(), frame
        return stamped

    return Port(topic, kind, message)


def check_wheels(parts: RobotParts) -> None:
    """Refuse commands of wheels for a base without any that are known."""
    if not isinstance(parts.base, DifferentialDrive | RollerBase):
        raise ValueRangeError(
            "base interface: 'wheels' needs a differential drive, mecanum or omni wheels; "
            f"{parts.robot.name} has none: take 'twist'"
        )


def wheel_speeds(parts: RobotParts, rate: Array, measured: Array) -> list[float]:
    """Return the speed of each wheel, rad/s, for inputs of `driven` at a configuration (n,)."""
    body, base = parts.driven, parts.base
    assert isinstance(body, WholeBody)
    if isinstance(base, RollerBase):
        return base.wheel_speeds(parts.base_twist(measured, rate)).tolist()
    return body.wheel_speeds(rate)[parts.base_inputs].tolist()


def publishers_of(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that publish on a topic, one for each of their publishers."""
    found = node.get_publishers_info_by_topic(topic)
    return [f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in found]


def several_publish(node: Node, topic: str) -> str:
    """Say who publish on a topic if they are several; empty if not."""
    if node.count_publishers(topic) <= 1:
        return ""
    return f"several publish on {topic}: {', '.join(sorted(publishers_of(node, topic)))}"
