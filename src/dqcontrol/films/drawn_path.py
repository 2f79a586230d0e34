"""Paths of the hand in pictures of physics: strings of capsules."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

DESIRED = (0.05, 0.45, 0.90, 1.0)
ACTUAL = (0.98, 0.25, 0.12, 1.0)
_DASH = 0.045  # of the arm's length


def add_desired(mujoco: Any, scene: Any, points: NDArray[np.float64], reach: float, pieces: int) -> None:
    """Add the desired path, shape (N, 3), m: dashed and blue, for an arm of length ``reach``, m."""
    _add(mujoco, scene, _thinned(points, pieces), 0.005 * reach, DESIRED, _DASH * reach)


def add_actual(mujoco: Any, scene: Any, points: NDArray[np.float64], reach: float, pieces: int) -> None:
    """Add the end effector's path, shape (N, 3), m: red, for an arm of length ``reach``, m."""
    _add(mujoco, scene, _thinned(points, pieces), 0.004 * reach, ACTUAL, 0.0)


def add_mark(mujoco: Any, scene: Any, place: NDArray[np.float64], reach: float, words: str) -> None:
    """Add a ball at a place of a path, shape (3,), m, with words beside it."""
    geom = scene.geoms[scene.ngeom]
    kind, rgba = mujoco.mjtGeom.mjGEOM_SPHERE, np.array(DESIRED, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.full(3, 0.015 * reach), place, np.eye(3).ravel(), rgba)
    geom.label = words
    scene.ngeom += 1


def _thinned(points: NDArray[np.float64], most: int) -> NDArray[np.float64]:
    """Return at most so many of the points, the first and the last among them."""
    return points[np.linspace(0, len(points) - 1, min(len(points), most)).astype(int)]


def _add(
    mujoco: Any,
    scene: Any,
    points: NDArray[np.float64],
    radius: float,
    colour: tuple[float, ...],
    dash: float,
) -> None:
    """Add a path as a string of capsules; with a dash length, m, the second half of each is left out."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middle = np.cumsum(steps) - 0.5 * steps
    drawn = steps > 0 if not dash else middle % dash < 0.45 * dash
    kind, rgba, zero = mujoco.mjtGeom.mjGEOM_CAPSULE, np.array(colour, dtype=np.float32), np.zeros(9)
    for i in np.flatnonzero(drawn):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, kind, zero[:3], zero[:3], zero, rgba)
        mujoco.mjv_connector(geom, kind, radius, points[i], points[i + 1])
        scene.ngeom += 1
