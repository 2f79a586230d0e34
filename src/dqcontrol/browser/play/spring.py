"""A spring between a link and the mouse."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.robots import Robot

STIFFNESS = 200.0  # N/m
_MOST_FORCE = 60.0  # N: half of what ISO/TS 15066 lets a robot press on a chest


class Pull(NamedTuple):
    """What a spring does to a link.

    Attributes
    ----------
    point, force
        Where it holds the link, m, and how it draws, N, shape (3,), inertial frame.
    gave_way
        How far that point is from where the link was taken, m.
    """

    point: Array
    force: Array
    gave_way: float


class Spring:
    """Holds a point of a link, and goes along with it.

    Parameters
    ----------
    robot, q
        Whose link, and where the robot is, shape (n,), rad or m.
    row
        Of `Robot.frames`: what the link moves with.
    taken
        Where it is taken, shape (3,), m, inertial frame.

    Attributes
    ----------
    towards
        Where it leads, shape (3,), m, inertial frame.
    """

    row: int
    towards: Array

    def __init__(self, robot: Robot, q: Array, row: int, taken: Array) -> None:
        self.row, self.towards = row, taken
        self._robot, self._taken = robot, taken
        frame = algebra.conjugate(robot.frames(q)[row])
        self._on_link = algebra.multiply(frame, algebra.pose([1, 0, 0, 0], taken))

    def pull(self, q: Array) -> Pull:
        """Return what it does to the robot at q, shape (n,)."""
        point = algebra.translation(algebra.multiply(self._robot.frames(q)[self.row], self._on_link))
        force = STIFFNESS * (self.towards - point)
        force *= min(1.0, _MOST_FORCE / max(float(np.linalg.norm(force)), 1e-9))
        return Pull(point, force, float(np.linalg.norm(point - self._taken)))
