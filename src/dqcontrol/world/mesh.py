"""Meshes of bodies: read, refused where they are open or huge, and taken apart into convex parts."""

from __future__ import annotations

import hashlib
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.kernel_cache import module_folder, root as cache_root
from dqcontrol.errors import FileFormatError, NoteWarning, from_extra
from dqcontrol.files.input_file import version
from dqcontrol.files.output_file import whole_file
from dqcontrol.geometry import Hull

_MOST_FACES = 500_000  # taking them apart takes minutes beyond
_THRESHOLD = 0.05  # of CoACD: concavity that a part may have, as a share of the mesh's size
_CONVEX = 0.999  # of a hull's volume
_SAMPLES = 500  # points of a surface beside its corners: on a torus 20 000 find 9.67 mm, these 9.56 mm
_HERE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


def convex_parts(file: str) -> tuple[Any, ...]:
    """Return the convex hulls, as trimesh has them, of the convex parts of a mesh; of one convex already, itself.

    A `NoteWarning` says how many parts stand for a mesh and by how much they are off it.

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
    corners, (outside, inside) = _kept_parts(Path(file), mesh)
    warnings.warn(
        f"mesh: {file}: {len(corners)} convex parts stand for it, up to {1e3 * outside:.2g} mm outside and "
        f"{1e3 * inside:.2g} mm inside of its surface",
        NoteWarning,
        stacklevel=2,
    )
    return tuple(trimesh.Trimesh(each).convex_hull for each in corners)


def _kept_parts(file: Path, mesh: Any) -> tuple[list[Array], tuple[float, float]]:
    """Return the corners of each convex part of a mesh and their errors, from the cache where they are known."""
    import trimesh

    kept = None
    if cache_root() is not None:
        kept = module_folder(__name__) / f"{hashlib.sha256(file.read_bytes()).hexdigest()[:16]}.npz"
        if kept.exists():
            # What is damaged is made anew.
            with suppress(OSError, ValueError, BadZipFile), np.load(kept) as found:
                (outside, inside), *corners = found.values()
                return corners, (outside, inside)
    corners = _taken_apart(str(file), mesh)
    errors = _largest_errors(mesh, [trimesh.Trimesh(each).convex_hull for each in corners])
    if kept is not None:
        with suppress(OSError), whole_file(kept, overwrite=True) as whole, whole.open("wb") as stream:
            np.savez(stream, errors, *corners)
    return corners, errors


def _taken_apart(file: str, mesh: Any) -> list[Array]:
    coacd = from_extra("coacd", "mesh", f"meshes that are not convex, as {file},")
    print(f"dqcontrol: taking {Path(file).name} apart into convex parts …", file=sys.stderr, flush=True)
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=_THRESHOLD)
    return [np.asarray(corners) for corners, _ in parts]


def _largest_errors(mesh: Any, parts: Sequence[Any]) -> tuple[float, float]:
    """Return how far parts reach out of a mesh and how far they stay inside of its surface, m."""
    from trimesh.proximity import signed_distance  # positive inside

    outside = max(-signed_distance(mesh, _surface(part)).min() for part in parts)
    inside = -np.max([signed_distance(part, _surface(mesh)) for part in parts], axis=0).min()
    return max(outside, 0.0), max(inside, 0.0)


def _surface(mesh: Any) -> Any:
    return np.concatenate([mesh.vertices, mesh.sample(_SAMPLES, seed=0)])


def hulls(file: str) -> tuple[Hull, ...]:
    """Return the convex parts of a mesh as shapes, in its own axes; see `convex_parts`."""
    return _hulls(file, version(file))


@lru_cache(maxsize=16)
def _hulls(file: str, version: tuple[int, int, int]) -> tuple[Hull, ...]:
    return tuple(Hull(_HERE, np.asarray(part.vertices)) for part in convex_parts(file))
