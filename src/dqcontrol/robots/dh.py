"""Denavit–Hartenberg parameters as fixed poses and screws about z."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array, unknown_name
from dqcontrol.robots.poses import compose, rotation_x, rotation_y, rotation_z, shift

JOINT_TYPES = ("revolute", "prismatic")
CONVENTIONS = ("standard", "modified")  # of DH tables


def chain_from_dh(
    theta: ArrayLike,
    d: ArrayLike,
    a: ArrayLike,
    alpha: ArrayLike,
    joint_types: list[str] | None,
    convention: str,
) -> tuple[list[Array], list[str]]:
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
) -> tuple[list[Array], list[str]]:
    """Return the n + 1 fixed poses (7,) and the n joint types of a table in DENSO's convention.

    X = Rz(γ) T(a, b, d) Rx(α) Ry(β); the joint variable adds to γ (revolute) or to d (prismatic).
    """
    rows, types = _table({"a": a, "b": b, "d": d, "alpha": alpha, "beta": beta, "gamma": gamma}, joint_types)
    fixed = [shift()]
    for aa, bb, dd, al, be, ga in rows:
        fixed.append(compose(rotation_z(ga), shift(aa, bb, dd), rotation_x(al), rotation_y(be)))
    return fixed, types


def _table(parameters: dict[str, ArrayLike], joint_types: list[str] | None) -> tuple[Array, list[str]]:
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
    return np.column_stack(list(columns.values())), types
