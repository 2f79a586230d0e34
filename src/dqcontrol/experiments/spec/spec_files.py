"""The files that a spec names: made absolute, so that it runs from anywhere, and copied, so that it runs elsewhere."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from dqcontrol.contact import load_tool
from dqcontrol.errors import Error
from dqcontrol.experiments.results_folder import SPEC_FILE
from dqcontrol.extensions.registry import by_tag
from dqcontrol.extensions.user_code import places
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.laws import Law
from dqcontrol.plants import Plant
from dqcontrol.robots.files.urdf_xml import XACRO, CheckedXml

INPUTS = "inputs"  # folder of the copies, in one of results
_ROBOTS = ("robot", "robot.source", "robots.*.source", "evaluation.robot.source")
_MAPS = ("world.*.map", "world.*.mesh", "world.*.parts.*.map", "world.*.parts.*.mesh")
_TOOLS = [f"{part}contact.sensor.tool" for part in ("", "law.", "laws.*.")]


def complete_plants(data: dict[str, Any], folder: Path) -> None:
    """Make names of files of plants and laws absolute, and put what files of plants and tools hold in their place."""
    for part, kind in _plants_and_laws(data):
        if issubclass(kind, Plant):
            completed = kind.complete(part, folder)
            part.clear()
            part.update(completed)
        else:
            for key in _file_keys(part, kind):
                part[key] = str((folder / part[key]).resolve())
    for part, key in _at(data, *_MAPS):
        part[key] = str((folder / part[key]).resolve())
    for part, key in _at(data, *_TOOLS, "supervisor.payload"):
        part[key] = msgspec.to_builtins(load_tool(folder / part[key]))


def locate_files(data: dict[str, Any], folder: Path) -> None:
    """Make the names of files of robots and references absolute."""
    for part in _references_of(data):
        part["file"] = str((folder / part["file"]).resolve())
    for part, key in _at(data, *_ROBOTS):
        if (folder / part[key]).is_file():
            path = str((folder / part[key]).resolve())
            part[key] = {"source": path} if key == "robot" else path


def write_spec(text: str, folder: Path) -> None:
    """Write a spec into a folder of results, and copies of the files that it names by absolute names: see `use_copies`.

    A robot file brings those of its parts along, a xacro file is expanded; of meshes only the names remain. Files that
    cannot be read, and several of one name, are left out.
    """
    (folder / SPEC_FILE).write_text(text, encoding="utf-8")
    named = _named(parse_yaml("spec", text))
    files = [Path(part[key].rpartition(":")[0] if key == "function" else part[key]) for part, key in named]
    files = [path for path in dict.fromkeys(files) if path.is_absolute() and path.is_file()]
    for path in list(files):
        files += [part for part in _parts(path) if part not in files]
    names = [_copy_name(path) for path in files]
    for path, name in zip(files, names, strict=True):
        if names.count(name) > 1:
            continue
        (folder / INPUTS).mkdir(exist_ok=True)
        with suppress(Error, OSError):
            if path.suffix == XACRO:
                (folder / INPUTS / name).write_bytes(CheckedXml(path).data)
            else:
                shutil.copyfile(path, folder / INPUTS / name)


def use_copies(data: Any, folder: Path) -> None:
    """Replace the absolute names of files that are not there, as on another machine, by their copies in a folder.

    What is no mapping stays as it is, for whoever reads it as a spec to refuse.
    """
    if not isinstance(data, dict):
        return
    for part, key in _named(data):
        source, colon, name = part[key].rpartition(":") if key == "function" else (part[key], "", "")
        path = Path(source)
        copy = folder / INPUTS / _copy_name(path)
        if path.is_absolute() and not path.exists() and copy.is_file():
            part[key] = f"{copy.resolve()}{colon}{name}"


def _copy_name(path: Path) -> str:
    return path.with_suffix("").with_suffix(".urdf").name if path.suffix == XACRO else path.name


def _named(data: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield each mapping that names a file, with the key that does."""
    yield from _at(data, *_ROBOTS, *_MAPS)
    yield from ((part, "file") for part in _references_of(data))
    yield from ((part, key) for part, kind in _plants_and_laws(data) for key in _file_keys(part, kind))
    yield from (
        (part, "function") for part in places(data) if part["function"].rpartition(":")[0].endswith(".py")
    )


def _at(data: dict[str, Any], *paths: str) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield the mappings that have a text at these paths, each with its key; ``*`` stands for all entries."""
    for path in paths:
        *names, key = path.split(".")
        parts: list[Any] = [data]
        for name in names:
            parts = [each for part in parts for each in _entries(part, name)]
        yield from (
            (part, key) for part in parts if isinstance(part, dict) and isinstance(part.get(key), str)
        )


def _entries(part: Any, name: str) -> list[Any]:
    """Return what a part of a spec has under a name, or all that it has; nothing where it is another thing."""
    if isinstance(part, dict):
        return list(part.values()) if name == "*" else [part[name]] if name in part else []
    return part if isinstance(part, list) and name == "*" else []


def _references_of(data: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the references of a spec, those of its further tasks among them, that name files."""
    yield from _references(data.get("reference"))
    for task in _entries(data.get("tasks"), "*"):
        yield from _references(task.get("reference") if isinstance(task, dict) else None)


def _references(reference: Any) -> Iterator[dict[str, Any]]:
    """Yield a reference that names a file, and those that it is made of."""
    if not isinstance(reference, dict):
        return
    if isinstance(reference.get("file"), str):
        yield reference
    for part in (reference.get("reference"), *_entries(reference.get("references"), "*")):
        yield from _references(part)


def _plants_and_laws(data: dict[str, Any]) -> Iterator[tuple[dict[str, Any], type[Law | Plant]]]:
    """Yield what a spec says of plants and laws of known kinds, each with the class of its kind."""
    for key in ("plant", "law"):
        for part, kind in _at(data, f"{key}.kind", f"{key}s.*.kind"):
            if found := _kinds(key).get(part[kind]):
                yield part, found


def _file_keys(part: dict[str, Any], kind: type[Law | Plant]) -> list[str]:
    return [key for key in kind.file_keys if isinstance(part.get(key), str)]


@cache
def _kinds(key: str) -> dict[str, type[Law | Plant]]:
    base = Law if key == "law" else Plant
    return dict(by_tag(base, f"dqcontrol.{key}s"))


def _parts(robot: Path) -> Iterator[Path]:
    """Yield the files beside a file of a whole body that it is made of."""
    if robot.suffix not in (".yaml", ".yml"):
        return
    with suppress(Error):
        data = parse_yaml(robot, read_text(robot))
        for part, key in _at(data, "parts.*.robot"):
            if Path(part[key]).name == part[key] and (robot.parent / part[key]).is_file():
                yield robot.parent / part[key]
