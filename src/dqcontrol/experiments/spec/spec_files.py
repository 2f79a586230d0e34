"""The names of files in a spec's plain data, made absolute, so that it runs anywhere."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from dqcontrol.extensions.registry import by_tag
from dqcontrol.plants import Plant


def locate_plant_files(data: dict[str, Any], folder: Path) -> None:
    """Make the names of files of plants absolute."""
    several = data.get("plants")
    plants = [data.get("plant"), *(several.values() if isinstance(several, dict) else ())]
    for plant in plants:
        for key in _file_keys().get(str(plant.get("kind")), ()) if isinstance(plant, dict) else ():
            if isinstance(plant.get(key), str):
                plant[key] = str((folder / plant[key]).resolve())


@cache
def _file_keys() -> dict[str, tuple[str, ...]]:
    """Return by kind of plant the keys that name files."""
    return {tag: kind.file_keys for tag, kind in by_tag(Plant, "dqcontrol.plants").items()}


def locate_files(data: dict[str, Any], folder: Path) -> None:
    """Make the names of files of robots and references absolute."""
    _make_absolute(data["reference"], folder)
    if "robot" in data:
        data["robot"] = _absolute_robot(data["robot"], folder)
    for label, robot in data.get("robots", {}).items():
        data["robots"][label] = _absolute_robot(robot, folder)


def _absolute_robot(robot: str | dict[str, Any], folder: Path) -> str | dict[str, Any]:
    source = robot["source"] if isinstance(robot, dict) else robot
    if source is None or not (folder / source).is_file():
        return robot
    return (robot if isinstance(robot, dict) else {}) | {"source": str((folder / source).resolve())}


def _make_absolute(reference: dict[str, Any], folder: Path) -> None:
    """Make the file names of a reference, and of those that it is made of, absolute."""
    if "file" in reference:
        reference["file"] = str((folder / reference["file"]).resolve())
    for part in reference.get("references", ()):
        _make_absolute(part, folder)
