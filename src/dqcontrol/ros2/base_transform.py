"""Where a base is, as a transform: on `/tf` where tf2's messages are installed, else on a topic of ours.

The wheels of the extra ``ros2`` have no ``tf2_msgs``, and messages cannot be built with them: there a plain
``geometry_msgs/TransformStamped`` says the same.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

TF, OURS = "/tf", "/base_transform"
_KEPT = QoSProfile(depth=100)  # as tf2's own


def _tf_message() -> Any:
    """Return the type of the messages on `/tf`; None if it is not installed."""
    try:
        return importlib.import_module("tf2_msgs.msg").TFMessage
    except ImportError:
        return None


def transform_publisher(node: Node) -> Callable[[Odometry], None]:
    """Return what publishes the transform that an odometry says, with its stamp."""
    kind = _tf_message()
    publisher = node.create_publisher(kind or TransformStamped, TF if kind else OURS, _KEPT)

    def publish(odometry: Odometry) -> None:
        message = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        place, pose = message.transform.translation, odometry.pose.pose
        place.x, place.y, place.z = pose.position.x, pose.position.y, pose.position.z
        message.transform.rotation = pose.orientation
        publisher.publish(kind(transforms=[message]) if kind else message)

    return publish
