"""Chains with joint axes of any direction, turned so that each screw is about z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.robots.dh import compose


def chain_from_axes(
    poses: Sequence[Array], axes: Sequence[ArrayLike], tool: Array
) -> tuple[list[Array], list[Array]]:
    """Return the fixed poses of a chain, and the turn of each joint frame that puts z on its axis.

    Parameters
    ----------
    poses
        Pose (7,) ``[quaternion, position]`` of each joint's frame in the frame after the joint before it.
    axes
        Axis (3,) of each joint in its own frame, of any length but zero.
    tool
        Pose (7,) of the tool in the frame after the last joint.

    Returns
    -------
    fixed, turns
        The n + 1 fixed poses (7,), and n poses (7,): `SerialArm.frames` gives frame · turn for each joint.

    Raises
    ------
    ShapeError, ValueRangeError
        If an axis is no vector, or zero.
    """
    turns = [z_onto(axis) for axis in axes]
    fixed, before = [], np.array([1.0, 0, 0, 0, 0, 0, 0])
    for pose, turn in zip(poses, turns, strict=True):
        fixed.append(compose(before, pose, turn))
        before = inverse_turn(turn)
    fixed.append(compose(before, tool))
    return fixed, turns


def z_onto(axis: ArrayLike) -> Array:
    """Return the turn (7,) whose z axis is the given one; none at all if that is z."""
    vector = as_array("axis", axis, (3,))
    length = np.linalg.norm(vector)
    if length < 1e-9:
        raise ValueRangeError(f"axis: must not be zero, got {vector}")
    x, y, z = vector / length
    turn = np.array([1 + z, -y, x, 0, 0, 0, 0]) if z >= 0 else np.array([-y, 1 - z, 0, x, 0, 0, 0])
    turn[:4] /= np.linalg.norm(turn[:4])
    return turn


def inverse_turn(turn: Array) -> Array:
    """Return the inverse of a pose (7,) without translation."""
    return turn * np.array([1, -1, -1, -1, 0, 0, 0])


def rotation_matrix(pose: Array) -> Array:
    """Return the rotation matrix of a pose (7,)."""
    return np.column_stack(
        [compose(pose * [1, 1, 1, 1, 0, 0, 0], np.array([1, 0, 0, 0, *e]))[4:] for e in np.eye(3)]
    )
