"""The configurations that give the end effector a pose, and which of them to start from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ReachError, ShapeError
from dqcontrol.robots.inverse.inverse_kinematics import ranges, solutions
from dqcontrol.robots.poses import unit_poses
from dqcontrol.robots.robot import base_coordinates

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


_STARTS = 60
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
    robot: Robot, pose: ArrayLike, *, orientation: bool = True, starts: int = _STARTS, seed: int = 0
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
    target = unit_poses("pose", pose)
    if target.shape != (8,):
        raise ShapeError(f"pose: expected one pose, shape (8,), got shape {target.shape}")
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
