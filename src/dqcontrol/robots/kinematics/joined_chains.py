"""Chains as the joints of a tree: two on a common base, or one alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dqcontrol.robots.dh import compose, shift
from dqcontrol.robots.robot import NamedFrame, Robot
from dqcontrol.robots.tree_robot import PoseTask, TreeJoints, TreeRobot

_HAND = "hand"


def chain_as_tree(robot: Robot) -> TreeRobot:
    """Return a chain as a tree of one branch, whose frames are ``hand`` and, by its name, that of each joint.

    q, inputs and limits are the same. A tree is returned as it is.
    """
    if isinstance(robot, TreeRobot):
        return robot
    joints, frames = joined_chains({_HAND: robot})
    own = {name: NamedFrame(i, shift()) for i, name in enumerate(robot.joint_names) if name != _HAND}
    tree = TreeRobot(
        joints,
        {**frames, **own},
        PoseTask("frame", (_HAND,)),
        joint_names=robot.joint_names,
        joint_types=robot.joint_types,
        limits=robot.limits,
        input_coordinates=robot.input_coordinates,
        drives=robot.drives,
        inertia=robot.inertia,
        name=robot.name,
    )
    tree.input_names = robot.input_names
    return tree


def joined_chains(parts: Mapping[str, Robot]) -> tuple[TreeJoints, dict[str, NamedFrame]]:
    """Return the joints of a base and of two chains at its end, and the frame at the end of each."""
    rows: list[tuple[Any, ...]] = []
    frames, coordinates, inputs = {}, 0, 0
    start, mount = -1, shift()
    for label, part in parts.items():
        columns = np.full(part.configuration_size, -1)
        columns[part.input_coordinates] = inputs + np.arange(part.input_size)
        parent, fixed = start, mount
        for i in range(part.configuration_size):
            row = part.chain[i]
            at = compose(fixed, row[:7]) if i == 0 else row[:7]
            rows.append((at, row[7], parent, coordinates + i, columns[i], 1.0, 0.0))
            parent, fixed = len(rows) - 1, shift()
        end = compose(fixed, part.chain[-1, :7])
        frames[label] = NamedFrame(parent, end)
        if label == "base":
            start, mount = parent, end
        coordinates, inputs = coordinates + part.configuration_size, inputs + part.input_size
    names = tuple(distinct_names({label: part.joint_names for label, part in parts.items()}))
    poses, kinds, parents, moved, driven, multipliers, offsets = map(np.array, zip(*rows, strict=True))
    return TreeJoints(poses, kinds, parents, moved, driven, multipliers, offsets, names), frames


def distinct_names(names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return all names; those that occur twice after the label of their part."""
    counts = Counter(name for each in names.values() for name in each)
    return [
        name if counts[name] == 1 else f"{label}/{name}" for label, each in names.items() for name in each
    ]
