"""Whether an arm can reach a reference, asked before it moves."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.errors import LimitWarning, ReachError
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import Robot, describe

Array = NDArray[np.float64]

_POSES = 200  # of the reference, evenly spaced
_RESTARTS = 100
_POSITION, _ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is reached


def check_reach(robot: Robot, q0: Array, samples: Array) -> None:
    """Raise if a reference leaves what the arm can reach; warn if it leaves what it can within its joint limits.

    First the distance from the first axis is held against the length of the stretched arm, then poses along the
    reference are solved for. Each can be reached by itself then; whether without a jump between them is for the run
    to show. An arm of fewer than six joints cannot reach most poses exactly: only positions count there.

    Parameters
    ----------
    robot
        The arm.
    q0
        Start configuration, shape (n,).
    samples
        Desired motion, shape (N, 21), inertial frame.

    Raises
    ------
    ReachError
        With the time and the distance missing.
    """
    far = (
        np.linalg.norm(algebra.translation(samples[:, POSE]) - _shoulder(robot), axis=1)
        - describe(robot).reach
    )
    if robot.joint_types[0] == "revolute" and far.max() > 0:
        raise ReachError(
            f"reference: at t = {samples[int(far.argmax()), TIME]:.3g} s the desired position is {far.max():.3g} m "
            f"out of reach of {robot.name}"
        )
    chosen = samples[np.unique(np.linspace(0, len(samples) - 1, _POSES).astype(int))]
    found = robot.solve(
        chosen[:, POSE],
        q0,
        position_tolerance=_POSITION,
        orientation_tolerance=_ORIENTATION if robot.configuration_size >= 6 else np.inf,
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


def _shoulder(robot: Robot) -> Array:
    """Return the point of the first axis nearest to the next joint, from which the reach is measured."""
    w, x, y, z = robot.chain[0, :4]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return robot.chain[0, 4:7] + robot.chain[1, 6] * axis
