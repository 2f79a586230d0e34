"""Whether an arm can reach a reference, asked before it moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.errors import ReachError
from dqcontrol.laws import Proportional
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import SerialArm, describe

Array = NDArray[np.float64]

_POSES = 200  # of the reference, evenly spaced
_NEWTON_STEPS = 12  # a pose
_PATIENT_STEPS = 5000  # for a pose that those do not reach: near singularities they are short
_TOLERANCE = 1e-3  # m


def check_reach(robot: SerialArm, q0: Array, samples: Array) -> None:
    """Raise if a reference leaves what the arm can reach.

    First the distance from the first axis is held against the length of the stretched arm, then an ideal arm
    follows the reference by Newton steps (the law K with kT = 1). Joint limits are not considered. An arm of fewer
    than six joints cannot reach most poses exactly, so only its distance is checked.

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
        With the distance missing and the time.
    """
    shoulder = _shoulder(robot)
    far = np.linalg.norm(algebra.translation(samples[:, POSE]) - shoulder, axis=1) - describe(robot).reach
    if robot.joint_types[0] == "revolute" and far.max() > 0:
        _refuse(robot, float(far.max()), float(samples[int(far.argmax()), TIME]))
    if robot.configuration_size < 6:
        return
    chosen = samples[np.unique(np.linspace(0, len(samples) - 1, _POSES).astype(int))]
    followed = _follow(robot, q0, np.repeat(chosen, _NEWTON_STEPS, axis=0))[_NEWTON_STEPS - 1 :: _NEWTON_STEPS]
    missing = _distances(robot, followed, chosen)
    for i in np.flatnonzero(missing > _TOLERANCE):
        patient = _follow(robot, followed[i], np.repeat(chosen[i : i + 1], _PATIENT_STEPS, axis=0))
        distance = float(_distances(robot, patient[-1:], chosen[i : i + 1])[0])
        if distance > _TOLERANCE:
            _refuse(robot, distance, float(chosen[i, TIME]))


def _shoulder(robot: SerialArm) -> Array:
    """Return the point of the first axis nearest to the next joint, from which the reach is measured."""
    w, x, y, z = robot.chain[0, :4]
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    return robot.chain[0, 4:7] + robot.chain[1, 6] * axis


def _follow(robot: SerialArm, q0: Array, samples: Array) -> Array:
    law = Proportional(gain=1.0).prepare(robot, None, 1.0)
    return close_loop(law, Integrator().start(robot, q0, 1.0, len(samples), 0), samples).q


def _distances(robot: SerialArm, q: Array, samples: Array) -> Array:
    hand = algebra.translation(robot.fkm(q))
    return np.linalg.norm(hand - algebra.translation(samples[: len(hand), POSE]), axis=1)


def _refuse(robot: SerialArm, distance: float, time: float) -> None:
    raise ReachError(
        f"reference: at t = {time:.3g} s the desired position is {distance:.3g} m out of reach of {robot.name}"
    )
