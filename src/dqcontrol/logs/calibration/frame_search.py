"""Where camera and target are, from nothing but measured poses: closed forms to begin with."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import matrix_from_rotation, rotation_from_matrix
from dqcontrol.arrays import Array
from dqcontrol.logs.calibration.measured_poses import MeasuredPoses
from dqcontrol.robots import SerialArm
from dqcontrol.robots.dh import shift
from dqcontrol.robots.poses import positions


def searched_frames(arm: SerialArm, measured: MeasuredPoses) -> tuple[Array, Array]:
    """Return the poses (7,) of the arm's base in the measuring frame and of the target in the hand, M = Y F X.

    With orientations the rotations come from the singular vectors of Σ R_F ⊗ R_M and the positions from a linear system
    (Shah 2013); with positions alone the target is taken to be at the end effector, and the base from an orthogonal
    fit.
    """
    hand = arm.fkm(measured.q)
    turned, points = matrix_from_rotation(hand[:, :4]), positions(hand)
    if measured.rotation is None:
        middle, seen = points.mean(axis=0), measured.position.mean(axis=0)
        turn = _nearest_rotation((measured.position - seen).T @ (points - middle))
        return _pose(turn, seen - turn @ middle), shift()
    seen = matrix_from_rotation(measured.rotation)
    product = sum(np.kron(of_hand, of_seen) for of_hand, of_seen in zip(turned, seen, strict=True))
    left, _, right = np.linalg.svd(product)
    base = _nearest_rotation(left[:, 0].reshape(3, 3).T)
    tool = _nearest_rotation(right[0].reshape(3, 3).T).T
    if np.sum((base @ turned @ tool - seen) ** 2) > np.sum((-base @ turned @ tool - seen) ** 2):
        base = _nearest_rotation(-left[:, 0].reshape(3, 3).T)
    rows = np.concatenate([np.concatenate([base @ each, np.eye(3)], axis=1) for each in turned])
    found = np.linalg.lstsq(rows, (measured.position - points @ base.T).ravel(), rcond=None)[0]
    return _pose(base, found[3:]), _pose(tool, found[:3])


def _nearest_rotation(matrix: Array) -> Array:
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1, 1, np.sign(np.linalg.det(left @ right))]) @ right


def _pose(rotation: Array, position: NDArray[Any]) -> Array:
    return np.concatenate([rotation_from_matrix(rotation), position])
