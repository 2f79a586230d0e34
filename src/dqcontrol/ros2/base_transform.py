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
from dqcontrol.plants.mobile.odometry import displaced
from dqcontrol.ros2.messages import planar_pose


class OdometryDrift:
    """Adds up the way of a base with errors that are a random walk, and propagates their covariance.

    Between two samples the base moves by d = (ahead, left), m, along its heading half way, and turns by φ. It takes
    each of these for more by an error of mean 0 and variance σ_s²|d_i|, and σ_m²|d| + σ_r²|φ|: wheels slip and roll
    unevenly a little everywhere. With F and G the derivatives of the new pose by the old one and by the errors,
    P ← F P Fᵀ + G Q Gᵀ [Siegwart, Nourbakhsh, Scaramuzza 2011, 5.2.4].

    Parameters
    ----------
    pose
        x, y (m) and φ (rad) at the start, shape (3,).
    rng
        Draws the errors.

    Attributes
    ----------
    deviations
        σ_s in m/√m, σ_m in rad/√m and σ_r in rad/√rad, shape (3,); 0 at first.
    pose
        Where the base believes to be, shape (3,).
    covariance
        Of that, shape (3, 3).
    """

    def __init__(self, pose: Array, rng: np.random.Generator) -> None:
        self.pose: Array = pose.copy()
        self.deviations: Array = np.zeros(3)
        self.covariance: Array = np.zeros((3, 3))
        self._true, self._rng = pose.copy(), rng

    def follow(self, pose: Array) -> None:
        """Move on to where the base is as a sensor without drift measures it, shape (3,)."""
        if not (self.deviations.any() or self.covariance.any()):
            self.pose, self._true = pose.copy(), pose.copy()
            return
        (dx, dy, turn), half = pose - self._true, 0.5 * (pose[2] - self._true[2])
        self._true = pose.copy()
        c, s = math.cos(pose[2] - half), math.sin(pose[2] - half)
        moved = np.array([c * dx + s * dy, c * dy - s * dx, turn])
        way = math.hypot(dx, dy)
        along, by_way, by_turn = np.square(self.deviations)
        sideways = along * abs(moved[1])
        variances = np.array([along * abs(moved[0]), sideways, by_way * way + by_turn * abs(turn)])
        moved += np.sqrt(variances) * self._rng.standard_normal(3)
        heading = self.pose[2] + 0.5 * moved[2]
        c, s = math.cos(heading), math.sin(heading)
        dx, dy = c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]
        self.pose += (dx, dy, moved[2])
        old = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        errors = np.array([[c, -s, -0.5 * dy], [s, c, 0.5 * dx], [0.0, 0.0, 1.0]])
        self.covariance = old @ self.covariance @ old.T + (errors * variances) @ errors.T


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
