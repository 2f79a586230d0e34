"""Robots whose driven base stands: their arms' ways are straight edges, which planning proves."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.robots import Robot
from dqcontrol.robots.limits import Limits

_STANDS = (
    1e-10  # m or rad: how far a base that stands may be off its place, a tenth of what counts as rounding
)


def driven_coordinates(robot: Robot) -> NDArray[np.bool_]:
    """Return which coordinates are x, y and φ of bases that cannot move sideways, shape (n,)."""
    found = np.zeros(robot.configuration_size, dtype=bool)
    for first in robot.drives[:, 0].astype(int):
        found[first : first + 3] = True
    return found


def standing_at(robot: Robot, q: Array) -> Robot:
    """Return a robot whose driven bases stay where a configuration (n,) has them; another robot as it is."""
    driven, limits = driven_coordinates(robot), robot.limits
    if not driven.any():
        return robot
    standing = copy(robot)
    lower, upper = np.where(driven, q - _STANDS, limits.lower), np.where(driven, q + _STANDS, limits.upper)
    standing.limits = Limits(lower, upper, limits.velocity, limits.effort)
    return standing
