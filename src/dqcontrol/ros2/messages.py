"""Meaning of messages, and why some are refused. They are read by their fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, suggest
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.plant import ControllerSettings

NANOSECONDS = 1_000_000_000
TRANSFORMS = QoSProfile(depth=100)  # as tf2's own
_MOST_TILT = math.radians(20.0)  # of a base that drives in a plane
_MODES = tuple(column.MODES)
_ASKED = {"PWM": ("duty", -1.0, 1.0)} | dict.fromkeys(("TORQUE", "TORQUE_GC"), ("torque", -1e4, 1e4))
_FASTEST = 100.0  # rad/s, of a reference
_UNIT = 0.01  # by which the norm of an orientation may be off


class RefusedError(Error):
    """A message is not what it should be; it is left out."""


Guard = Callable[[Callable[[Any], None]], Callable[[Any], None]]


def guarding(refuse: Callable[[RefusedError], object]) -> Guard:
    """Return what makes of a function that hears messages one that does not raise, but refuses."""

    def guarded(hear: Callable[[Any], None]) -> Callable[[Any], None]:
        def heard(message: Any) -> None:
            try:
                hear(message)
            except RefusedError as error:
                refuse(error)

        return heard

    return guarded


def optional(package: str) -> Any:
    """Return a package of messages that no wheel of the extra ``ros2`` has, if it is installed."""
    try:
        return import_module(package)
    except ImportError:
        return None


def transform_topic(own: str) -> tuple[str, Any]:
    """Return topic and type of transforms: those of tf2, or where that is not installed, one of ours with one each."""
    tf = optional("tf2_msgs.msg")
    return ("/tf", tf.TFMessage) if tf else (own, TransformStamped)


def nanoseconds(stamp: Any) -> int:
    """Return a ``builtin_interfaces/Time`` in ns."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def stamp_of(time: int, stamp: Any) -> Any:
    """Write a time in ns into a ``builtin_interfaces/Time``, and return it."""
    stamp.sec, stamp.nanosec = divmod(time, NANOSECONDS)
    return stamp


def parts_of(vector: Any) -> list[float]:
    """Return the numbers of a ``geometry_msgs/Vector3`` or ``Point``, or of a ``Quaternion`` the imaginary ones."""
    return [vector.x, vector.y, vector.z]


def write_parts(vector: Any, values: Iterable[float]) -> None:
    """Write these numbers."""
    vector.x, vector.y, vector.z = map(float, values)


def write_pose(message: Any, pose: Array) -> None:
    """Write a unit dual quaternion (8,) into a ``geometry_msgs/Pose``."""
    write_parts(message.position, algebra.translation(pose))
    message.orientation.w = float(pose[0])
    write_parts(message.orientation, pose[1:4])


def numbers(what: str, values: Sequence[float], size: int) -> Array:
    """Return so many finite numbers.

    Raises
    ------
    RefusedError
        If there are more or fewer, or one is not finite.
    """
    array = np.array(values, dtype=np.float64)
    if array.shape != (size,):
        raise RefusedError(f"{what}: expected {size} numbers, got {array.size}")
    if not np.isfinite(array).all():
        raise RefusedError(f"{what}: number {int(np.argmin(np.isfinite(array))) + 1} is not finite")
    return array


def by_name(
    what: str,
    names: Iterable[str],
    values: Iterable[float],
    wanted: Sequence[str],
    quantity: str = "positions",
) -> Array:
    """Return the values of the wanted joints in their order; there may be other joints beside them.

    Raises
    ------
    RefusedError
        If a joint is missing or named twice, there are not as many values as names, or one wanted is not finite.
    """
    names, values = list(names), list(values)
    if len(values) != len(names):
        raise RefusedError(f"{what}: {len(names)} names, but {len(values)} {quantity}")
    given = dict(zip(names, values, strict=True))
    if len(given) != len(names):
        twice = next(name for i, name in enumerate(names) if name in names[:i])
        raise RefusedError(f"{what}: joint '{twice}' is there twice")
    missing = [name for name in wanted if name not in given]
    if missing:
        raise RefusedError(f"{what}: has no joint '{missing[0]}' (it has: {', '.join(names) or 'none'})")
    return numbers(what, [given[name] for name in wanted], len(wanted))


def trajectory_point(message: Any, wanted: Sequence[str]) -> Array:
    """Return the positions of a ``trajectory_msgs/JointTrajectory`` of one point.

    Raises
    ------
    RefusedError
        If it has another number of points, or its joints are not those.
    """
    if len(message.points) != 1:
        raise RefusedError(f"trajectory: expected 1 point, got {len(message.points)}")
    return by_name("trajectory", message.joint_names, message.points[0].positions, wanted)


def humanoid_command(message: Any, wanted: Sequence[str]) -> tuple[Array, ControllerSettings]:
    """Return positions and joint control of a command to Meka's humanoid node.

    The node's own type, ``M3JointCmd``, is in no registry. In its stead a ``trajectory_msgs/JointTrajectory`` has the
    mode in ``header.frame_id``, and one point with ``positions``, stiffness 0 … 1 in ``effort``, slew rates in
    ``velocities``, and in ``accelerations`` what modes without a position loop take: torques, N·m, or with the mode PWM
    duties, −1 … 1. Each but the positions may be empty: it stays as it is.

    Raises
    ------
    RefusedError
        If it has another number of points, its joints are not those, or a number or the mode cannot be.
    """
    position = trajectory_point(message, wanted)
    point, names = message.points[0], message.joint_names
    stiffness = _each(point.effort, names, wanted, "stiffness", 0.0, 1.0)
    slew_rate = _each(point.velocities, names, wanted, "slew rate", 0.0, _FASTEST)
    mode = message.header.frame_id
    if mode and mode not in _MODES:
        raise RefusedError(
            f"mode: unknown name '{mode:.40}'{suggest(mode, _MODES)} (allowed: {', '.join(_MODES)})"
        )
    if len(point.accelerations) and mode not in _ASKED:
        raise RefusedError(
            f"accelerations: are torques or duties, so the mode must be one of {', '.join(_ASKED)}, got '{mode}'"
        )
    asked = _each(point.accelerations, names, wanted, *_ASKED.get(mode, ("", 0.0, 0.0)))
    return position, ControllerSettings(mode, stiffness, slew_rate, asked)


def _each(
    values: Sequence[float], names: Sequence[str], wanted: Sequence[str], what: str, least: float, most: float
) -> Array | None:
    """Return the values of the wanted joints within their range; None where none are given."""
    if not len(values):
        return None
    found = by_name(what, names, values, wanted, what)
    if (found < least).any() or (found > most).any():
        raise RefusedError(f"{what}: must lie in {least:g} … {most:g}, got {found.min():g} … {found.max():g}")
    return found


def pose_of(message: Any, frame: str) -> Array:
    """Return a ``geometry_msgs/PoseStamped`` as unit dual quaternion (8,), in its frame.

    Raises
    ------
    RefusedError
        If its frame is another one, its orientation is no unit quaternion, or a number is not finite.
    """
    if message.header.frame_id != frame:
        raise RefusedError(f"pose: unknown frame '{message.header.frame_id}' (allowed: {frame})")
    return pose_from("pose.", message.pose.position, message.pose.orientation)


def pose_from(what: str, place: Any, turn: Any) -> Array:
    """Return a point or vector and a quaternion of ``geometry_msgs`` as unit dual quaternion (8,).

    ``what`` is what messages begin with, before "position" and "orientation".

    Raises
    ------
    RefusedError
        If the orientation is no unit quaternion, or a number is not finite.
    """
    p = numbers(f"{what}position", parts_of(place), 3)
    r, norm = _rotation(f"{what}orientation", turn)
    return algebra.pose(r / norm, p)


def _rotation(what: str, turn: Any) -> tuple[Array, float]:
    """Return a ``geometry_msgs/Quaternion``, scalar first, and its norm, which is almost 1."""
    r = numbers(what, [turn.w, *parts_of(turn)], 4)
    norm = float(np.linalg.norm(r))
    if abs(norm - 1) > _UNIT:
        raise RefusedError(f"{what}: expected a unit quaternion, got norm {norm:.3g}")
    return r, norm


def twist_of(message: Any, frames: Sequence[str]) -> tuple[Array, Array, str]:
    """Return linear and angular velocity of the end effector, (3,), m/s and rad/s, of a ``geometry_msgs/TwistStamped``.

    The third is the frame whose axes they are in.

    Raises
    ------
    RefusedError
        If its frame is none of those allowed, or a number is not finite.
    """
    frame = message.header.frame_id
    if frame not in frames:
        raise RefusedError(f"twist: unknown frame '{frame}' (allowed: {', '.join(frames)})")
    linear, angular = (parts_of(each) for each in (message.twist.linear, message.twist.angular))
    return numbers("twist.linear", linear, 3), numbers("twist.angular", angular, 3), frame


def planar_pose_of(message: Any, frame: str) -> Array:
    """Return x, y (m) and φ (rad, −π … π) of a ``nav_msgs/Odometry``, shape (3,), in its frame.

    Raises
    ------
    RefusedError
        If its frame is another one, its orientation is no unit quaternion or more than 20° off the plane, or a number
        is not finite.
    """
    if message.header.frame_id != frame:
        raise RefusedError(f"odometry: unknown frame '{message.header.frame_id}' (allowed: {frame})")
    return planar_pose("odometry", message.pose.pose.position, message.pose.pose.orientation)


def planar_pose(what: str, place: Any, turn: Any) -> Array:
    """Return x, y (m) and φ (rad, −π … π), shape (3,), of a point and a quaternion of ``geometry_msgs``.

    Raises
    ------
    RefusedError
        If the orientation is no unit quaternion or more than 20° off the plane, or a number is not finite.
    """
    x, y, _ = numbers(f"{what}: position", parts_of(place), 3)
    r, norm = _rotation(f"{what}: orientation", turn)
    up = 1.0 - 2.0 * (r[1] ** 2 + r[2] ** 2) / norm**2
    if up < math.cos(_MOST_TILT):
        raise RefusedError(
            f"{what}: the base is tilted by {math.degrees(math.acos(max(up, -1.0))):.3g}°; at most "
            f"{math.degrees(_MOST_TILT):g}° are a plane"
        )
    return np.array([x, y, 2.0 * math.atan2(r[3], r[0])])


def deviation_of(message: Any) -> float:
    """Return the standard deviation of a ``nav_msgs/Odometry`` in its worst direction of the plane, m.

    A first entry of −1 says by convention that it is unknown: 0 is returned.

    Raises
    ------
    RefusedError
        If the covariance is none.
    """
    covariance = numbers("odometry: covariance", message.pose.covariance, 36).reshape(6, 6)
    if covariance[0, 0] == -1.0:
        return 0.0
    plane = covariance[:2, :2]
    least, most = np.linalg.eigvalsh(0.5 * (plane + plane.T))
    if least < -_UNIT * max(most, 1e-9) or covariance[5, 5] < 0.0:
        raise RefusedError("odometry: its covariance has negative eigenvalues")
    return math.sqrt(max(most, 0.0))


def planar_twist_of(message: Any, *, sideways: bool) -> tuple[float, float, float]:
    """Return the velocity ahead and to the left, m/s, and the turning, rad/s, of a ``geometry_msgs/Twist``.

    Raises
    ------
    RefusedError
        If a number is not finite, or it asks for what the base cannot do.
    """
    linear = numbers("cmd_vel: linear", parts_of(message.linear), 3)
    angular = numbers("cmd_vel: angular", parts_of(message.angular), 3)
    asked = {
        "linear.y": linear[1] * (not sideways),
        "linear.z": linear[2],
        "angular.x": angular[0],
        "angular.y": angular[1],
    }
    for name, value in asked.items():
        if value:
            raise RefusedError(f"cmd_vel: {name}: the base cannot move so; expected 0, got {value:g}")
    return float(linear[0]), float(linear[1]), float(angular[2])


class Stamps:
    """Lets times pass that increase, and refuses all others."""

    def __init__(self, what: str) -> None:
        self._what, self._last = what, -1

    def check(self, time: int) -> int:
        """Return a time in ns if it is later than all before.

        Raises
        ------
        RefusedError
            If it is not.
        """
        if time <= self._last:
            early = (self._last - time) / NANOSECONDS
            raise RefusedError(
                f"{self._what}: its stamp is {early:.6f} s before the last one's"
                if early
                else f"{self._what}: has the stamp of the one before"
            )
        self._last = time
        return time

    def forget(self) -> None:
        """Let any time pass next."""
        self._last = -1


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


BASE_TRANSFORM = "/base_transform"


def transform_publisher(node: Node) -> Callable[[Odometry], None]:
    """Return what publishes the transform that an odometry says, with its stamp."""
    topic, kind = transform_topic(BASE_TRANSFORM)
    publisher = node.create_publisher(kind, topic, TRANSFORMS)

    def publish(odometry: Odometry) -> None:
        message = TransformStamped(header=odometry.header, child_frame_id=odometry.child_frame_id)
        write_parts(message.transform.translation, parts_of(odometry.pose.pose.position))
        message.transform.rotation = odometry.pose.pose.orientation
        publisher.publish(message if kind is TransformStamped else kind(transforms=[message]))

    return publish
