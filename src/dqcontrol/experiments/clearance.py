"""Whether the hand of a robot on a mobile base goes through the floor, or through the base that carries it."""

from __future__ import annotations

import math
import warnings

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import CollisionWarning
from dqcontrol.loop.record import Record
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.bases import CLEARANCE, Chassis
from dqcontrol.robots.robot import base_coordinates


def hand_clearance(robot: Robot, q: Array, position: Array) -> Array:
    """Return how far the hand's point is above the floor and outside the chassis, m, shape (N,); negative inside.

    Parameters
    ----------
    robot
        A whole body that stands on its first base; the floor is z = 0. Others have no floor: infinite.
    q, position
        Configurations (N, n) and positions of the hand (N, 3), m. The chassis counts where the robot's file has one.
    """
    if not _stands_on_a_floor(robot):
        return np.full(len(q), np.inf)
    above = position[:, 2].copy()
    chassis = _chassis(robot)
    if chassis is None:
        return above
    beside = np.linalg.norm(position[:, :2] - q[:, :2], axis=1) - chassis.radius
    middle = CLEARANCE + 0.5 * chassis.height
    over = np.abs(position[:, 2] - middle) - 0.5 * chassis.height
    return np.minimum(above, np.maximum(beside, over))


def least_clearance(robot: Robot, record: Record) -> float:
    """Return the least of `hand_clearance` over a run, m; NaN without a mobile base on a floor."""
    if not _stands_on_a_floor(robot):
        return math.nan
    finite = np.isfinite(record.q).all(axis=1) & np.isfinite(record.position).all(axis=1)
    found = hand_clearance(robot, record.q[finite], record.position[finite])
    least = float(found.min(initial=math.inf))
    return least if math.isfinite(least) else math.nan


def check_clearance(robot: Robot, q0: Array, samples: Array) -> None:
    """Warn before a run if its hand starts inside its base, or is to go below the floor.

    Parameters
    ----------
    robot, q0
        Where it starts, shape (n,).
    samples
        Desired motion, shape (N, 21), inertial frame.
    """
    if not _stands_on_a_floor(robot):
        return
    start = hand_clearance(robot, q0[None], algebra.translation(robot.fkm(q0))[None])[0]
    if start < 0:
        warnings.warn(
            f"start: the hand of {robot.name} is {1e3 * -start:.0f} mm inside its chassis or the floor; nothing stops "
            "it there",
            CollisionWarning,
            stacklevel=4,
        )
    height = algebra.translation(samples[:, POSE])[:, 2]
    lowest = int(height.argmin())
    if height[lowest] < 0:
        warnings.warn(
            f"reference: at t = {samples[lowest, TIME]:.3g} s the hand shall be {-1e3 * height[lowest]:.0f} mm below "
            "the floor (z = 0), which does not stop it",
            CollisionWarning,
            stacklevel=4,
        )


def _stands_on_a_floor(robot: Robot) -> bool:
    return isinstance(robot, WholeBody) and bool(base_coordinates(robot)[0])


def _chassis(robot: Robot) -> Chassis | None:
    parts = robot.parts if isinstance(robot, WholeBody) else ()
    return getattr(parts[0], "chassis", None) if parts else None
