"""Floor, light and sky for pictures of arms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.films.link_meshes import LinkMesh, mesh_corners
from dqcontrol.robots.files.description import drawn_reach

if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.robots.robot import Robot


@dataclass(frozen=True)
class Framing:
    """Where to look, and how large everything is.

    Attributes
    ----------
    reach
        Length of the arm, m.
    floor
        Height of the floor, m.
    stands
        Whether what stands on the floor is drawn; otherwise a pedestal leads up to an arm above it.
    middle
        Where to look at, shape (3,), m.
    distance
        From where, m.
    """

    reach: float
    floor: float
    middle: Array
    distance: float
    stands: bool = False


def some_samples(record: Record, most: int) -> NDArray[np.int_]:
    """Return at most so many samples of a record, equally far apart, the first and the last among them."""
    return np.linspace(0, len(record.q) - 1, min(len(record.q), most)).astype(int)


def framing_of_arm(robot: Robot, q: Array, points: Array, meshes: list[LinkMesh]) -> Framing:
    """Return the room of an arm at configurations (N, n), rad or m, and of points (M, 3), m."""
    reach = drawn_reach(robot)
    corners = mesh_corners(robot, q, meshes)
    everything = np.vstack([points, translation(robot.frames(q).reshape(-1, 8)), corners, [np.zeros(3)]])
    lower, upper = everything.min(axis=0), everything.max(axis=0)
    if meshes:  # down to the feet
        floor = min(0.0, float(lower[2]))
    else:
        floor = min(0.0, lower[2] - 0.06 * reach) if lower[2] < -0.01 * reach else 0.0
    distance = 1.45 * float(np.linalg.norm(upper - lower)) + 0.2 * reach
    stands = bool(len(corners)) and bool(corners[:, 2].min() < floor + 0.01 * reach)
    return Framing(reach, floor, 0.5 * (lower + upper), distance, stands)


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
