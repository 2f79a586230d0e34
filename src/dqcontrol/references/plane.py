"""Planes in the inertial frame: which way a sheet of paper lies."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.references.yaml_form import Vector, Yaml

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
PLANES = ("xy", "xz", "yz")

Plane = Annotated[
    str | ArrayLike,
    Yaml(
        Annotated[
            Literal["xy", "xz", "yz"] | tuple[Vector, Vector],
            Meta(description="base axes, or two perpendicular vectors: to the right and up"),
        ]
    ),
]
Axis = Annotated[str | ArrayLike, Yaml(Literal["x", "y", "z"] | Vector)]


def plane_axes(field: str, plane: Plane) -> NDArray[np.float64]:
    """Return the two unit axes (2, 3) of a plane: u to the right, v up; its normal is u × v.

    Parameters
    ----------
    field
        Name for the error message.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors of any length, (2, 3), inertial frame.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the name is unknown, or the vectors are no vectors, zero or not perpendicular.

    Examples
    --------
    >>> plane_axes("plane", "xz").tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if isinstance(plane, str):
        if plane not in PLANES:
            raise unknown_name(field, plane, PLANES)
        return np.array([AXES[plane[0]], AXES[plane[1]]])
    axes = as_array(field, plane, (2, 3))
    if axes.shape != (2, 3):
        raise ShapeError(f"{field}: expected shape (2, 3), got {axes.shape}")
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if (lengths < 1e-9).any():
        raise ValueRangeError(f"{field}: must have no zero axis, got {axes.tolist()}")
    axes = axes / lengths
    if abs(axes[0] @ axes[1]) > 1e-6:
        angle = np.degrees(np.arccos(axes[0] @ axes[1]))
        raise ValueRangeError(f"{field}: must have perpendicular axes, got {angle:.6g} degrees between them")
    axes[1] -= (axes[0] @ axes[1]) * axes[0]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def plane_across(field: str, axis: str | ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the plane (2, 3) across an axis, and the unit axis (3,).

    v is the vertical z without its part along the axis (y if the axis is vertical); u is perpendicular to
    both, with its first non-zero component positive. So ``"x"`` gives the plane yz, ``"y"`` xz, ``"z"`` xy.

    Parameters
    ----------
    field
        Name for the error message.
    axis
        ``"x"``, ``"y"``, ``"z"`` or a vector (3,), inertial frame.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the name is unknown, or the vector is no vector or zero.
    """
    if isinstance(axis, str):
        if axis not in AXES:
            raise unknown_name(field, axis, AXES)
        axis = AXES[axis]
    along = as_array(field, axis, (3,))
    length = np.linalg.norm(along)
    if along.shape != (3,) or length < 1e-9:
        raise ValueRangeError(
            f"{field}: expected 'x', 'y', 'z' or a non-zero vector (3,), got {along.tolist()}"
        )
    along = along / length
    up = np.array(AXES["z"] if abs(along[2]) < 1 - 1e-9 else AXES["y"])
    v = up - (up @ along) * along
    v /= np.linalg.norm(v)
    u = np.cross(v, along)
    first = u[np.argmax(np.abs(u) > 1e-9)]
    return np.array([u if first > 0 else -u, v]) + 0.0, along
