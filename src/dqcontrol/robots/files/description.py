"""The printed description of a robot."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


@dataclass(frozen=True)
class JointRow:
    """One coordinate in a table: limits in degrees or m, velocity in degrees/s or m/s, effort in N·m or N.

    ``input`` names the input that moves it; velocity and effort are that input's, None where there is none.
    """

    name: str
    type: str
    lower: float
    upper: float
    input: str
    velocity: float | None
    effort: float | None


@dataclass(frozen=True)
class Description:
    """What to print about a robot.

    Attributes
    ----------
    name
        The robot's name.
    bases
        Its mobile bases, ``"differential drive"`` or ``"holonomic"``, joined by ``+``; empty without.
    joints
        One row a coordinate.
    reach
        Length of the stretched arm in m, from its first axis (that of the part after the last base) to the tool:
        nothing beyond can be reached.
    mass
        Mass of all moving bodies in kg; None if unknown.
    links
        The links of its URDF file from base to tip; empty without one.
    """

    name: str
    bases: str
    joints: tuple[JointRow, ...]
    reach: float
    mass: float | None
    links: tuple[str, ...] = ()

    @property
    def ends(self) -> str:
        """The links of its file between which its chain lies, as ``base → tool``; empty without such a file."""
        return f"{self.links[0]} → {self.links[-1]}" if self.links else ""


def describe(robot: Robot) -> Description:
    """Return what to print about a robot.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> from dqcontrol.robots import describe
    >>> round(describe(dqc.load_robot("iiwa7")).reach, 3)
    0.926
    """
    limits = robot.limits
    inputs = {int(i): j for j, i in enumerate(robot.input_coordinates)}
    rows = []
    for i, (name, kind) in enumerate(zip(robot.joint_names, robot.joint_types, strict=True)):
        unit = np.pi / 180 if kind == "revolute" else 1.0
        lower, upper, j = float(limits.lower[i] / unit), float(limits.upper[i] / unit), inputs.get(i)
        moved = "", None, None
        if j is not None:
            moved = robot.input_names[j], float(limits.velocity[j] / unit), float(limits.effort[j])
        rows.append(JointRow(name, kind, lower, upper, *moved))
    mass = float(robot.inertia.mass.sum()) if robot.inertia is not None else None
    bases = " + ".join(kind for _, kind in robot.bases)
    return Description(robot.name, bases, tuple(rows), robot.reach, mass, getattr(robot, "links", ()))


def chain_reach(robot: Robot) -> float:
    """Return the sum of the largest distances between neighbouring joint frames, from the first joint on."""
    total, first = 0.0, max((first + 3 for first, _ in robot.bases), default=0)
    for i in range(first, robot.configuration_size):
        step = robot.chain[i + 1, 4:7].copy()
        if robot.joint_types[i] == "prismatic":
            ends = (robot.limits.lower[i], robot.limits.upper[i])
            total += max(math.hypot(step[0], step[1], step[2] + q) for q in ends)
            continue
        if i == first:
            step[2] = 0.0  # along the first axis: measured from the point nearest to the next joint
        total += float(np.linalg.norm(step))
    return total


def drawn_reach(robot: Robot) -> float:
    """Return the length of the longest stretched chain of a robot, m: 1 for one without."""
    return float(_lengths_and_depths(robot)[0].max()) or 1.0


def foot_below(robot: Robot, row: int) -> Array:
    """Return where what carries a first joint is drawn from, m: the base, or the floor below if there are several."""
    if (np.asarray(robot.parents)[: len(robot.row_coordinates)] < 0).sum() < 2:
        return np.zeros(3)
    return robot.chain[row, 4:7] * [1, 1, 0]


def joint_range(robot: Robot, row: int) -> Array:
    """Return the ends of the joint at a row of `Robot.chain` without its offset, rad or m."""
    at = robot.row_coordinates[row]
    with np.errstate(invalid="ignore"):  # a factor of 0 times an infinite limit
        ends = robot.joint_factors[row] * np.array([robot.limits.lower[at], robot.limits.upper[at]])
    return np.sort(ends)


def rod_radii(robot: Robot) -> Array:
    """Return the radius, m, of what is drawn at each row of `Robot.chain`: less towards the end effectors."""
    depth = _lengths_and_depths(robot)[1]
    return drawn_reach(robot) * np.linspace(0.048, 0.026, depth.max() + 1)[depth]


def _lengths_and_depths(robot: Robot) -> tuple[Array, NDArray[np.intp]]:
    """Return for each row of `Robot.chain` the length of the chain up to it, m, and how many rows carry it."""
    length = np.linalg.norm(robot.chain[:, 4:7], axis=1)
    depth = np.zeros(len(length), dtype=np.intp)
    for i, parent in enumerate(robot.parents):
        if parent >= 0:
            length[i], depth[i] = length[parent] + length[i], depth[parent] + 1
    return length, depth
