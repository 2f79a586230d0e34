"""Poses: unit dual quaternions that users hand in, checked; and arithmetic of `[quaternion, position]`, shape (7,)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array

_FARTHEST = 1e6  # m: squares of errors far beyond it overflow, and no solver finds anything then


def unit_poses(field: str, pose: ArrayLike) -> Array:
    """Return unit dual quaternions, shape (…, 8), with the last digits of their norms mended."""
    given = getattr(pose, "vec8", pose)
    if type(given) is np.ndarray and given.shape == (8,) and given.dtype == np.float64:
        w, i, j, k, dw, di, dj, dk = given.tolist()  # ten times as fast for the usual case
        length = math.sqrt(w * w + i * i + j * j + k * k)
        is_unit = abs(length - 1) <= 1e-6 and abs(w * dw + i * di + j * dj + k * dk) <= 1e-6
        if is_unit and max(abs(dw), abs(di), abs(dj), abs(dk)) <= 0.5 * _FARTHEST:
            return given / length
    x = as_array(field, given, (8,))
    r, d = x[..., :4], x[..., 4:]
    squares, products = r * r, r * d
    norm = np.sqrt(squares[..., 0] + squares[..., 1] + squares[..., 2] + squares[..., 3])
    along = products[..., 0] + products[..., 1] + products[..., 2] + products[..., 3]
    if (np.abs(norm - 1) > 1e-6).any() or (np.abs(along) > 1e-6).any():
        worst = np.unravel_index(int(np.argmax(np.abs(norm - 1) + np.abs(along))), norm.shape)
        raise ValueRangeError(
            f"{field}: expected unit dual quaternions, got norm {norm[worst]:.9g} + ε {along[worst]:.6g}"
        )
    if (np.abs(d) > 0.5 * _FARTHEST).any():
        far = 2.0 * float(np.abs(d).max())
        raise ValueRangeError(f"{field}: must be within {_FARTHEST:g} m of the origin, got about {far:.3g} m")
    return x / norm[..., None]


def unit_pose(field: str, pose: ArrayLike) -> Array:
    """Return one unit dual quaternion, shape (8,)."""
    x = unit_poses(field, pose)
    if x.ndim != 1:
        raise ShapeError(f"{field}: expected one pose, shape (8,), got {x.shape}")
    return x


def pose7(field: str, pose: ArrayLike) -> Array:
    """Return [quaternion, position] of one unit dual quaternion."""
    x = unit_pose(field, pose)
    return np.concatenate([x[:4], positions(x)])


def pose8(pose: Array) -> Array:
    """Return the unit dual quaternion (8,) of [quaternion, position]."""
    return algebra.pose(pose[:4], pose[4:])


def positions(poses: Array) -> Array:
    """Return p of x = r + ε½pr, shape (…, 3)."""
    w, v, dw, dv = poses[..., :1], poses[..., 1:4], poses[..., 4:5], poses[..., 5:8]
    return 2 * (w * dv - dw * v - np.cross(dv, v))


def inverse7(pose: Array) -> Array:
    """Return the inverse of a pose (7,)."""
    w, v, p = pose[0], -pose[1:4], pose[4:]
    return np.concatenate([[w], v, -(p + 2 * np.cross(v, w * p + np.cross(v, p)))])


def rotation_z(angle: float) -> Array:
    """Return the pose (7,) ``[quaternion, position]`` of a rotation about z."""
    return np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2), 0, 0, 0])


def rotation_x(angle: float) -> Array:
    """Return the pose (7,) of a rotation about x."""
    return np.array([np.cos(angle / 2), np.sin(angle / 2), 0, 0, 0, 0, 0])


def rotation_y(angle: float) -> Array:
    """Return the pose (7,) of a rotation about y."""
    return np.array([np.cos(angle / 2), 0, np.sin(angle / 2), 0, 0, 0, 0])


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Return the pose (7,) of a translation."""
    return np.array([1.0, 0, 0, 0, x, y, z])


def compose(*poses: Array) -> Array:
    """Return the product of poses (7,) ``[quaternion, position]``, left to right."""
    r, p = np.array([1.0, 0, 0, 0]), np.zeros(3)
    for pose in poses:
        w, v = r[0], r[1:]
        p = p + pose[4:] + 2 * _cross(v, w * pose[4:] + _cross(v, pose[4:]))
        r = np.concatenate(
            [[w * pose[0] - v @ pose[1:4]], w * pose[1:4] + pose[0] * v + _cross(v, pose[1:4])]
        )
    return np.concatenate([r / np.linalg.norm(r), p])


def _cross(a: Array, b: Array) -> Array:
    """Return a × b of two vectors (3,), without what `numpy.cross` does for arrays."""
    a, b = a.tolist(), b.tolist()
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


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
    fixed, before = [], shift()
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
