"""The end effector as a tracker sees it, beside a motion: heard by controllers, said by simulated robots."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from dqcontrol.arrays import Array
from dqcontrol.errors import Error
from dqcontrol.files.output_file import whole_file
from dqcontrol.references import POSE, Points
from dqcontrol.references.points import DUAL_QUATERNION
from dqcontrol.ros2.interfaces import SENT
from dqcontrol.ros2.messages import NANOSECONDS, Guard, nanoseconds, pose_of, stamp_of, write_pose

TRACKED = "tracked.csv"
_HEARD = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)  # none may be lost to a busy loop
_APART = 0.5  # s that the clocks of tracker and robot may differ
_GAP = 0.2  # s without a pose, over which what the end effector did is not known


class TrackedHand:
    """Keeps what a tracker says where the end effector is while a motion goes on.

    Parameters
    ----------
    node
        Whose topics.
    topic
        Of ``geometry_msgs/PoseStamped``.
    frame
        That the poses must be in: the robot's base.
    guarded
        Wraps what hears a message, and may refuse it.
    """

    def __init__(self, node: Node, topic: str, frame: str, guarded: Guard) -> None:
        self.topic: str = node.resolve_topic_name(topic)
        self._frame = frame
        self._origin, self._heard = 0.0, -np.inf
        self._times: list[float] = []
        self._poses: list[Array] = []
        node.create_subscription(PoseStamped, topic, guarded(self._hear), _HEARD)

    def _hear(self, message: PoseStamped) -> None:
        pose = pose_of(message, self._frame)
        stamp = nanoseconds(message.header.stamp) / NANOSECONDS
        if self._times and stamp <= self._times[-1]:
            return  # came twice, or late
        self._heard = time.monotonic()
        self._times.append(stamp)
        self._poses.append(pose)

    def check(self, stamp: float) -> None:
        """Raise unless poses come, by the clock of the robot's stamps, s.

        Raises
        ------
        Error
            If there are none, or their clock is another one.
        """
        if time.monotonic() - self._heard > _APART:
            raise Error(f"activate: no poses of the end effector on {self.topic}")
        apart = self._times[-1] - stamp
        if abs(apart) > _APART:
            raise Error(
                f"activate: stamps on {self.topic} are {apart:.3g} s from those of the robot; synchronise their clocks"
            )

    def begin(self, stamp: float) -> None:
        """Begin a motion at a stamp, s: forget what was heard before, but for the last pose."""
        self._origin = stamp
        del self._times[:-1], self._poses[:-1]

    def write(self, path: Path) -> None:
        """Write times since the start of the motion, s, and poses, as a table."""
        rows = np.column_stack([np.array(self._times) - self._origin, np.array(self._poses)])
        header = ", ".join(("time", *DUAL_QUATERNION))
        with whole_file(path) as draft:
            np.savetxt(draft, rows, "%.17g", ", ", header=header, comments="")


def read_tracked(path: Path, time: Array) -> Array:
    """Return where the tracker saw the end effector at times since the start of the motion (N,), s; shape (N, 8).

    Raises
    ------
    Error
        If it was silent for long.
    """
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    stamps = rows[:, 0]
    known = np.concatenate([[time[0]], stamps[(stamps > time[0]) & (stamps < time[-1])], [time[-1]]])
    if (gap := float(np.diff(known).max())) > _GAP:
        raise Error(f"{path}: the tracker was silent for {gap:.2g} s; learning needs a pose every {_GAP:g} s")
    seen = Points(stamps, rows[:, 1:])
    return seen.samples(np.clip(time - stamps[0], 0.0, seen.duration))[:, POSE]


def pose_publisher(node: Node, topic: str, frame: str) -> Callable[[int, Array], None]:
    """Return what publishes a pose of the end effector, (8,), at a time in ns."""
    publisher = node.create_publisher(PoseStamped, topic, SENT)
    message = PoseStamped()
    message.header.frame_id = frame

    def publish(stamp: int, pose: Array) -> None:
        write_pose(message.pose, pose)
        stamp_of(stamp, message.header.stamp)
        publisher.publish(message)

    return publish
