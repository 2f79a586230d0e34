"""Conversions of rotations and poses to and from matrices, angles and other libraries.

Rotations are unit quaternions (…, 4), scalar first; poses unit dual quaternions (…, 8). Angles are in rad,
lengths in m. Leading axes are batches. All raise `ShapeError` for a wrong shape or type and `ValueRangeError`
for NaN, infinity or a value that is no rotation.

Euler angles are taken from the quaternion, not from the matrix: next to a degenerate rotation small entries
of the matrix give two angles with independent errors; the quaternion keeps their sum or difference exact.

Of SciPy, Pinocchio, MuJoCo and DQ Robotics values are read by their attributes, so that nothing is imported; a library
is imported only to make one of its objects.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import dual_quaternion_kernels as kernels, functions
from dqcontrol.arrays import Array
from dqcontrol.errors import MissingExtraError, NoteWarning, ShapeError, ValueRangeError, as_array

_DEGENERATE = 5e-15  # sine below which the axis of an angle is round-off


def pose(rotation: ArrayLike, translation: ArrayLike) -> Array:
    """Return poses x = r + ε½pr, shape (…, 8), of rotations r (…, 4) and positions p (…, 3), m [S17 3.7].

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, or the norm of r is not 1 within 0.001. Quaternions that were written
        with four digits or more are within, and are normalised.

    Examples
    --------
    >>> pose([1, 0, 0, 0], [0.1, 0.2, 0.3])[5:].tolist()
    [0.05, 0.1, 0.15]
    """
    return functions.apply(
        kernels.set_pose,
        8,
        rotation=as_unit_quaternion("rotation", rotation),
        translation=as_array("translation", translation, (3,)),
    )


def matrix_from_rotation(rotation: ArrayLike) -> Array:
    """Return rotation matrices R, shape (…, 3, 3), of unit quaternions (…, 4): R v = Im(r v r*) [P16 B.1]."""
    r = as_unit_quaternion("rotation", rotation)
    w, x, y, z = np.moveaxis(r, -1, 0)
    entries = [
        2 * (w * w + x * x) - 1, 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 2 * (w * w + y * y) - 1, 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 2 * (w * w + z * z) - 1,
    ]  # fmt: skip
    return np.stack(entries, axis=-1).reshape(*r.shape[:-1], 3, 3)


def rotation_from_matrix(matrix: ArrayLike) -> Array:
    """Return unit quaternions (…, 4) with real part ≥ 0 of rotation matrices (…, 3, 3), after Shepperd.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, or RᵀR is not 1 within 1e-6, or det R < 0 (a reflection).
    """
    m = as_array("matrix", matrix, (3, 3))
    defect = np.abs(np.swapaxes(m, -1, -2) @ m - np.eye(3)).max(axis=(-1, -2))
    if (defect > functions.UNIT_TOLERANCE).any():
        raise ValueRangeError(
            f"matrix: expected a rotation, but RᵀR differs from 1 by {defect.max():.3g}"
            f"{functions.index_of(defect > functions.UNIT_TOLERANCE)}; allowed is {functions.UNIT_TOLERANCE:g}"
        )
    mirrored = np.linalg.det(m) < 0
    if mirrored.any():
        raise ValueRangeError(
            f"matrix: expected a rotation, but its determinant is −1{functions.index_of(mirrored)}, a reflection"
        )
    a, b, c = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    x, y, z = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy, xz, yz = m[..., 1, 0] + m[..., 0, 1], m[..., 0, 2] + m[..., 2, 0], m[..., 2, 1] + m[..., 1, 2]
    squares = np.stack([1 + a + b + c, 1 + a - b - c, 1 - a + b - c, 1 - a - b + c], axis=-1)
    # Row i of this symmetric matrix is 4 q_i q; the one with the largest q_i loses no digits.
    rows = np.stack(
        [
            squares[..., 0], x, y, z,
            x, squares[..., 1], xy, xz,
            y, xy, squares[..., 2], yz,
            z, xz, yz, squares[..., 3],
        ],
        axis=-1,
    ).reshape(*m.shape[:-2], 4, 4)  # fmt: skip
    largest = np.argmax(squares, axis=-1)[..., None, None]
    r = np.take_along_axis(rows, largest, axis=-2)[..., 0, :]
    r = r / np.linalg.norm(r, axis=-1, keepdims=True)
    return np.where(r[..., :1] < 0, -r, r)


def matrix_from_pose(x: ArrayLike) -> Array:
    """Return homogeneous matrices [R p; 0 1], shape (…, 4, 4), of poses (…, 8) [P16 A.25]."""
    x = functions.as_unit("x", x)
    matrix = np.zeros((*x.shape[:-1], 4, 4))
    matrix[..., :3, :3] = matrix_from_rotation(x[..., :4])
    matrix[..., :3, 3] = functions.translation(x)
    matrix[..., 3, 3] = 1
    return matrix


def pose_from_matrix(matrix: ArrayLike) -> Array:
    """Return poses (…, 8) with real part ≥ 0 of homogeneous matrices [R p; 0 1], shape (…, 4, 4).

    Raises
    ------
    ShapeError, ValueRangeError
        As for `rotation_from_matrix`, or if the last row is not [0, 0, 0, 1].
    """
    m = as_array("matrix", matrix, (4, 4))
    wrong = (np.abs(m[..., 3, :] - [0, 0, 0, 1]) > functions.UNIT_TOLERANCE).any(axis=-1)
    if wrong.any():
        row = m[..., 3, :][wrong][0]
        raise ValueRangeError(
            f"matrix: the last row must be [0, 0, 0, 1], got {row.tolist()}{functions.index_of(wrong)}"
        )
    return pose(rotation_from_matrix(m[..., :3, :3]), m[..., :3, 3])


def rotation_from_axis_angle(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return unit quaternions (cos θ/2, n sin θ/2), shape (…, 4), of axes (…, 3), any length, and angles (…).

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value not finite, or an axis zero.

    Examples
    --------
    >>> rotation_from_axis_angle([0, 0, 2], np.pi).round(12).tolist()
    [0.0, 0.0, 0.0, 1.0]
    """
    n = as_array("axis", axis, (3,))
    half = 0.5 * as_array("angle", angle)[..., None]
    functions.broadcast_lead(axis=n, angle=half)
    length = np.linalg.norm(n, axis=-1, keepdims=True)
    if (length == 0).any():
        raise ValueRangeError(f"axis: must not be zero{functions.index_of(length[..., 0] == 0)}")
    vector = np.sin(half) * (n / length)
    return np.concatenate([np.broadcast_to(np.cos(half), (*vector.shape[:-1], 1)), vector], axis=-1)


def axis_angle_from_rotation(rotation: ArrayLike) -> tuple[Array, Array]:
    """Return unit axes (…, 3) and angles (…) in [0, π], rad, of rotations (…, 4); axis x for θ = 0."""
    r = as_unit_quaternion("rotation", rotation)
    r = np.where(r[..., :1] < 0, -r, r)
    sine = np.linalg.norm(r[..., 1:], axis=-1, keepdims=True)
    axis = np.where(sine > 0, r[..., 1:] / np.where(sine > 0, sine, 1), [1.0, 0.0, 0.0])
    return axis, 2 * np.arctan2(sine[..., 0], r[..., 0])


def rotation_from_zyz(angles: ArrayLike) -> Array:
    """Return unit quaternions (…, 4) of ZYZ angles (φ, θ, ψ), shape (…, 3), rad: R = Rz(φ) Ry(θ) Rz(ψ)."""
    phi, theta, psi = np.moveaxis(0.5 * as_array("angles", angles, (3,)), -1, 0)
    c, s = np.cos(theta), np.sin(theta)
    total, difference = phi + psi, phi - psi
    return np.stack(
        [c * np.cos(total), -s * np.sin(difference), s * np.cos(difference), c * np.sin(total)], axis=-1
    )


def zyz_from_rotation(rotation: ArrayLike) -> Array:
    """Return ZYZ Euler angles (φ, θ, ψ), shape (…, 3), rad, of unit quaternions (…, 4) [P16 A.11–A.20].

    θ lies in [0, π], φ and ψ in [−π, π]. Where sin θ = 0 only φ ± ψ is known, and φ is 0.
    """
    return _zyz(*np.moveaxis(as_unit_quaternion("rotation", rotation), -1, 0))


def rotation_from_rpy(angles: ArrayLike) -> Array:
    """Return unit quaternions (…, 4) of (roll, pitch, yaw) (…, 3), rad: R = Rz(yaw) Ry(pitch) Rx(roll)."""
    half = np.moveaxis(0.5 * as_array("angles", angles, (3,)), -1, 0)
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    return np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )


def rpy_from_rotation(rotation: ArrayLike) -> Array:
    """Return (roll, pitch, yaw) (…, 3), rad, of unit quaternions (…, 4): R = Rz(yaw) Ry(pitch) Rx(roll).

    Pitch lies in [−π/2, π/2], roll and yaw in [−π, π]. Where |pitch| = π/2 only roll ∓ yaw is known.
    """
    w, x, y, z = np.moveaxis(as_unit_quaternion("rotation", rotation), -1, 0)
    # R Ry(π/2) = Rz(yaw) Ry(pitch + π/2) Rz(roll): a ZYZ sequence.
    yaw, pitch, roll = np.moveaxis(_zyz(*(np.stack([w - y, x - z, y + w, z + x]) / np.sqrt(2))), -1, 0)
    return np.stack([roll, pitch - np.pi / 2, yaw], axis=-1)


def as_unit_quaternion(field: str, value: ArrayLike) -> Array:
    """Return unit quaternions (…, 4): those written with few digits are normalised, with a `NoteWarning`.

    Raises
    ------
    ShapeError, ValueRangeError
        If the shape is wrong, a value not finite, or a norm further than 1/1000 from 1.
    """
    r = as_array(field, value, (4,))
    norm = np.linalg.norm(r, axis=-1, keepdims=True)
    off = np.abs(norm[..., 0] - 1)
    bad = ~(off <= functions.WRITTEN_TOLERANCE)
    if bad.any():
        unit = ", ".join(f"{each:.6g}" for each in r / norm) if r.ndim == 1 and r.any() else ""
        hint = f"; normalised it is [{unit}]" if unit else ""
        got = f"{norm[..., 0][bad][0]:.9g}{functions.index_of(bad)}"
        raise ValueRangeError(
            f"{field}: must have norm 1 within {functions.WRITTEN_TOLERANCE:g}, got {got}{hint}"
        )
    if (off > functions.UNIT_TOLERANCE).any():
        warnings.warn(
            f"{field}: normalised; its norm was {norm.flat[np.argmax(off)]:.8g}", NoteWarning, stacklevel=2
        )
    return r / norm


def _zyz(w: Array, x: Array, y: Array, z: Array) -> Array:
    """Return the ZYZ angles of a unit quaternion, the first 0 where only a sum is known."""
    cosine, sine = np.hypot(w, z), np.hypot(x, y)  # of θ/2
    mean, difference = np.arctan2(z, w), np.arctan2(-x, y)  # (φ + ψ)/2, (φ − ψ)/2
    degenerate = 2 * sine * cosine <= _DEGENERATE
    near_zero = cosine >= sine
    difference = np.where(degenerate & near_zero, -mean, difference)
    mean = np.where(degenerate & ~near_zero, -difference, mean)
    theta = np.where(degenerate, np.where(near_zero, 0.0, np.pi), 2 * np.arctan2(sine, cosine))
    return np.stack([_wrap(mean + difference), theta, _wrap(mean - difference)], axis=-1)


def _wrap(angle: Array) -> Array:
    """Bring angles within [−2π, 2π] to [−π, π]."""
    return np.where(angle > np.pi, angle - 2 * np.pi, np.where(angle < -np.pi, angle + 2 * np.pi, angle))


def rotation_from_scipy(rotation: Any) -> Array:
    """Return unit quaternions (…, 4), scalar first, of a ``scipy.spatial.transform.Rotation`` of any shape.

    Raises `ShapeError` if it is no such object.
    """
    return as_unit_quaternion("rotation", _attribute("rotation", rotation, "as_quat")()[..., [3, 0, 1, 2]])


def scipy_from_rotation(rotation: ArrayLike) -> Any:
    """Return a ``scipy.spatial.transform.Rotation`` of unit quaternions (…, 4).

    More than one leading axis needs SciPy ≥ 1.17. Raises `ShapeError`, `ValueRangeError` if the shape is
    wrong or a norm is not 1.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(as_unit_quaternion("rotation", rotation)[..., [1, 2, 3, 0]])


def pose_from_se3(placement: Any) -> Array:
    """Return the pose (8,) of a ``pinocchio.SE3``: an object with ``rotation`` and ``translation``.

    Raises `ShapeError` if it has no such attributes, `ValueRangeError` if the rotation is none.
    """
    matrix = as_array("placement.rotation", _attribute("placement", placement, "rotation"), (3, 3))
    return pose(rotation_from_matrix(matrix), np.ravel(_attribute("placement", placement, "translation")))


def se3_from_pose(x: ArrayLike) -> Any:
    """Return the ``pinocchio.SE3`` of one pose (8,).

    Raises `ShapeError`, `ValueRangeError` if x is not (8,) or not unit; `MissingExtraError` if not installed.
    """
    matrix = matrix_from_pose(_single(x))
    return _library("pinocchio").SE3(matrix)


def pose_from_mujoco(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """Return poses (…, 8) of MuJoCo's ``xpos`` (…, 3), m, and ``xquat`` (…, 4), scalar first.

    Raises `ShapeError`, `ValueRangeError` if a shape is wrong, a value not finite or a norm not 1.
    """
    r, p = as_unit_quaternion("quaternion", quaternion), as_array("position", position, (3,))
    functions.broadcast_lead(position=p, quaternion=r)
    return pose(r, p)


def mujoco_from_pose(x: ArrayLike) -> tuple[Array, Array]:
    """Return MuJoCo's ``xpos`` (…, 3), m, and ``xquat`` (…, 4), scalar first, of poses (…, 8).

    Raises `ShapeError`, `ValueRangeError` if x is not (…, 8) or not unit.
    """
    x = functions.as_unit("x", x)
    return functions.translation(x), x[..., :4].copy()


def pose_from_dqrobotics(x: Any) -> Array:
    """Return the coefficients (8,) of a ``dqrobotics.DQ``: same order, same convention x = r + ε½pr.

    Raises `ShapeError` if it is no such object.
    """
    return as_array("x", _attribute("x", x, "vec8")(), (8,)).copy()


def dqrobotics_from_pose(x: ArrayLike) -> Any:
    """Return the ``dqrobotics.DQ`` of one pose (8,).

    Raises `ShapeError`, `ValueRangeError` if x is not (8,) or not unit; `MissingExtraError` if not installed.
    """
    x = _single(x)
    return _library("dqrobotics").DQ(x)


def _single(x: ArrayLike) -> Array:
    x = functions.as_unit("x", x)
    if x.ndim > 1:
        raise ShapeError(f"x: expected one pose, shape (8,), got shape {x.shape}")
    return x


def _attribute(field: str, value: Any, name: str) -> Any:
    try:
        return getattr(value, name)
    except AttributeError:
        raise ShapeError(f"{field}: expected an object with '{name}', got {value!r:.80}") from None


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError(
            f"{name.split('.')[0]}: not installed, and needed to make its object"
        ) from None
