"""Efforts and wrenches that a controller hears beside the joints' positions, as far as it needs them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState

from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.ros2.interfaces import NEWEST, WRENCH
from dqcontrol.ros2.loading import RobotParts
from dqcontrol.ros2.messages import RefusedError, by_name, numbers
from dqcontrol.supervisor import PreparedSupervisor

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

    def __init__(
        self,
        node: Node,
        parts: RobotParts,
        joints: list[str],
        frame: str,
        guarded: Callable[..., Callable[[Any], None]],
    ) -> None:
        self._node, self._parts, self._joints = node, parts, joints
        self._frame, self._guarded = frame, guarded
        self.effort: Array = _NOTHING
        self._wrench: Array = _NOTHING
        self._silent_after = np.inf
        self.topic: str = node.resolve_topic_name(WRENCH)
        self._has_effort, self._has_payload, self._wrenches, self._heard = False, False, None, -np.inf
        self._wrenches: Subscription | None
        self._is_watched = False
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
            names, efforts = list(message.name), list(message.effort)
            self.effort = np.zeros(self._parts.robot.input_size)
            found = by_name("joint states", names, efforts, self._joints, "efforts")
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
            raise RefusedError(
                f"wrench: in frame '{message.header.frame_id}', but the payload is taken off in '{self._frame}'"
            )
        f, t = message.wrench.force, message.wrench.torque
        self._wrench = numbers("wrench", [f.x, f.y, f.z, t.x, t.y, t.z], 6)
        self._heard = time.monotonic()
        if self.pass_on is not None:
            self.pass_on(self._wrench, message.header.stamp)
