"""Topics beside joints: the world as markers, watched bodies, efforts, and a wrench that a controller hears."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import Point, WrenchStamped
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.geometry import Box, Capsule, Cylinder, Hull, Plane, Shape, Sphere
from dqcontrol.loop.control import Control
from dqcontrol.ros2 import messages
from dqcontrol.ros2.interfaces import NEWEST, WRENCH
from dqcontrol.ros2.loading import RobotParts
from dqcontrol.ros2.middleware import steady_timer
from dqcontrol.supervisor import PreparedSupervisor
from dqcontrol.world import Body, World
from dqcontrol.world.body import poses_of

_NOTHING: Array = np.zeros(0)
_HELD = 3.0  # periods that a wrench counts for a law with contact, as its stage holds the last one


class WrenchInput:
    """Efforts of the joints and the wrench at the end effector, as last heard.

    Parameters
    ----------
    node
        Whose topics.
    parts
        The robot.
    joints
        Their names in messages, in the order of the robot's joints.
    frame
        Of the end effector.
    guarded
        Wraps what hears a message, and may refuse it.

    Attributes
    ----------
    effort
        Shape (m,), N·m or N, 0 of a base; empty while the supervisor bounds none.
    wrench
        Force and torque, shape (6,), N and N·m; empty while nobody needs any, before the first, and for a law with
        contact when the last is older than three periods.
    pass_on
        Takes each wrench and its stamp, if somebody feels it; set it before `listen`.
    topic
        Of the wrench, after ROS's renaming.
    """

    effort: Array

    def __init__(
        self, node: Node, parts: RobotParts, joints: list[str], frame: str, guarded: messages.Guard
    ) -> None:
        self._node, self._parts, self._joints = node, parts, joints
        self._frame, self._guarded = frame, guarded
        self.effort = self._wrench = _NOTHING
        self._silent_after = np.inf
        self.topic: str = node.resolve_topic_name(WRENCH)
        self._has_effort = self._has_payload = self._is_watched = False
        self._wrenches: Subscription | None = None
        self._heard = -np.inf
        self.pass_on: Callable[[Array, Any], None] | None = None

    def listen(self, supervisor: PreparedSupervisor, law: Controller) -> None:
        """Hear what supervisor and law need, and nothing else: at 1 kHz that would cost a tenth of the time."""
        self._is_watched = supervisor.watches_wrench
        self._silent_after = _HELD * law.period if law.wrench.size and not self._is_watched else np.inf
        self._has_effort, self.effort = supervisor.watches_effort, _NOTHING
        self._has_payload = supervisor.carries_payload
        is_heard = self._is_watched or law.wrench.size > 0 or self.pass_on is not None
        if is_heard == (self._wrenches is not None):
            return
        if self._wrenches is None:
            hear = self._guarded(self._hear_wrench)
            self._wrenches = self._node.create_subscription(WrenchStamped, WRENCH, hear, NEWEST)
        else:
            self._node.destroy_subscription(self._wrenches)
            self._wrenches, self._wrench, self._heard = None, _NOTHING, -np.inf

    def hear_efforts(self, message: JointState) -> None:
        """Keep the efforts of joint states, if they are bounded.

        Raises
        ------
        RefusedError
            If it has none, or one is not finite.
        """
        if self._has_effort:
            self.effort = np.zeros(self._parts.robot.input_size)
            found = messages.by_name("joint states", message.name, message.effort, self._joints, "efforts")
            self.effort[self._parts.own_joint_inputs] = found

    @property
    def age(self) -> float:
        """Time since the last wrench, s; 0 if nobody needs any."""
        return 0.0 if self._wrenches is None else time.monotonic() - self._heard

    @property
    def wrench_age(self) -> float:
        """The same where the supervisor bounds it, and its age stops; contact knows what to do without."""
        return self.age if self._is_watched else 0.0

    @property
    def wrench(self) -> Array:
        """Force and torque as last heard, empty if there is none that counts."""
        return self._wrench if self.age <= self._silent_after else _NOTHING

    def _hear_wrench(self, message: WrenchStamped) -> None:
        if self._has_payload and message.header.frame_id != self._frame:
            raise messages.RefusedError(
                f"wrench: in frame '{message.header.frame_id}', but the payload is taken off in '{self._frame}'"
            )
        parts = [*messages.parts_of(message.wrench.force), *messages.parts_of(message.wrench.torque)]
        self._wrench = messages.numbers("wrench", parts, 6)
        self._heard = time.monotonic()
        if self.pass_on is not None:
            self.pass_on(self._wrench, message.header.stamp)


MARKERS, BODIES = "~/world", "/world_transform"
_EVERY = 0.2  # s: between two messages with markers
_HALF_WIDTH = 5.0  # m: of a plane's marker
_THIN = 0.002  # m
_COLOUR = (0.55, 0.35, 0.65, 0.7)


class WorldTopics:
    """Says bodies of a world as ``visualization_msgs/MarkerArray``, where that is installed, and hears watched ones.

    A transform whose child frame is the name of a body with ``watch`` says where that is; constraints keep clear of it
    there, and its marker stands there. They come on ``/tf`` where tf2's messages are installed, else as
    ``geometry_msgs/TransformStamped`` on ``/world_transform``.

    Parameters
    ----------
    node, control
        Whose topics, and what is told.
    world
        The bodies.
    frame
        That poses are in.
    guarded
        Wraps what hears a message, and may refuse it.

    Attributes
    ----------
    seen
        Where watched bodies are by the last transform, poses (8,); of those not heard yet as the world says.
    """

    def __init__(
        self, node: Node, control: Control, world: World, frame: str, guarded: messages.Guard
    ) -> None:
        self._node, self._control, self._world, self._frame = node, control, world, frame
        watched = {name: body for name, body in world.bodies.items() if body.watch is not None}
        self.seen: dict[str, Array] = {name: body.pose for name, body in watched.items()}
        if watched:
            topic, kind = messages.transform_topic(BODIES)
            node.create_subscription(kind, topic, guarded(self.hear), messages.TRANSFORMS)
        self._messages = messages.optional("visualization_msgs.msg")
        if self._messages is not None:
            self._publisher = node.create_publisher(self._messages.MarkerArray, MARKERS, 1)
            steady_timer(node, _EVERY, self._publish)

    def hear(self, message: Any) -> None:
        """Take where watched bodies are from a transform, or several; others are passed over.

        Raises
        ------
        RefusedError
            If a transform is in another frame, or no pose.
        """
        for each in getattr(message, "transforms", [message]):
            name = each.child_frame_id
            if name not in self.seen:
                continue
            if each.header.frame_id != self._frame:
                raise messages.RefusedError(
                    f"transform of {name}: is in frame '{each.header.frame_id}', expected '{self._frame}'"
                )
            place = each.transform
            self.seen[name] = messages.pose_from(f"transform of {name}: ", place.translation, place.rotation)
            self._control.law.place(name, self.seen[name])

    def _publish(self) -> None:
        assert self._messages is not None
        stamp, now = self._node.get_clock().now().to_msg(), np.array([self._control.time])
        markers = []
        for name, body in self._world.bodies.items():
            pose = self.seen[name] if name in self.seen else poses_of(name, body, now, {})[0]
            markers += body_markers(self._messages, name, body, pose)
        for number, marker in enumerate(markers):
            marker.id, marker.header.frame_id, marker.header.stamp = number, self._frame, stamp
        self._publisher.publish(self._messages.MarkerArray(markers=markers))


def body_markers(markers: Any, name: str, body: Body, pose: Array) -> Iterator[Any]:
    """Yield the markers of a body at a pose (8,): one a shape, of a capsule three."""
    for shape in body.own_shapes:
        for kind, scale, place in _forms(markers.Marker, shape.moved(pose)):
            marker = markers.Marker(ns=name, type=kind, action=markers.Marker.ADD)
            messages.write_pose(marker.pose, place)
            messages.write_parts(marker.scale, scale)
            if isinstance(shape, Hull):
                marker.points = [
                    Point(x=x, y=y, z=z) for x, y, z in shape.points[shape.faces].reshape(-1, 3).tolist()
                ]
            marker.color.r, marker.color.g, marker.color.b, marker.color.a = _COLOUR
            yield marker


def _forms(marker: Any, shape: Shape) -> Iterator[tuple[int, Any, Array]]:
    """Yield kind, size and pose of the markers of a shape."""
    still = [1.0, 0, 0, 0]
    if isinstance(shape, Box):
        yield marker.CUBE, shape.size, shape.pose
    elif isinstance(shape, Hull):
        yield marker.TRIANGLE_LIST, [1.0] * 3, shape.pose
    elif isinstance(shape, Sphere):
        yield marker.SPHERE, [2 * shape.radius] * 3, algebra.pose(still, shape.center)
    elif isinstance(shape, Plane):
        turn = algebra.rotation_from_matrix(shape.axes)
        place = algebra.pose(turn, (shape.offset - 0.5 * _THIN) * shape.normal)
        yield marker.CUBE, [2 * _HALF_WIDTH, 2 * _HALF_WIDTH, _THIN], place
    elif isinstance(shape, Capsule | Cylinder):
        along, middle = shape.end - shape.start, 0.5 * (shape.start + shape.end)
        length, wide = float(np.linalg.norm(along)), 2 * shape.radius
        if length > 0:
            turn = algebra.rotation_from_matrix(Plane(along / length, 0.0).axes)
            yield marker.CYLINDER, [wide, wide, length], algebra.pose(turn, middle)
        for end in (shape.start, shape.end) if isinstance(shape, Capsule) else ():
            yield marker.SPHERE, [wide] * 3, algebra.pose(still, end)
