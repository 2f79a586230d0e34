"""Floor, light and sky for pictures of arms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dqcontrol.films.framing import Framing


def add_scene_background(
    mujoco: Any, spec: Any, framing: Framing, azimuth: float, size: tuple[int, int]
) -> None:
    """Add a chequered floor, three lights and a pale sky to a model that is to be drawn.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mjSpec`` of the model.
    framing
        Its reach, with which everything scales, the height of the floor, and whether a pedestal leads up from there.
    azimuth
        Direction of view, degrees; the lights follow the viewer.
    size
        Width and height of the picture, pixels.
    """
    reach, floor = framing.reach, framing.floor
    textures = mujoco.mjtTexture
    sky = spec.add_texture(
        name="sky", type=textures.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT
    )
    sky.rgb1, sky.rgb2, sky.width, sky.height = (0.97, 0.98, 1.0), (0.72, 0.79, 0.87), 512, 3072
    tiles = spec.add_texture(
        name="tiles", type=textures.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER
    )
    tiles.rgb1, tiles.rgb2, tiles.width, tiles.height = (0.80, 0.82, 0.85), (0.70, 0.73, 0.77), 512, 512
    material = spec.add_material(name="floor", texrepeat=(8, 8), texuniform=False)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    side = 3.0 * reach
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, 0, floor],
        size=[side, side, 0.1],
        material="floor",
        contype=0,
        conaffinity=0,
    )
    if floor < 0 and not framing.stands:
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[0, 0, floor, 0, 0, 0],
            size=[0.06 * reach, 0, 0],
            rgba=(0.25, 0.27, 0.30, 1.0),
            contype=0,
            conaffinity=0,
        )
    if hasattr(mujoco, "mjtLightType"):
        directional = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL}
    else:  # early MuJoCo 3.3
        directional = {"directional": True}
    for beside, up, strength, shadow in ((-25, 1.5, 0.5, True), (70, 1.0, 0.22, False)):
        towards = math.radians(azimuth + 180 + beside)
        spot = reach * np.array([math.cos(towards), math.sin(towards), up])
        spec.worldbody.add_light(
            pos=spot,
            dir=-spot / np.linalg.norm(spot),
            **directional,
            castshadow=shadow,
            diffuse=[strength] * 3,
            specular=[0.25] * 3,
        )
    spec.visual.headlight.ambient = [0.38] * 3
    spec.visual.headlight.diffuse = [0.28] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.global_.fovy = 38
    # Facets of coarse cylinders cast shadows onto themselves.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 64, 16
    spec.visual.quality.shadowsize = 8192
    spec.visual.quality.offsamples = 4
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50
    spec.stat.extent, spec.stat.center = reach, (0, 0, 0.4 * reach)
