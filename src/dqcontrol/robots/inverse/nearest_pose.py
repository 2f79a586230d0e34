"""How near a robot's end effector comes to a pose within its joint limits, and which of them hold it back."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import as_array
from dqcontrol.robots.inverse.inverse_kinematics import ranges
from dqcontrol.robots.poses import unit_poses
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.whole_body import WholeBody

_ANGULAR = 0.3  # m: 1 rad is as far as that, as of `FilteredInverse`
_STARTS, _REFINED = 64, 6
_STEPS = 200
_PRESSED = 1e-6  # of the error: what a bound must hold back to be named
_STANDS = 1e-12


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
        near = f"{1e3 * self.position_error:.3g} mm and {math.degrees(self.orientation_error):.3g}°"
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
    target, q0 = unit_poses("pose", pose), as_array("start", start, (robot.configuration_size,))
    lower, upper = ranges(robot.limits, robot.joint_types)
    starts = np.random.default_rng(seed).uniform(lower, upper, (_STARTS, len(q0)))
    starts[0] = np.clip(q0, robot.limits.lower, robot.limits.upper)
    for first, _ in robot.bases:
        starts[1:, first : first + 2] = q0[first : first + 2]
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
