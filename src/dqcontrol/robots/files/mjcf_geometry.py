"""The geoms of MJCF files: what bodies look like, and what of them collides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra.conversions import matrix_from_pose, pose
from dqcontrol.arrays import Array
from dqcontrol.robots.files.mjcf import MjcfFile

GeomKind: TypeAlias = Literal["sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh"]

_FIRST_HIDDEN = 3  # group, from which on MuJoCo's viewer shows nothing unless asked
_PLAIN = (200, 203, 208)


@dataclass(frozen=True)
class Geom:
    """A geom of a body.

    Attributes
    ----------
    body, name
        Of what it is, and its own; ``BODY.2`` for the second without one.
    kind
        Planes and height fields are left out: they are surroundings.
    size
        As MuJoCo has it: radius; radius and half length; half axes; half edges; of a mesh nothing.
    place
        Of its frame in the body's, shape (4, 4).
    vertices, faces
        Of a mesh, in its own frame.
    colour
        Red, green and blue, 0 … 255.
    group
        From 3 on it is not shown by default.
    collides
        Whether it touches anything at all.
    """

    body: str
    name: str
    kind: GeomKind
    size: Array
    place: Array
    vertices: Array
    faces: NDArray[np.int64]
    colour: tuple[int, int, int]
    group: int
    collides: bool


def mjcf_geoms(path: str | Path) -> list[Geom]:
    """Return the geoms of all bodies of an MJCF file, as MuJoCo has compiled them.

    Raises
    ------
    MissingExtraError, FileFormatError
        As for `mjcf_tree`.
    """
    file = MjcfFile(path)
    return list(_geoms(file.mujoco, file.model, file.body_names))


def shown_geoms(path: str | Path) -> list[Geom]:
    """Return the geoms that are to be seen: those that MuJoCo's viewer shows, or all where it shows none."""
    every = mjcf_geoms(path)
    return [geom for geom in every if geom.group < _FIRST_HIDDEN] or every


def geom_mesh(geom: Geom) -> Any:
    """Return a geom as a mesh (trimesh) in its body's frame."""
    import trimesh

    size = geom.size
    if geom.kind == "mesh":
        mesh = trimesh.Trimesh(geom.vertices, geom.faces)
    elif geom.kind == "box":
        mesh = trimesh.creation.box(2 * size)
    elif geom.kind == "cylinder":
        mesh = trimesh.creation.cylinder(size[0], 2 * size[1], sections=40)
    elif geom.kind == "capsule":
        mesh = trimesh.creation.capsule(2 * size[1], size[0], count=[24, 24])
        mesh.apply_translation([0, 0, -mesh.bounds.mean(axis=0)[2]])
    else:
        mesh = trimesh.creation.icosphere(3, 1.0)
        mesh.apply_scale(size[0] if geom.kind == "sphere" else size)
    return mesh.apply_transform(geom.place)


def _geoms(mujoco: Any, model: Any, bodies: list[str]) -> Iterator[Geom]:
    kinds = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")): kind for kind in GeomKind.__args__}
    counts: dict[str, int] = {}
    for g in range(model.ngeom):
        kind, body = kinds.get(int(model.geom_type[g])), bodies[int(model.geom_bodyid[g])]
        if kind is None:
            continue
        counts[body] = counts.get(body, 0) + 1
        own = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, g)
        vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        if kind == "mesh":
            data = int(model.geom_dataid[g])
            first, count = int(model.mesh_vertadr[data]), int(model.mesh_vertnum[data])
            vertices = np.array(model.mesh_vert[first : first + count], np.float64)
            first, count = int(model.mesh_faceadr[data]), int(model.mesh_facenum[data])
            faces = np.array(model.mesh_face[first : first + count], np.int64)
        yield Geom(
            body,
            own or (body if counts[body] == 1 else f"{body}.{counts[body]}"),
            kind,
            model.geom_size[g].copy(),
            matrix_from_pose(pose(model.geom_quat[g], model.geom_pos[g])),
            vertices,
            faces,
            _colour(model, g),
            int(model.geom_group[g]),
            bool(model.geom_contype[g] or model.geom_conaffinity[g]),
        )


def _colour(model: Any, geom: int) -> tuple[int, int, int]:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    if material < 0 and np.allclose(rgba, [0.5, 0.5, 0.5, 1.0]):  # MuJoCo's default
        return _PLAIN
    red, green, blue = (round(255 * float(part)) for part in rgba[:3])
    return red, green, blue
