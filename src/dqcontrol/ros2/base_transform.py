"""Transforms of a base: on `/tf` where tf2's messages are installed, else on a topic of ours.

The wheels of the extra ``ros2`` have no ``tf2_msgs``, and messages cannot be built with them: there a plain
``geometry_msgs/TransformStamped`` says the same.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from dqcontrol.arrays import Array
from dqcontrol.plants.mobile.live_camera import displaced
from dqcontrol.ros2.messages import planar_pose

TF, OURS = "/tf", "/base_transform"
_KEPT = QoSProfile(depth=100)  # as tf2's own


def tf_message() -> Any:
    """Return the type of the messages on `/tf`; None if it is not installed."""
    try:
        return importlib.import_module("tf2_msgs.msg").TFMessage
    except ImportError:
        return None


def transform_publisher(node: Node) -> Callable[[Odometry], None]:
    """Return what publishes the transform that an odometry says, with its stamp."""
    kind = tf_message()
    publisher = node.create_publisher(kind or TransformStamped, TF if kind else OURS, _KEPT)

    def publish(odometry: Odometry) -> None:
        message = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        place, pose = message.transform.translation, odometry.pose.pose
        place.x, place.y, place.z = pose.position.x, pose.position.y, pose.position.z
        message.transform.rotation = pose.orientation
        publisher.publish(kind(transforms=[message]) if kind else message)

    return publish


class FrameCorrection:
    """Hears where a localisation sees the frame of odometry, as AMCL and SLAM tell it: map → odom.

    Their stamps say until when a transform counts, so they may lie ahead: its age counts from its hearing.

    Parameters
    ----------
    node
        Whose topics.
    parent, child
        Frame that poses are to be in, and that of odometry.
    guarded
        Wraps what hears a message, and may refuse it.

    Attributes
    ----------
    topic
        After ROS's renaming.
    pose
        x, y (m) and φ (rad) of the child in the parent, shape (3,); NaN before the first.
    """

    def __init__(
        self, node: Node, parent: str, child: str, guarded: Callable[..., Callable[[Any], None]]
    ) -> None:
        self._frames, self._heard = (parent, child), -math.inf
        self.pose: Array = np.full(3, np.nan)
        kind = tf_message()
        self.topic: str = node.resolve_topic_name(TF if kind else OURS)
        node.create_subscription(kind or TransformStamped, self.topic, guarded(self._hear), _KEPT)

    @property
    def age(self) -> float:
        """Time since it was heard last, s; infinite before."""
        return time.monotonic() - self._heard

    def applied(self, pose: Array) -> Array:
        """Return a pose (3,) in the frame of odometry as one in that of poses."""
        return displaced(self.pose, pose)

    def _hear(self, message: Any) -> None:
        for each in getattr(message, "transforms", [message]):
            if (each.header.frame_id, each.child_frame_id) == self._frames:
                transform = each.transform
                self.pose = planar_pose("transform", transform.translation, transform.rotation)
                self._heard = time.monotonic()
