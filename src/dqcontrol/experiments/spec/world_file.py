"""Worlds in files of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError, ValueRangeError, error_prefix
from dqcontrol.experiments.spec.key_types import (
    kinds_of,
    numbers_for_quantities,
    quantities_for_numbers,
)
from dqcontrol.experiments.spec.reference_spec import AnyReference
from dqcontrol.experiments.spec.world_formats import foreign_text, read_foreign
from dqcontrol.files.plain_data import yaml_text
from dqcontrol.files.yaml_file import convert
from dqcontrol.references import position_path
from dqcontrol.world import Solid, World
from dqcontrol.world.world import Bodies, plain_world

_AWAY = 1e-6  # m
_OF_ROBOTS = ("drive-to", "follow", "plan-to")


def load_world(path: str | Path) -> World:
    r"""Return the world of a file, as the ``world`` of a spec: YAML, MJCF, URDF, or a scene of MoveIt's.

    Raises
    ------
    FileFormatError
        If the file cannot be read or says something else.

    Examples
    --------
    >>> import pathlib, tempfile, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "shelf.yaml"
    >>> _ = file.write_text("floor: true\nball: {sphere: 60 mm, position: [0.8, 0.1, 0.5]}")
    >>> list(dqc.load_world(file).bodies)
    ['floor', 'ball']
    """
    data = numbers_for_quantities(str(path), said_world(str(path), Path()), list(kinds_of(Bodies)))
    return World(bodies=convert(path, data, Bodies))


def said_world(given: Any, folder: Path) -> Any:
    """Return the plain data of what a spec says of its world, which may be the name of a file; see `plain_world`.

    References by which bodies move are paths there.
    """
    if isinstance(given, str) and (read := read_foreign((folder / given).resolve())) is not None:
        return read
    found = plain_world(given, folder)
    if isinstance(found, dict):
        folder = (folder / given).resolve().parent if isinstance(given, str) else folder
        for name, body in found.items():
            moves = body.get("moves") if isinstance(body, dict) else None
            if isinstance(moves, dict) and "reference" in moves:
                found[name] = {**body, "moves": _on_path(f"world.{name}", body, moves, folder)}
    return found


def _on_path(where: str, body: dict[str, Any], moves: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return how a body moves by a reference from where it is, as a path."""
    field = f"{where}.moves.reference"
    if "path" in moves or "velocity" in moves:
        raise ShapeError(f"{field}: it has a path or velocity already; give one of them")
    place = {key: body[key] for key in ("position", "rpy") if key in body}
    pose = convert(where, numbers_for_quantities(where, place, list(kinds_of(Solid))), Solid).pose
    numbers = numbers_for_quantities(field, moves["reference"], list(kinds_of(AnyReference)))
    given = convert(field, numbers, AnyReference)
    if (kind := given.__struct_config__.tag) in _OF_ROBOTS:
        raise ValueRangeError(f"{field}: {kind} is made for a robot; a body moves by a motion of its own")
    reference = given.build(pose, folder, field)
    with error_prefix(field):
        path = position_path(reference)
        away = float(np.linalg.norm(translation(reference.samples([0.0])[0, :8]) - translation(pose)))
        if away > _AWAY:
            raise ValueRangeError(
                f"begins {1e3 * away:.3g} mm from where the body is; leave 'start' and 'offset' out, or place the body"
            )
    kept = {key: value for key, value in moves.items() if key != "reference"}
    return {**kept, "path": path.tolist()}


def world_text(world: World, suffix: str) -> str:
    """Return a world as a file of this suffix says it; see `world_formats.foreign_text`."""
    if suffix not in (".yaml", ".yml"):
        return foreign_text(world, suffix)
    plain = {name: _said(body) for name, body in world.bodies.items()}
    return yaml_text(quantities_for_numbers(plain, list(kinds_of(Bodies))))


def _said(part: msgspec.Struct) -> dict[str, Any]:
    """Return what a body says that is not so by itself."""
    out = {}
    for each in msgspec.structs.fields(part):
        value = getattr(part, each.name)
        if value == each.default or (isinstance(value, list) and not value):
            continue
        parts = (
            [_said(one) for one in value]
            if isinstance(value, list) and isinstance(value[0], Solid)
            else value
        )
        out[each.encode_name] = _said(value) if isinstance(value, msgspec.Struct) else parts
    return msgspec.to_builtins(out)
