"""The world around a robot: its bodies by name, read from a spec, a file or Python."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.errors import FileFormatError, ValueRangeError, error_prefix
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.geometry import Plane, Shape, distance
from dqcontrol.named_fields import NamedFields
from dqcontrol.world.body import Body, Name

Bodies = dict[Name, Body]

FLOOR = "floor"
_TOUCHING = 1e-6  # m: what stands on something is in it by rounding


class World(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What stands around robots.

    Parameters
    ----------
    bodies
        By name.

    Raises
    ------
    ShapeError, ValueRangeError
        If a body says not one shape, is moved in two ways, or two bodies are in each other.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> table = dqc.world.Body(box=(1.2, 0.8, 0.04), position=(0.6, 0, 0.38))
    >>> world = dqc.World(bodies={"table": table})
    >>> [round(float(shape.size[2]), 3) for _, shape in world.shapes]
    [0.04]
    """

    bodies: Bodies

    def __post_init__(self) -> None:
        for name, body in self.bodies.items():
            with error_prefix(f"world.{name}"):
                _ = body.role, body.shapes
        self._check_apart()

    @property
    def shapes(self) -> Iterator[tuple[str, Shape]]:
        """Every shape at the start, with the name of its body."""
        for name, body in self.bodies.items():
            yield from ((name, shape) for shape in body.shapes)

    def _check_apart(self) -> None:
        """Raise if a body that physics moves starts in another one."""
        placed = [(name, body, body.shapes) for name, body in self.bodies.items()]
        for i, (name, body, shapes) in enumerate(placed):
            for other, its, others in placed[:i]:
                if not (body.role == "free" or its.role == "free"):
                    continue  # a wall may begin in a floor
                depth = max((-_distance(a, b) for a in shapes for b in others), default=0.0)
                if depth > _TOUCHING:
                    raise ValueRangeError(
                        f"world.{name}: starts {1000 * depth:.3g} mm deep in {other}; physics would throw them apart"
                    )


def _distance(a: Shape, b: Shape) -> float:
    return np.inf if isinstance(a, Plane) and isinstance(b, Plane) else distance(a, b).distance


def plain_world(given: Any, folder: Path) -> Any:
    """Return the plain data of a world with absolute names of files and a plane in place of ``floor: true``.

    Parameters
    ----------
    given
        What a spec says: a mapping, or the name of a file that has it. Anything else is left for the schema to refuse.
    folder
        That file names start from.
    """
    if isinstance(given, str):
        path = (folder / given).resolve()
        given, folder = parse_yaml(path, read_text(path)), path.parent
        if not isinstance(given, dict):
            raise FileFormatError(f"{path}: is no world: expected bodies by name")
    if not isinstance(given, dict):
        return given
    found = {}
    for name, body in given.items():
        if name == FLOOR and isinstance(body, bool):
            if body:
                found[name] = {"plane": [0.0, 0.0, 1.0]}
            continue
        found[name] = _located(body, folder)
    return found


def _located(body: Any, folder: Path) -> Any:
    if not isinstance(body, dict):
        return body
    found = dict(body)
    for key in ("mesh", "map"):
        if isinstance(found.get(key), str):
            found[key] = str((folder / found[key]).resolve())
    if isinstance(found.get("parts"), list):
        found["parts"] = [_located(part, folder) for part in found["parts"]]
    return found
