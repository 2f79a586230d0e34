"""The pose of a mobile base, as its odometry or a localisation says on a topic."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node

from dqcontrol.arrays import Array
from dqcontrol.plants.mobile.odometry import displaced
from dqcontrol.ros2 import messages
from dqcontrol.ros2.diagnostics import PeriodMonitor
from dqcontrol.ros2.interfaces import NEWEST, ODOMETRY
from dqcontrol.ros2.parameters import Number, number

if TYPE_CHECKING:
    from dqcontrol.ros2.controller_node import Following

_AHEAD = 0.1  # s that a stamp may be ahead of those before: nothing comes from the future

_TIMEOUT, _TIMEOUT_PERIODS = 0.1, 2.5  # s, or so many periods if that is longer


def numbers_of_odometry(period: float, stale_after: float) -> tuple[Number, Number, Number]:
    """Return what may be changed of a controller that hears odometry, with its period and the age that it allows, s."""
    timeout = max(_TIMEOUT, _TIMEOUT_PERIODS * period, stale_after)
    words = "after which odometry no longer counts, s"
    return (
        Number("odometry_timeout", timeout, 0.01, max(2.0, timeout), words),
        Number("odometry_deviation", 0.5, 0.001, 10.0, "standard deviation from which it counts as none, m"),
        Number("correction_timeout", 1.0, 0.05, 60.0, "after which map → odom no longer counts, s"),
    )


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

    def __init__(self, node: Node, parent: str, child: str, guarded: messages.Guard) -> None:
        self._frames, self._heard = (parent, child), -math.inf
        self.pose: Array = np.full(3, np.nan)
        topic, kind = messages.transform_topic(messages.BASE_TRANSFORM)
        self.topic: str = node.resolve_topic_name(topic)
        node.create_subscription(kind, self.topic, guarded(self._hear), messages.TRANSFORMS)

    @property
    def age(self) -> float:
        """Time since it was heard last, s; infinite before."""
        return time.monotonic() - self._heard

    def _hear(self, message: Any) -> None:
        for each in getattr(message, "transforms", [message]):
            if (each.header.frame_id, each.child_frame_id) == self._frames:
                transform = each.transform
                self.pose = messages.planar_pose("transform", transform.translation, transform.rotation)
                self._heard = time.monotonic()


class Localisation:
    """Hears odometry, and perhaps how a localisation corrects it, and refuses what cannot be right.

    Parameters
    ----------
    node
        Whose topics and parameters.
    following
        The controller; while its robot moves odometry may not begin anew with another clock. Of the equal headings that
        counts which is nearest to where its spec starts, and from then on that nearest to the last one.
    frame, odometry_frame
        That poses are to be in, and that of odometry: if it is another one, the transform between them is heard.
    guarded
        Wraps what hears a message, and may refuse it.

    Attributes
    ----------
    pose
        x, y (m) and φ (rad), shape (3,); NaN before the first.
    topic
        After ROS's renaming.
    """

    def __init__(
        self, node: Node, following: Following, frame: str, odometry_frame: str, guarded: messages.Guard
    ) -> None:
        self._node, self._frame, self._following = node, odometry_frame, following
        loaded = following.loaded
        self._correction = (
            FrameCorrection(node, frame, odometry_frame, guarded) if frame != odometry_frame else None
        )
        self._frames = f"{frame} → {odometry_frame}"
        self._heading, self._stamp = float(loaded.case.scene.start[loaded.parts.place[2]]), 0.0
        self._heard = -math.inf
        self._stamps, self._monitor = messages.Stamps("odometry"), PeriodMonitor(loaded.period)
        self.pose: Array = np.full(3, np.nan)
        self.topic: str = node.resolve_topic_name(ODOMETRY)
        node.create_subscription(Odometry, ODOMETRY, guarded(self._hear), NEWEST)

    @property
    def age(self) -> float:
        """Time since the last odometry was measured, s, as if the fastest one had taken no time; infinite before."""
        return self._monitor.age(time.monotonic()) if self._heard > -math.inf else math.inf

    @property
    def silence(self) -> str:
        """What has not been heard for too long to count, in words; empty if all has."""
        correction = self._correction
        if correction and not correction.age <= number(self._node, "correction_timeout"):
            return f"no transform {self._frames} on {correction.topic}"
        return "" if self.age <= number(self._node, "odometry_timeout") else f"no odometry on {self.topic}"

    def _hear(self, message: Odometry) -> None:
        now, at = time.monotonic(), messages.nanoseconds(message.header.stamp)
        pose, deviation = messages.planar_pose_of(message, self._frame), messages.deviation_of(message)
        most, stamp = number(self._node, "odometry_deviation"), at / messages.NANOSECONDS
        if self._correction:  # what drifts is corrected, however far it has drifted
            pose = displaced(self._correction.pose, pose)
            if np.isnan(pose).any():
                raise messages.RefusedError(f"odometry: {self.silence}, which corrects it")
        elif deviation > most:
            raise messages.RefusedError(
                f"odometry: its standard deviation is {deviation:.3g} m; odometry_deviation is {most:g}"
            )
        if self._following.control.is_commanding or not self.silence:
            ahead = stamp - self._stamp - self._monitor.age(now)
            if ahead > _AHEAD:
                raise messages.RefusedError(f"odometry: its stamp is {ahead:.3g} s ahead of its clock")
            self._stamps.check(at)
            self._monitor.hear(now, stamp)
        else:  # it may have begun anew, with another clock
            self._stamps.forget()
            self._stamps.check(at)
            self._monitor.start(now, stamp)
        self._heard, self._stamp = now, stamp
        pose[2] = self._heading + math.remainder(pose[2] - self._heading, 2.0 * math.pi)
        self._heading = float(pose[2])
        self.pose = pose
        self._following.hear_odometry(now, at)
