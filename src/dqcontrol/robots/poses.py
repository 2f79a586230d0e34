"""Poses that users hand in, checked."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

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


def positions(poses: Array) -> Array:
    """Return p of x = r + ε½pr, shape (…, 3)."""
    w, v, dw, dv = poses[..., :1], poses[..., 1:4], poses[..., 4:5], poses[..., 5:8]
    return 2 * (w * dv - dw * v - np.cross(dv, v))


def inverse7(pose: Array) -> Array:
    """Return the inverse of a pose (7,)."""
    w, v, p = pose[0], -pose[1:4], pose[4:]
    return np.concatenate([[w], v, -(p + 2 * np.cross(v, w * p + np.cross(v, p)))])
