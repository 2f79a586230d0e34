"""LeRobot's interface to kinematics, calm where a target is out of reach."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ReachError, ShapeError, ValueRangeError, as_array
from dqcontrol.robots.files.load import load_robot
from dqcontrol.robots.inverse.inverse_kinematics import ranges, solutions
from dqcontrol.robots.poses import unit_pose, unit_poses
from dqcontrol.robots.robot import Robot, base_coordinates
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.whole_body import WholeBody

_ANGULAR = 0.3  # m: 1 rad is as far as that, as of `FilteredInverse`
_STARTS, _REFINED = 64, 6
_STEPS = 200  # ends by itself where a step gains nothing
_PRESSED = 1e-6  # of the error: what a bound must hold back to be named
_STANDS = 1e-12  # gain of a step in the squared error: rounding


@dataclass(frozen=True, eq=False)
class NearestPose:
    """What `nearest_pose` found: a configuration within the limits from which no small motion leads nearer.

    Attributes
    ----------
    q
        Shape (n,), rad or m.
    position_error, orientation_error
        Distance (m) and angle (rad) that are left.
    held_by
        Limits that the end effector would have to pass to come nearer, those that hold it most first: joint and side.
    """

    q: Array
    position_error: float
    orientation_error: float
    held_by: tuple[str, ...]

    def __str__(self) -> str:
        """Say how near, and what holds it back."""
        away = self.position_error
        far = f"{1e3 * away:.3g} mm" if away < 1.0 else f"{away:.3g} m"
        near = f"{far} and {math.degrees(self.orientation_error):.3g}°"
        held = ", ".join(self.held_by) or "no joint limit, but the number and length of its links"
        return f"the nearest found within all limits is {near} off, held by {held}"


def nearest_pose(robot: Robot, pose: ArrayLike, start: ArrayLike, seed: int = 0) -> NearestPose:
    """Return how near the end effector comes to a pose, within limits of joints and with bases anywhere.

    Minimises |Δp|² + (0.3 m)² θ² by projected Levenberg–Marquardt steps, from the best of 64 configurations. At a
    minimum the bounds that its gradient presses against are those that hold the hand back. So it is a local
    certificate: of all starts none came nearer, and from there no small motion within the limits does.

    Parameters
    ----------
    robot
        An arm or a whole body.
    pose
        Unit dual quaternion, shape (8,), inertial frame.
    start
        Configuration from which bases drive off, shape (n,).
    seed
        Of the other starts.

    Raises
    ------
    ShapeError, ValueRangeError
        If a size or value is wrong.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot = dqc.load_robot("little-john")
    >>> goal = dqc.DualQuaternion.from_translation([1.0, 1.0, 1.5])
    >>> dqc.robots.nearest_pose(robot, goal, [0] * 8).position_error > 0.5
    True
    """
    free = robot.in_form("unconstrained") if isinstance(robot, WholeBody) else robot
    target, start = unit_poses("pose", pose), as_array("start", start, (robot.configuration_size,))
    lower, upper = ranges(robot.limits, robot.joint_types)
    starts = np.random.default_rng(seed).uniform(lower, upper, (_STARTS, len(start)))
    starts[0] = np.clip(start, robot.limits.lower, robot.limits.upper)
    for first, _ in robot.bases:
        starts[1:, first : first + 2] = start[first : first + 2]
    found = robot.solve(np.tile(target, (_STARTS, 1)), starts, restarts=0)
    order = np.argsort(found.position_error + _ANGULAR * found.orientation_error)
    refined = [descended(free, target, found.q[i]) for i in order[:_REFINED]]
    q = min(refined, key=lambda each: float(np.linalg.norm(_error(free, target, each))))
    left = _error(free, target, q)
    return NearestPose(
        q,
        float(np.linalg.norm(left[3:])),
        float(np.linalg.norm(left[:3])) / _ANGULAR,
        _pressed(free, q, left),
    )


def _error(robot: Robot, target: Array, q: Array, angular: float = _ANGULAR) -> Array:
    """Return the rotation vector (times ``angular``, m) and the way that are left to a pose, shape (6,), m."""
    here = robot.fkm(q)
    turn = algebra.short(algebra.multiply(target, algebra.conjugate(here)))
    sine = float(np.linalg.norm(turn[1:4]))
    angle = 2.0 * math.atan2(sine, float(turn[0]))
    axis = turn[1:4] / sine if sine > 0 else np.zeros(3)
    return np.r_[angular * angle * axis, algebra.translation(target) - algebra.translation(here)]


def _jacobian(robot: Robot, q: Array, angular: float) -> Array:
    return np.r_[angular, angular, angular, 1, 1, 1][:, None] * robot.hand_jacobian(q)


def descended(robot: Robot, target: Array, q: Array, angular: float = _ANGULAR, steps: int = _STEPS) -> Array:
    """Return the end of a descent of |Δp|² + ``angular``² θ² within the limits, from a configuration (n,)."""
    lower, upper = robot.limits.lower, robot.limits.upper
    q = np.clip(q, lower, upper)
    left, damping = _error(robot, target, q, angular), 1e-3
    for _ in range(steps):
        jacobian = _jacobian(robot, q, angular)
        pull = jacobian.T @ left
        free = ~(((q <= lower) & (pull < 0)) | ((q >= upper) & (pull > 0)))
        matrix = jacobian[:, free]
        step = np.zeros(len(q))
        step[free] = np.linalg.solve(matrix.T @ matrix + damping * np.eye(matrix.shape[1]), pull[free])
        there = np.clip(q + step, lower, upper)
        then = _error(robot, target, there, angular)
        if then @ then < left @ left:
            gained = left @ left - then @ then
            q, left, damping = there, then, max(0.3 * damping, 1e-9)
            if gained < _STANDS:
                break
        else:
            damping *= 4.0
            if damping > 1e6:
                break
    return q


def _pressed(robot: Robot, q: Array, left: Array) -> tuple[str, ...]:
    """Return the limits that keep an error from shrinking."""
    pull = _jacobian(robot, q, _ANGULAR).T @ left
    named = []
    for i in np.argsort(-np.abs(pull)):
        for side, bound, pressing in (
            ("lower", robot.limits.lower[i], -pull[i]),
            ("upper", robot.limits.upper[i], pull[i]),
        ):
            if q[i] == bound and pressing > _PRESSED * float(np.linalg.norm(left)):
                unit = "rad" if robot.joint_types[i] == "revolute" else "m"
                named.append(f"{robot.joint_names[i]} at its {side} limit, {bound:.3g} {unit}")
    return tuple(named)


_STARTS_OF_POSTURES = 60  # a six-axis arm has eight postures
_SAME = 1e-3  # rad or m between two configurations: one solution


@dataclass(frozen=True)
class ReachingPosture:
    """A configuration that gives the end effector a pose.

    Attributes
    ----------
    q
        Shape (n,), rad or m.
    margin
        Least distance of a joint from its limits, rad or m; infinite without limits.
    nearest
        The joint that comes so near; empty without limits.
    manipulability
        Product of the singular values of the end effector's Jacobian: 0 where it is singular.
    unit
        Of the margin, ``"rad"`` or ``"m"``.
    """

    q: Array = field(repr=False)
    margin: float
    nearest: str
    manipulability: float
    unit: str = "rad"

    @property
    def room(self) -> str:
        """How near a limit is, as ``nearest limit: wrist_1, 21.4° away``."""
        if not self.nearest:
            return "no joint has limits"
        away = f"{math.degrees(self.margin):.3g}°" if self.unit == "rad" else f"{self.margin:.3g} m"
        return f"nearest limit: {self.nearest}, {away} away"


def postures(
    robot: Robot,
    pose: ArrayLike,
    *,
    orientation: bool = True,
    starts: int = _STARTS_OF_POSTURES,
    seed: int = 0,
) -> list[ReachingPosture]:
    """Return configurations within the joint limits that give the end effector a pose, the best to start from first.

    The best has the largest product of manipulability and of the least share of a joint's half range that is left to
    its limits. An arm with more joints than the pose needs has infinitely many: those returned are a sample.

    Parameters
    ----------
    robot
        The arm or whole body.
    pose
        Unit dual quaternion, shape (8,), inertial frame.
    orientation
        False: the orientation does not matter.
    starts
        Random configurations to look from.
    seed
        Of these.

    Raises
    ------
    ReachError
        If there is none, with the reason.
    ShapeError, ValueRangeError
        If the pose is none.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm = dqc.load_robot("ur5")
    >>> best, *others = postures(arm, arm.fkm([0.3, -1.2, 1.4, 0.3, 1.0, 0.0]))
    >>> best.manipulability > 0.05, len(others) > 2
    (True, True)
    """
    target = unit_pose("pose", pose)
    lower, upper = ranges(robot.limits, robot.joint_types)
    guesses = np.random.default_rng(seed).uniform(lower, upper, (starts, len(lower)))
    guesses[0] = 0.5 * (lower + upper)
    guesses[:, base_coordinates(robot)] = 0.0
    tolerance = 1e-6 if orientation else np.inf
    first = robot.solve(target, guesses[0], orientation_tolerance=tolerance)
    if not first.success:
        raise ReachError(first.reason)
    q = _distinct(np.vstack([first.q, solutions(robot, target, guesses, tolerance, restarts=2)]))
    share, margin, nearest = _room(robot, q)
    dexterity = robot.manipulability(q)
    order = np.argsort(-share * dexterity, kind="stable")
    return [_posture(robot, q[i], float(margin[i]), int(nearest[i]), float(dexterity[i])) for i in order]


def _posture(robot: Robot, q: Array, margin: float, nearest: int, dexterity: float) -> ReachingPosture:
    name = robot.joint_names[nearest] if math.isfinite(margin) else ""
    return ReachingPosture(
        q, margin, name, dexterity, "rad" if robot.joint_types[nearest] == "revolute" else "m"
    )


def _distinct(q: Array) -> Array:
    """Return configurations without those that are the same as an earlier one."""
    same = np.abs(q[:, None] - q).max(axis=2) <= _SAME
    return q[~np.tril(same, -1).any(axis=1)]


def _room(robot: Robot, q: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """Return what is left to the limits: the least share of half a range, the least distance, and of which joint."""
    lower, upper = robot.limits.lower, robot.limits.upper
    distance = np.minimum(q - lower, upper - q)
    half = 0.5 * (upper - lower)
    shares = np.where(np.isfinite(half), distance / np.where(np.isfinite(half), half, 1.0), 1.0)
    nearest = distance.argmin(axis=1)
    return np.minimum(shares, 1.0).min(axis=1), distance.min(axis=1), nearest


_TRIES = 500  # random configurations


def most_dexterous(robot: Robot, lowest: float = -math.inf) -> Array:
    """Return the configuration of greatest manipulability among some hundred within the middle of the limits.

    Parameters
    ----------
    robot
        Whose.
    lowest
        Least height of the end effector above the base frame's origin, m, with which no joint is below that. Where no
        configuration is so high, as of arms that hang, it does not count.

    Returns
    -------
    q : ndarray, shape (n,)
        rad or m; bases rest at the origin.
    """
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    tries = np.random.default_rng(0).uniform(0.2, 0.8, (_TRIES, len(lower)))
    tries = lower + tries * (upper - lower)
    tries[:, base_coordinates(robot)] = 0.0
    if math.isfinite(lowest):
        joints = translation(robot.frames(tries))[..., 2].min(axis=1)
        standing = (translation(robot.fkm(tries))[:, 2] >= lowest) & (joints >= 0)
        tries = tries[standing] if standing.any() else tries
    return tries[int(np.argmax(robot.manipulability(tries)))]


_FRAME = 1 / 30  # s: of LeRobot's loops
# of a descent in a call: a step within reach ends below 1e-3 mm after three frames (tests)
_STEPS_OF_A_CALL = 10


class RobotKinematics:
    """Forward and inverse kinematics as ``lerobot.model.RobotKinematics`` has them: degrees and 4 × 4 matrices.

    The inverse descends from the present configuration to the nearest within the joint limits, of
    w_p² |Δp|² + w_o² θ² [Levenberg 1944; Marquardt 1963], and goes no further in a call than the joints' velocity
    limits allow in a frame of 1/30 s. So joints neither jump nor swing to and fro where a target is out of reach, as
    they do by one Newton step a frame.

    Parameters
    ----------
    urdf_path
        As for `load_robot`: any robot of one chain.
    target_frame_name
        Link at its end; that of `load_robot` if omitted.
    joint_names
        The robot's joints in the order of the angles; the chain's if omitted.

    Raises
    ------
    ShapeError
        If ``joint_names`` are not those of the chain.

    Examples
    --------
    >>> import numpy as np
    >>> arm = RobotKinematics("panda")
    >>> q = np.array([0.0, -45.0, 0.0, -130.0, 0.0, 90.0, 45.0])
    >>> goal = arm.forward_kinematics(q + 2.0)
    >>> found = arm.inverse_kinematics(q, goal, orientation_weight=1.0)
    >>> bool(np.abs(arm.forward_kinematics(found) - goal).max() < 1e-6)
    True
    """

    def __init__(
        self,
        urdf_path: str,
        target_frame_name: str | None = None,
        joint_names: Sequence[str] | None = None,
    ) -> None:
        robot = load_robot(urdf_path, tip_link=target_frame_name)
        if not isinstance(robot, SerialArm):
            raise ShapeError(f"urdf_path: '{urdf_path}' is no arm of one chain")
        self.robot: SerialArm = robot
        self.joint_names: list[str] = list(joint_names or robot.joint_names)
        if sorted(self.joint_names) != sorted(robot.joint_names):
            raise ShapeError(
                f"joint_names: expected those of the chain, {', '.join(robot.joint_names)}; "
                f"got {', '.join(self.joint_names)}"
            )
        if any(kind != "revolute" for kind in robot.joint_types):
            raise ShapeError(f"urdf_path: {robot.name} has sliding joints, and angles here are in degrees")
        self._order = [self.joint_names.index(name) for name in robot.joint_names]
        self._most = robot.limits.velocity * _FRAME

    def forward_kinematics(self, joint_pos_deg: ArrayLike) -> Array:
        """Return the pose (4, 4) of the end effector in the base frame for angles in degrees; others do not count."""
        return algebra.matrix_from_pose(self.robot.fkm(self._radians(joint_pos_deg)))

    def inverse_kinematics(
        self,
        current_joint_pos: ArrayLike,
        desired_ee_pose: ArrayLike,
        position_weight: float = 1.0,
        orientation_weight: float = 0.01,
    ) -> Array:
        """Return the angles (degrees) for the next frame; what follows the joints (a gripper) stays as it is.

        Parameters
        ----------
        current_joint_pos
            Degrees.
        desired_ee_pose
            Shape (4, 4), base frame, m.
        position_weight, orientation_weight
            Of 1 m and 1 rad; an orientation weight of 0 leaves the orientation free.
        """
        if not position_weight > 0 or not orientation_weight >= 0:
            raise ValueRangeError(
                "position_weight, orientation_weight: must be > 0 and ≥ 0, "
                f"got {position_weight:g} and {orientation_weight:g}"
            )
        target = algebra.pose_from_matrix(as_array("desired_ee_pose", desired_ee_pose, (4, 4)))
        out = as_array("current_joint_pos", current_joint_pos, (None,)).copy()
        here = self._radians(out)
        step = (
            descended(self.robot, target, here, orientation_weight / position_weight, _STEPS_OF_A_CALL) - here
        )
        step *= min(1.0, float(1.0 / np.max(np.abs(step) / self._most, initial=1.0)))
        out[self._order] = np.rad2deg(here + step)
        return out

    def _radians(self, degrees: ArrayLike) -> Array:
        values, count = as_array("joint_pos", degrees, (None,)), len(self.joint_names)
        if len(values) < count:
            raise ShapeError(f"joint_pos: expected {count} angles or more, got {len(values)}")
        return np.deg2rad(values[self._order])
