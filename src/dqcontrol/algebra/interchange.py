"""Poses of other libraries: SciPy, Pinocchio, MuJoCo and DQ Robotics.

Their values are read by their attributes, so that nothing is imported; a library is imported only to make one
of its objects.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra.batch import as_unit, broadcast_lead
from dqcontrol.algebra.conversions import as_unit_quaternion, matrix_from_pose, pose, rotation_from_matrix
from dqcontrol.algebra.functions import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import MissingExtraError, ShapeError, as_array


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

    r = as_unit_quaternion("rotation", rotation)
    return Rotation.from_quat(r[..., [1, 2, 3, 0]])


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
    broadcast_lead(position=p, quaternion=r)
    return pose(r, p)


def mujoco_from_pose(x: ArrayLike) -> tuple[Array, Array]:
    """Return MuJoCo's ``xpos`` (…, 3), m, and ``xquat`` (…, 4), scalar first, of poses (…, 8).

    Raises `ShapeError`, `ValueRangeError` if x is not (…, 8) or not unit.
    """
    x = as_unit("x", x)
    return translation(x), x[..., :4].copy()


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
    x = as_unit("x", x)
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
