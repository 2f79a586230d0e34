"""Poses and twists from ROS 2 topics as a device, as gamepads and trackers are."""

from __future__ import annotations

import threading
import time

from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Bool

from dqcontrol.devices.teleoperation import Told
from dqcontrol.loop.targets import Speeds
from dqcontrol.ros2.interfaces import NEWEST
from dqcontrol.ros2.messages import RefusedError, guarding, pose_of, twist_of


class HandTopics:
    """An `Input`: ``~/pose`` or ``~/twist``, as the newest says, while ``~/clutch`` is true.

    Poses are those of a device that is moved itself: they count from where it is when the clutch is taken.

    Parameters
    ----------
    name
        Of the node; ROS 2 has been started (`middleware.ros`).
    frame
        That poses and twists must be in.
    speeds
        What a twist is a share of.
    """

    def __init__(
        self, name: str = "dqcontrol_hand", frame: str = "base_link", speeds: Speeds | None = None
    ) -> None:
        self._told: Told | None = None
        self._clutch, self._frame, self._speeds = False, frame, speeds or Speeds()
        self._node = Node(name)
        for kind, topic, hear in (
            (PoseStamped, "~/pose", self._hear_pose),
            (TwistStamped, "~/twist", self._hear_twist),
            (Bool, "~/clutch", self._hear_clutch),
        ):
            self._node.create_subscription(kind, topic, guarding(self._refuse)(hear), NEWEST)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._executor.spin, name="hand topics", daemon=True)
        self._thread.start()

    def read(self) -> Told | None:
        """Return the newest that was told; see `Input`."""
        return self._told

    def close(self) -> None:
        """Hear no longer."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()

    def _refuse(self, why: RefusedError) -> None:
        self._told = None
        self._node.get_logger().warning(str(why), throttle_duration_sec=1.0)

    def _hear_pose(self, message: PoseStamped) -> None:
        self._told = Told(time.monotonic(), self._clutch, pose=pose_of(message, self._frame))

    def _hear_twist(self, message: TwistStamped) -> None:
        linear, angular, _ = twist_of(message, (self._frame,))
        speeds = self._speeds
        self._told = Told(
            time.monotonic(), self._clutch, linear=linear / speeds.linear, angular=angular / speeds.angular
        )

    def _hear_clutch(self, message: Bool) -> None:
        self._clutch = bool(message.data)
        if not self._clutch:
            self._told = None
