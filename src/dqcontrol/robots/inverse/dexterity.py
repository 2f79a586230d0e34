"""Where a robot can move best in all directions."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.robots.robot import Robot, base_coordinates

_TRIES = 500


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
