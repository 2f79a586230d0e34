"""Robots that show through others in one picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

COLOURS = (
    (0.13, 0.42, 0.85),
    (0.93, 0.53, 0.10),
    (0.20, 0.60, 0.30),
    (0.60, 0.30, 0.70),
)  # of further runs, in turn


def add_ghost(
    mujoco: Any,
    model: Any,
    data: Any,
    scene: Any,
    opacity: float,
    colour: tuple[float, float, float] | None = None,
    moved: ArrayLike = (0.0, 0.0, 0.0),
) -> None:
    """Add to MuJoCo's scene what moves, as it stands in ``data``, for the scene behind to show through.

    Parameters
    ----------
    mujoco
        The module.
    model, data
        Of what is added; kinematics are computed already.
    scene
        Has room for as many shapes as the model.
    opacity
        1 hides what is behind.
    colour
        In place of the shapes' own.
    moved
        How far all shapes are moved, m: a little away from the viewer, so that they stay behind others in their place.
    """
    first = scene.ngeom
    moving = mujoco.mjtCatBit.mjCAT_DYNAMIC.value
    options = mujoco.MjvOption()
    options.geomgroup[4] = 0
    mujoco.mjv_addGeoms(model, data, options, mujoco.MjvPerturb(), moving, scene)
    for geom in scene.geoms[first : scene.ngeom]:
        if colour is not None:
            geom.rgba[:3] = np.array(colour, dtype=np.float32)
        geom.rgba[3] = opacity
        geom.pos[:] += np.asarray(moved)
