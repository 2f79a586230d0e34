"""Poses that users hand in, checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array

Array = NDArray[np.float64]


def unit_poses(field: str, pose: ArrayLike) -> Array:
    """Return unit dual quaternions, shape (…, 8), with the last digits of their norms mended."""
    x = as_array(field, getattr(pose, "vec8", pose), (8,))
    norm = np.sqrt(np.einsum("...i,...i->...", x[..., :4], x[..., :4]))
    along = np.einsum("...i,...i->...", x[..., :4], x[..., 4:])
    if (np.abs(norm - 1) > 1e-6).any() or (np.abs(along) > 1e-6).any():
        worst = np.unravel_index(int(np.argmax(np.abs(norm - 1) + np.abs(along))), norm.shape)
        raise ValueRangeError(
            f"{field}: expected unit dual quaternions, got norm {norm[worst]:.6g} + ε {along[worst]:.6g}"
        )
    return x / norm[..., None]


def pose7(field: str, pose: ArrayLike) -> Array:
    """Return [quaternion, position] of one unit dual quaternion."""
    x = unit_poses(field, pose)
    if x.ndim != 1:
        raise ShapeError(f"{field}: expected one pose, shape (8,), got {x.shape}")
    w, v, dw, dv = x[0], x[1:4], x[4], x[5:]
    return np.concatenate([x[:4], 2 * (w * dv - dw * v - np.cross(dv, v))])


def inverse7(pose: Array) -> Array:
    """Return the inverse of a pose (7,)."""
    w, v, p = pose[0], -pose[1:4], pose[4:]
    return np.concatenate([[w], v, -(p + 2 * np.cross(v, w * p + np.cross(v, p)))])
