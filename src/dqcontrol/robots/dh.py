"""Denavit–Hartenberg parameters as fixed poses and screws about z."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, as_array, unknown_name

JOINT_TYPES = ("revolute", "prismatic")
CONVENTIONS = ("standard", "modified")  # of DH tables


def rotation_z(angle: float) -> NDArray[np.float64]:
    """Return the pose (7,) ``[quaternion, position]`` of a rotation about z."""
    return np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2), 0, 0, 0])


def rotation_x(angle: float) -> NDArray[np.float64]:
    """Return the pose (7,) of a rotation about x."""
    return np.array([np.cos(angle / 2), np.sin(angle / 2), 0, 0, 0, 0, 0])


def rotation_y(angle: float) -> NDArray[np.float64]:
    """Return the pose (7,) of a rotation about y."""
    return np.array([np.cos(angle / 2), 0, np.sin(angle / 2), 0, 0, 0, 0])


def shift(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    """Return the pose (7,) of a translation."""
    return np.array([1.0, 0, 0, 0, x, y, z])


def compose(*poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the product of poses (7,) ``[quaternion, position]``, left to right."""
    r, p = np.array([1.0, 0, 0, 0]), np.zeros(3)
    for pose in poses:
        w, v = r[0], r[1:]
        p = p + pose[4:] + 2 * _cross(v, w * pose[4:] + _cross(v, pose[4:]))
        r = np.concatenate(
            [[w * pose[0] - v @ pose[1:4]], w * pose[1:4] + pose[0] * v + _cross(v, pose[1:4])]
        )
    return np.concatenate([r / np.linalg.norm(r), p])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a × b of two vectors (3,), without what `numpy.cross` does for arrays."""
    a, b = a.tolist(), b.tolist()
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def chain_from_dh(
    theta: ArrayLike,
    d: ArrayLike,
    a: ArrayLike,
    alpha: ArrayLike,
    joint_types: list[str] | None,
    convention: str,
) -> tuple[list[NDArray[np.float64]], list[str]]:
    """Return the n + 1 fixed poses (7,) and the n joint types of a DH table.

    Standard: X = Rz(θ) Tz(d) Tx(a) Rx(α); modified (Craig): X = Tx(a) Rx(α) Rz(θ) Tz(d). The joint variable adds to θ
    (revolute) or to d (prismatic); both commute with the rest of Rz Tz, so each X is a fixed pose and a screw about z.
    """
    rows, types = _table({"theta": theta, "d": d, "a": a, "alpha": alpha}, joint_types)
    if convention not in CONVENTIONS:
        raise unknown_name("convention", convention, CONVENTIONS)

    fixed = [shift()]
    for th, dd, aa, al in rows:
        about_z, about_x = compose(rotation_z(th), shift(z=dd)), compose(shift(x=aa), rotation_x(al))
        if convention == "standard":
            fixed.append(compose(about_z, about_x))
        else:
            fixed[-1] = compose(fixed[-1], about_x, about_z)
            fixed.append(shift())
    return fixed, types


def chain_from_denso(
    a: ArrayLike,
    b: ArrayLike,
    d: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
    gamma: ArrayLike,
    joint_types: list[str] | None,
) -> tuple[list[NDArray[np.float64]], list[str]]:
    """Return the n + 1 fixed poses (7,) and the n joint types of a table in DENSO's convention.

    X = Rz(γ) T(a, b, d) Rx(α) Ry(β); the joint variable adds to γ (revolute) or to d (prismatic).
    """
    rows, types = _table({"a": a, "b": b, "d": d, "alpha": alpha, "beta": beta, "gamma": gamma}, joint_types)
    fixed = [shift()]
    for aa, bb, dd, al, be, ga in rows:
        fixed.append(compose(rotation_z(ga), shift(aa, bb, dd), rotation_x(al), rotation_y(be)))
    return fixed, types


def _table(
    parameters: dict[str, ArrayLike], joint_types: list[str] | None
) -> tuple[NDArray[np.float64], list[str]]:
    """Return one row of parameters a joint, and the joint types."""
    columns = {field: as_array(field, value, (None,)) for field, value in parameters.items()}
    first = next(iter(columns))
    n = len(columns[first])
    if n == 0:
        raise ShapeError(f"{first}: a robot needs at least one joint")
    for field, value in columns.items():
        if value.shape != (n,):
            raise ShapeError(f"{field}: expected {n} numbers as in {first}, got shape {value.shape}")
    types = list(joint_types) if joint_types is not None else ["revolute"] * n
    if len(types) != n:
        raise ShapeError(f"joint_types: expected {n} entries, got {len(types)}")
    for kind in types:
        if kind not in JOINT_TYPES:
            raise unknown_name("joint_types", str(kind), JOINT_TYPES)
    return np.column_stack(list(columns.values())), types
