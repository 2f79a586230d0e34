"""Worlds in files of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from dqcontrol.experiments.spec.key_types import (
    kinds_of,
    numbers_for_quantities,
    quantities_for_numbers,
)
from dqcontrol.experiments.spec.world_formats import foreign_text, read_foreign
from dqcontrol.files.plain_data import yaml_text
from dqcontrol.files.yaml_file import convert
from dqcontrol.world import Solid, World
from dqcontrol.world.world import Bodies, plain_world


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
    """Return the plain data of what a spec says of its world, which may be the name of a file; see `plain_world`."""
    if isinstance(given, str) and (read := read_foreign((folder / given).resolve())) is not None:
        return read
    return plain_world(given, folder)


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
