"""Whether a robot can reach a reference, asked before it moves."""

from __future__ import annotations

import warnings

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import LimitWarning, ReachError
from dqcontrol.files.long_array import row_by_row
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import Robot, TreeRobot, WholeBody, describe
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.robots.whole_body import parts_with_offsets

_POSES = 200  # of the reference, evenly spaced
_RESTARTS = 100
_POSITION, _ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is reached


def check_reach(robot: Robot, q0: Array, samples: Array, *, orientation: bool = True) -> None:
    """Raise if a reference leaves what the robot can reach; warn if it leaves what it can within its joint limits.

    First the distance from the first axis is held against the length of the stretched arm, unless it stands on a base
    that drives; then poses along the reference are solved for. Each can be reached by itself then; whether without a
    jump between them, and by driving as a base can, is for the run to show. A robot whose end effector cannot move in
    all six directions cannot reach most poses exactly: only positions count there.

    Parameters
    ----------
    robot
        The arm or whole body.
    q0
        Start configuration, shape (n,).
    samples
        Desired motion, shape (N, 21), inertial frame.
    orientation
        Whether that counts.

    Raises
    ------
    ReachError
        With the time and the distance missing.
    """
    drives = bool(base_coordinates(robot).any())
    if not drives and robot.joint_types[0] == "revolute" and not isinstance(robot, TreeRobot):
        _check_length(robot, samples)
    chosen = samples[np.unique(np.linspace(0, len(samples) - 1, _POSES).astype(int))]
    found = robot.solve(
        chosen[:, POSE],
        _driven_near(robot, q0, chosen[:, POSE]) if drives else q0,
        position_tolerance=_POSITION,
        orientation_tolerance=_ORIENTATION if orientation and _turns_freely(robot) else np.inf,
        restarts=_RESTARTS,
    )
    for i in [i for i, reason in enumerate(found.reason) if reason.startswith("unreachable")]:
        raise ReachError(
            f"reference: at t = {chosen[i, TIME]:.3g} s the desired pose is out of reach of {robot.name}: "
            f"{found.reason[i].partition(': ')[2]}"
        )
    for i in [i for i, reason in enumerate(found.reason) if reason.startswith("limits")][:1]:
        warnings.warn(
            f"reference: at t = {chosen[i, TIME]:.3g} s the desired pose needs {robot.name} beyond its "
            f"{found.reason[i]}",
            LimitWarning,
            stacklevel=4,
        )


def _check_length(robot: Robot, samples: Array) -> None:
    """Raise if a position is farther from the first axis than the stretched arm is long."""
    shoulder = _shoulder(robot)
    distance = row_by_row(
        lambda rows: np.linalg.norm(algebra.translation(rows[:, POSE]) - shoulder, axis=1), samples
    )
    far = distance - describe(robot).reach
    if far.max() > _POSITION:
        raise ReachError(
            f"reference: at t = {samples[int(far.argmax()), TIME]:.3g} s the desired position is {far.max():.3g} m "
            f"out of reach of {robot.name}"
        )


def _driven_near(robot: Robot, q0: Array, poses: Array) -> Array:
    """Return q0 for each pose, a base that stands on the floor driven as far as the end effector has to go."""
    starts = np.tile(q0, (len(poses), 1))
    first = next(parts_with_offsets(robot.parts))[0] if isinstance(robot, WholeBody) else 0
    if base_coordinates(robot)[first]:
        way = algebra.translation(poses) - algebra.translation(robot.fkm(q0))
        starts[:, first : first + 2] += way[:, :2]
    return starts


def _turns_freely(robot: Robot) -> bool:
    """Return whether the end effector can move in all six directions in general; drives stand as they need."""
    free = robot.in_form("unconstrained") if isinstance(robot, WholeBody) else robot
    q = np.random.default_rng(0).uniform(-1.0, 1.0, robot.configuration_size)
    return bool(np.linalg.matrix_rank(free.twist_jacobian(q), tol=1e-6) == 6)


def _shoulder(robot: Robot) -> Array:
    """Return the point of the first axis nearest to the next joint, from which the reach is measured."""
    w, x, y, z = robot.chain[0, :4]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return robot.chain[0, 4:7] + robot.chain[1, 6] * axis
