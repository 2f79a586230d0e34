"""Frames of a robot as constraints see them: the joints that move each, how far, and its end effectors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints.constraint_layout import screw_of
from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.robots.kinematics.kinematics_kernels import HEADING, PRISMATIC, REVOLUTE
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.tree_robot import TreeRobot


class HandFrame(NamedTuple):
    """A hand: the frame that carries it (0: the base's), and its pose (7,) in that, quaternion first."""

    name: str
    frame: int
    pose: Array


class ChainFrames:
    """The frames of a chain: one after each coordinate.

    Attributes
    ----------
    count
        How many there are, the base's not among them.
    carriers, screws, tree
        See `RobotScene`.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.count: int = robot.configuration_size
        m = robot.input_size
        inputs = range(m)
        self.carriers: Array = np.array(
            [(robot.input_coordinates < k).sum() - 1.0 for k in range(self.count + 1)]
        )
        self.screws: Array = screw_of.pack(
            above=[j - 1 for j in inputs], input=list(inputs), scale=np.ones(m), heading=-np.ones(m)
        )
        self.tree: Array = np.zeros((0, COLUMNS))

    def hands(self, field: str, name: str | None) -> list[HandFrame]:
        """Return the hand; a chain has one."""
        if name is not None:
            raise ShapeError(f"{field}.frame: {self.robot.name} is a chain and has one hand; leave it out")
        return [HandFrame("hand", self.count, self.robot.chain[-1, :7])]

    def point_names(self) -> tuple[str, ...]:
        """Return names of points that may be asked for beside the hand."""
        return ()

    def levers(self, frame: int, extent: float, other: int = 0, other_extent: float = 0.0) -> Array:
        """Return how far points of a frame can be from each input's axis, not growing; of what carries both frames 0.

        A point is no farther than an extent from the frame's origin. For a tree, points of two frames move against
        each other.
        """
        robot, n, reach = self.robot, self.count, extent
        travel = np.zeros(n + 1)
        for i, kind in enumerate(robot.joint_types):
            if kind == "prismatic":
                travel[i] = np.abs([robot.limits.lower[i], robot.limits.upper[i]]).max()
        levers = np.zeros(n)
        for i in reversed(range(frame)):
            across = reach  # from the origin of frame i on
            if i < frame - 1:
                x, y, z = robot.chain[i + 1, 4:7]
                across = math.hypot(x, y) + travel[i + 1] + reach
                reach += math.hypot(x, y, z) + travel[i + 1]
            levers[i] = 1.0 if robot.joint_types[i] == "prismatic" else across
        coordinates = robot.input_coordinates
        largest = np.maximum.accumulate(levers[coordinates][::-1])[::-1]
        return np.where((coordinates < frame) & (coordinates >= other), largest, 0.0)

    def joints_before(self, frame: int) -> Iterator[tuple[Array, bool]]:
        """Yield of each joint that carries a frame, the first first, its row in the table and whether it turns."""
        for row, kind in zip(self.robot.chain[:frame], self.robot.joint_types, strict=False):
            yield row, kind == "revolute"

    def turning(self, frame: int) -> Array:
        """Return how fast each input turns a frame."""
        return np.array([float(kind == "revolute") for kind in self.robot.input_types])


class TreeFrames:
    """The frames of a tree, one after each joint; as `ChainFrames`."""

    def __init__(self, robot: TreeRobot) -> None:
        self.robot = robot
        joints = robot.joints
        self.count: int = len(joints.kind)
        self.carriers: Array = np.arange(-1.0, self.count)
        self.screws: Array = screw_of.pack(
            above=joints.parent,
            input=joints.column,
            scale=joints.multiplier,
            heading=np.where(joints.kind == HEADING, joints.coordinate + 2, -1),
        )
        self.tree: Array = robot.joint_table

    def hands(self, field: str, name: str | None) -> list[HandFrame]:
        """Return a named frame; without a name those of the task."""
        robot = self.robot
        if name is not None and name not in robot.named_frames:
            raise unknown_name(f"{field}.frame", name, robot.frame_names)
        found = []
        for each in robot.task.frames if name is None else (name,):
            at = robot.named_frames[each]
            found.append(HandFrame(each, at.joint + 1, at.pose))
        return found

    def point_names(self) -> tuple[str, ...]:
        """Return the names of the frames."""
        return self.robot.frame_names

    def levers(self, frame: int, extent: float, other: int = 0, other_extent: float = 0.0) -> Array:
        """Return what `ChainFrames.levers` does; of joints that carry either of two frames, each for its own."""
        paths = [self.robot.joints.path(each - 1) for each in (frame, other)]
        shared = set(paths[0]) & set(paths[1])
        out = np.zeros(self.robot.input_size)
        for path, own_extent in zip(paths, (extent, other_extent), strict=True):
            self._add_levers([row for row in path if row not in shared], own_extent, out)
        return out

    def _add_levers(self, path: list[int], extent: float, out: Array) -> None:
        joints, levers, reach = self.robot.joints, np.zeros(len(path)), extent
        for i in reversed(range(len(path))):
            across = reach
            if i < len(path) - 1:
                x, y, z = joints.fixed[path[i + 1], 4:7]
                travel = self._travel(path[i + 1])
                across = math.hypot(x, y) + travel + reach
                reach += math.hypot(x, y, z) + travel
            levers[i] = across if joints.kind[path[i]] == REVOLUTE else 1.0
        largest = np.maximum.accumulate(levers[::-1])[::-1]
        shares = np.zeros(len(out))  # of each input: how far it moves all joints of the path together
        for row in path:
            if joints.column[row] >= 0:
                shares[joints.column[row]] += abs(joints.multiplier[row])
        several = max(1.0, float(shares.max()))
        for row, lever in zip(path, largest, strict=True):
            if joints.column[row] >= 0:
                out[joints.column[row]] += lever * abs(joints.multiplier[row]) * several

    def _travel(self, row: int) -> float:
        joints, limits = self.robot.joints, self.robot.limits
        if joints.kind[row] < PRISMATIC:
            return 0.0
        at = joints.coordinate[row]
        ends = joints.multiplier[row] * np.array([limits.lower[at], limits.upper[at]]) + joints.offset[row]
        return float(np.abs(ends).max())

    def joints_before(self, frame: int) -> Iterator[tuple[Array, bool]]:
        """Yield what `ChainFrames.joints_before` does."""
        joints = self.robot.joints
        for row in joints.path(frame - 1):
            yield joints.fixed[row], bool(joints.kind[row] == REVOLUTE)

    def turning(self, frame: int) -> Array:
        """Return how fast each input turns a frame."""
        joints, out = self.robot.joints, np.zeros(self.robot.input_size)
        for row in joints.path(frame - 1):
            if joints.kind[row] == REVOLUTE:
                out[joints.column[row]] += abs(joints.multiplier[row])
        return out


def moving_frames(robot: Robot) -> ChainFrames | TreeFrames:
    """Return what constraints know of a robot's frames."""
    return TreeFrames(robot) if isinstance(robot, TreeRobot) else ChainFrames(robot)
