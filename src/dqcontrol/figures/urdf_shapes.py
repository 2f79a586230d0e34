"""What URDF and MJCF files say their links look like."""

from __future__ import annotations

import functools
import io
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, NoteWarning
from dqcontrol.files.input_file import read_whole
from dqcontrol.robots import SerialArm
from dqcontrol.robots.files.mesh_files import mesh_file, missing_note
from dqcontrol.robots.files.mjcf_geometry import geom_mesh, shown_geoms
from dqcontrol.robots.files.urdf import UrdfTree, origin_matrix
from dqcontrol.robots.files.urdf_xml import CheckedXml
from dqcontrol.robots.poses import pose7
from dqcontrol.robots.robot import PlacedLinks

Drawn = tuple[int, Any, tuple[int, int, int]]

_PLAIN = (200, 203, 208)
_MESHES = ("dae", "stl", "obj", "ply", "off", "glb")  # none that is an archive, which may hold any amount
_LARGEST_MESH = 200_000_000  # bytes


def urdf_shapes(path: Path, base_link: str, arm: SerialArm) -> list[Drawn]:
    """Return the row of `SerialArm.frames` that carries each visual, −1 for the base, its mesh there, and its colour.

    Joints that are not the arm's rest at zero. Without any visuals there are none; nor if a mesh is not found, which a
    `NoteWarning` names.

    Parameters
    ----------
    path
        The URDF file.
    base_link
        Link in whose frame the arm's poses are.
    arm
        The chain that was read from it.
    """
    tree = UrdfTree(CheckedXml(path))
    frames = arm.frames(np.zeros(arm.configuration_size))[:-1]
    homes = [np.eye(4), *(pose_matrix(pose7("frame", frame)) for frame in frames)]
    places = tree.places(arm.joint_names)
    links = {link: (place, carrier) for link, place, carrier in places}
    to_base = np.linalg.inv(links[base_link][0])
    drawn: list[Drawn] = []
    for link, (place, carrier) in links.items():
        for visual in tree.links[link].visuals:
            at = np.linalg.inv(homes[carrier]) @ to_base @ place @ origin_matrix(visual)
            try:
                pieces = list(_geometry(path, visual))
            except FileNotFoundError:
                warnings.warn(missing_note(path), NoteWarning, stacklevel=2)
                return []
            for mesh, colour in pieces:
                drawn.append((carrier - 1, mesh.copy().apply_transform(at), colour))
    return drawn


def _geometry(urdf: Path, visual: Any) -> Iterator[tuple[Any, tuple[int, int, int]]]:
    """Yield the pieces of a visual, and their colours."""
    import trimesh

    shape, colour = visual.geometry, _material(visual)
    if shape.box is not None:
        yield trimesh.creation.box(shape.box.size), colour or _PLAIN
    elif shape.cylinder is not None:
        cylinder = trimesh.creation.cylinder(shape.cylinder.radius, shape.cylinder.length, sections=40)
        yield cylinder, colour or _PLAIN
    elif shape.sphere is not None:
        yield trimesh.creation.icosphere(3, shape.sphere.radius), colour or _PLAIN
    elif shape.mesh is not None:
        scale = np.ones(3) if shape.mesh.scale is None else np.broadcast_to(shape.mesh.scale, 3)
        for mesh, own in _loaded(mesh_file(urdf, shape.mesh.filename)):
            yield mesh.copy().apply_transform(np.diag([*scale, 1.0])), colour or own


def _material(visual: Any) -> tuple[int, int, int] | None:
    colour = visual.material.color if visual.material is not None else None
    if colour is None or colour.rgba is None:
        return None
    r, g, b = (round(255 * float(c)) for c in colour.rgba[:3])
    return r, g, b


@functools.cache
def _loaded(path: Path) -> list[tuple[Any, tuple[int, int, int]]]:
    """Return the meshes of a file with their colours."""
    import trimesh

    kind = path.suffix.lower().removeprefix(".")
    if kind not in _MESHES:
        raise FileFormatError(f"{path}: is no mesh that is read here (allowed: {', '.join(_MESHES)})")
    data = read_whole(path, _LARGEST_MESH)
    if kind == "dae" and any(
        word in data.replace(b"\0", b"").upper() for word in (b"<!DOCTYPE", b"<!ENTITY")
    ):
        raise FileFormatError(f"{path}: declares a document type or entities, refused for safety")
    try:
        scene: Any = trimesh.load_scene(io.BytesIO(data), file_type=kind)
    except Exception as error:  # readers of damaged files raise anything
        raise FileFormatError(f"{path}: cannot be read as a mesh: {error}") from None
    return [(mesh, _own_colour(mesh)) for mesh in scene.dump() if hasattr(mesh, "faces")]


def _own_colour(mesh: Any) -> tuple[int, int, int]:
    if not mesh.visual.defined:
        return _PLAIN
    material = getattr(mesh.visual, "material", None)
    r, g, b = (material if material is not None else mesh.visual).main_color[:3]
    return int(r), int(g), int(b)


def pose_matrix(pose: Array) -> Array:
    """Return the homogeneous matrix of a pose (7,), [quaternion, position]."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = algebra.matrix_from_rotation(pose[:4]), pose[4:]
    return matrix


def placed_shapes(placed: PlacedLinks) -> list[Drawn]:
    """Return what links of a URDF or MJCF file look like: the row of `Robot.frames`, −1 for the base, mesh and colour.

    Without any visuals there are none; nor if a mesh is not found, which a `NoteWarning` names.
    """
    drawn: list[Drawn] = []
    if placed.path.suffix.lower() == ".xml":
        for geom in shown_geoms(placed.path):
            frame = placed.frames[geom.body]
            drawn.append((frame.joint, geom_mesh(geom).apply_transform(pose_matrix(frame.pose)), geom.colour))
        return drawn
    links = UrdfTree(CheckedXml(placed.path)).links
    for name, frame in placed.frames.items():
        for visual in links[name].visuals if name in links else ():
            at = pose_matrix(frame.pose) @ origin_matrix(visual)
            try:
                pieces = list(_geometry(placed.path, visual))
            except FileNotFoundError:
                warnings.warn(missing_note(placed.path), NoteWarning, stacklevel=2)
                return []
            drawn += [(frame.joint, mesh.copy().apply_transform(at), colour) for mesh, colour in pieces]
    return drawn
