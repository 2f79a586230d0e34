"""How much room an arm and what it draws take up in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.films.link_meshes import LinkMesh, mesh_corners
from dqcontrol.robots.files.description import drawn_reach

if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.robots.robot import Robot


@dataclass(frozen=True)
class Framing:
    """Where to look, and how large everything is.

    Attributes
    ----------
    reach
        Length of the arm, m.
    floor
        Height of the floor, m.
    stands
        Whether what stands on the floor is drawn; otherwise a pedestal leads up to an arm above it.
    middle
        Where to look at, shape (3,), m.
    distance
        From where, m.
    """

    reach: float
    floor: float
    middle: Array
    distance: float
    stands: bool = False


def some_samples(record: Record, most: int) -> NDArray[np.int_]:
    """Return at most so many samples of a record, equally far apart, the first and the last among them."""
    return np.linspace(0, len(record.q) - 1, min(len(record.q), most)).astype(int)


def framing_of_arm(robot: Robot, q: Array, points: Array, meshes: list[LinkMesh]) -> Framing:
    """Return the room of an arm at configurations (N, n), rad or m, and of points (M, 3), m."""
    reach = drawn_reach(robot)
    corners = mesh_corners(robot, q, meshes)
    everything = np.vstack([points, translation(robot.frames(q).reshape(-1, 8)), corners, [np.zeros(3)]])
    lower, upper = everything.min(axis=0), everything.max(axis=0)
    if meshes:  # down to the feet
        floor = min(0.0, float(lower[2]))
    else:
        floor = min(0.0, lower[2] - 0.06 * reach) if lower[2] < -0.01 * reach else 0.0
    distance = 1.45 * float(np.linalg.norm(upper - lower)) + 0.2 * reach
    stands = bool(len(corners)) and bool(corners[:, 2].min() < floor + 0.01 * reach)
    return Framing(reach, floor, 0.5 * (lower + upper), distance, stands)
