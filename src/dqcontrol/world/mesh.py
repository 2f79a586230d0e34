"""Meshes of bodies: read, refused where they are open or huge, and taken apart into convex parts."""

from __future__ import annotations

import importlib
from functools import lru_cache
from typing import Any

import numpy as np

from dqcontrol.errors import FileFormatError, MissingExtraError
from dqcontrol.files.input_file import version
from dqcontrol.geometry import Hull

_MOST_FACES = 500_000  # taking them apart takes minutes beyond
_THRESHOLD = 0.05  # of CoACD: concavity that a part may have, as a share of the mesh's size
_CONVEX = 0.999  # of a hull's volume
_HERE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


def convex_parts(file: str) -> tuple[Any, ...]:
    """Return the convex hulls, as trimesh has them, of the convex parts of a mesh; of one convex already, itself.

    Raises
    ------
    FileFormatError
        If the file cannot be read, or the mesh is open or has more than half a million faces.
    MissingExtraError
        If coacd, which takes meshes apart, is not installed.
    """
    return _convex_parts(file, version(file))


@lru_cache(maxsize=16)
def _convex_parts(file: str, version: tuple[int, int, int]) -> tuple[Any, ...]:
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


def hulls(file: str) -> tuple[Hull, ...]:
    """Return the convex parts of a mesh as shapes, in its own axes; see `convex_parts`."""
    return _hulls(file, version(file))


@lru_cache(maxsize=16)
def _hulls(file: str, version: tuple[int, int, int]) -> tuple[Hull, ...]:
    return tuple(Hull(_HERE, np.asarray(part.vertices)) for part in convex_parts(file))
