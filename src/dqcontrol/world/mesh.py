"""Meshes of bodies: read, refused where they are open or huge, and taken apart into convex parts."""

from __future__ import annotations

import importlib
from functools import lru_cache
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, MissingExtraError
from dqcontrol.geometry import Box

_MOST_FACES = 500_000  # taking them apart takes minutes beyond
_THRESHOLD = 0.05  # of CoACD: concavity that a part may have, as a share of the mesh's size
_CONVEX = 0.999  # of a hull's volume


@lru_cache(maxsize=16)
def convex_parts(file: str) -> tuple[Any, ...]:
    """Return the convex hulls, as trimesh has them, of the convex parts of a mesh; of one convex already, itself.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or the mesh is open or has more than half a million faces.
    MissingExtraError
        If coacd, which takes meshes apart, is not installed.
    """
    import trimesh

    try:
        mesh: Any = trimesh.load(file, force="mesh")
    except Exception as error:  # of each format's reader its own
        raise FileFormatError(f"mesh: {file} cannot be read: {error or type(error).__name__}") from None
    if len(mesh.faces) > _MOST_FACES:
        raise FileFormatError(
            f"mesh: {file} has {len(mesh.faces):,} faces, at most {_MOST_FACES:,}; simplify it"
        )
    if not mesh.is_watertight:
        raise FileFormatError(f"mesh: {file} is open: nothing says what is inside of it; close its holes")
    hull = mesh.convex_hull
    if abs(mesh.volume) > _CONVEX * hull.volume:
        return (hull,)
    try:
        coacd: Any = importlib.import_module("coacd")
    except ImportError:
        raise MissingExtraError(
            f"mesh: {file} is not convex, and taking it apart needs coacd: pip install 'dqcontrol[mesh]'"
        ) from None
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=_THRESHOLD)
    return tuple(trimesh.Trimesh(*part).convex_hull for part in parts)


def box_around(hull: Any) -> Box:
    """Return the smallest box around a convex part."""
    to_box, size = (
        hull.bounding_box_oriented.primitive.transform,
        hull.bounding_box_oriented.primitive.extents,
    )
    matrix = np.asarray(to_box, np.float64)
    return Box(
        algebra.pose(algebra.rotation_from_matrix(matrix[:3, :3]), matrix[:3, 3]),
        np.asarray(size, np.float64),
    )


def excess(hull: Any, box: Box) -> float:
    """Return how far a corner of the box around a part is from the part, m."""
    import trimesh

    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], np.float64)
    corners: Array = box.row[4:7] + (signs * box.row[1:4]) @ box.row[7:].reshape(3, 3).T
    return float(trimesh.proximity.closest_point_naive(hull, corners)[1].max())
