"""The meshes of URDF and MJCF files on the bodies of a MuJoCo model, in place of rods and drums."""

from __future__ import annotations

import importlib.util
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.figures.robot_bodies import arm_meshes, chain_rows, smoothed
from dqcontrol.plants.mujoco.mujoco_model import RODS
from dqcontrol.robots import Robot
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import base_coordinates

_FLAT = 1e-9  # m²; MuJoCo refuses meshes without area


class LinkMesh(NamedTuple):
    """A mesh that moves with row ``row`` of `Robot.frames`, −1 for one that stands still, and its colour 0 … 1."""

    row: int
    vertices: Array
    faces: NDArray[np.int64]
    colour: tuple[float, float, float, float]


def link_meshes(robot: Robot) -> list[LinkMesh]:
    """Return the meshes of a robot's files, as the browser view shows them; none without files or trimesh."""
    found: list[LinkMesh] = []
    if importlib.util.find_spec("trimesh") is None:
        return found
    for _, meshes in arm_meshes(robot):
        for row, mesh, colour in meshes:
            if mesh.area >= _FLAT and len(mesh.vertices) >= 4:
                red, green, blue = (value / 255 for value in colour)
                found.append(LinkMesh(row, *smoothed(mesh), (red, green, blue, 1.0)))
    return found


def add_meshes(spec: Any, robot: Robot, meshes: list[LinkMesh]) -> None:
    """Draw meshes on the bodies of an ``mjSpec`` of a robot, and hide the rods of the arms that they show."""
    mujoco, bases = import_mujoco(), int(base_coordinates(robot).sum())
    fixed = spec.body("base") if bases else spec.worldbody
    for i, (row, vertices, faces, colour) in enumerate(meshes):
        mesh = spec.add_mesh(name=f"mesh_{i + 1}", uservert=vertices.ravel(), userface=faces.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # many are not closed
        body = spec.body(f"link_{row - bases + 1}") if row >= bases else fixed
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, rgba=colour, mass=0)
        geom.contype = geom.conaffinity = 0
    rows = {mesh.row for mesh in meshes}
    for own in chain_rows(robot):
        if rows.isdisjoint(own):
            continue
        for body in (
            *(spec.body(f"link_{row - bases + 1}") for row in own),
            *([fixed] if own.start == bases else []),
        ):
            for geom in body.geoms:
                if geom.group == RODS:
                    geom.rgba = (*geom.rgba[:3], 0.0)  # which is not drawn


def mesh_corners(robot: Robot, q: Array, meshes: list[LinkMesh]) -> Array:
    """Return the corners of the meshes' boxes at configurations (N, n), rad or m, shape (M, 3), m."""
    frames, points = robot.frames(q), [np.zeros((0, 3))]
    for row in sorted({mesh.row for mesh in meshes}):
        vertices = np.vstack([mesh.vertices for mesh in meshes if mesh.row == row])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        if row < 0:
            points.append(corners)
            continue
        places = algebra.matrix_from_pose(frames[..., row, :]).reshape(-1, 4, 4)
        moved = places[:, None, :3, :3] @ corners[..., None]
        points.append((moved[..., 0] + places[:, None, :3, 3]).reshape(-1, 3))
    return np.vstack(points)
