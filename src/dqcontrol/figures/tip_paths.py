"""Where end effectors are and shall be in the room, for pictures: of trees all tips, relative poses where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol import algebra
from dqcontrol.robots.tree_robot import TreeRobot

if TYPE_CHECKING:
    from dqcontrol.arrays import Array
    from dqcontrol.loop.record import Record
    from dqcontrol.robots.robot import Robot


def tip_paths(robot: Robot, record: Record) -> list[Array]:
    """Return positions (N, 3), m, of the end effector; of a tree those of all tips, and of what two of them hold."""
    if not isinstance(robot, TreeRobot) or not np.isfinite(record.q).all():
        return [record.position]
    tips = algebra.translation(robot.frames(record.q)[:, list(robot.ends)])
    between = [record.position] if robot.task.kind == "absolute" else []
    return [*np.moveaxis(tips, 1, 0), *between]


def desired_in_room(robot: Robot, q: Array, desired: Array) -> Array:
    """Return desired poses (N, 8) at configurations (N, n) in the room: relative ones are seen from the second hand."""
    if not isinstance(robot, TreeRobot) or robot.task.kind != "relative" or not np.isfinite(q).all():
        return desired
    return algebra.multiply(robot.pose_of(robot.task.frames[1], q), desired)
