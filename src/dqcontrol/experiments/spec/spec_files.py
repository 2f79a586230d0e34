"""The names of files in a spec's plain data, made absolute, so that it runs anywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dqcontrol.plants.servo.servo_file import servo_parameters


def complete_plants(data: dict[str, Any], folder: Path) -> None:
    """Make the names of controller files absolute, and put what plant files hold in their place.

    What a spec says besides ``file`` counts in place of what the file says.
    """
    several = data.get("plants")
    plants = [data.get("plant"), *(several.values() if isinstance(several, dict) else ())]
    for plant in plants:
        if isinstance(plant, dict) and isinstance(plant.get("controllers"), str):
            plant["controllers"] = str((folder / plant["controllers"]).resolve())
        if isinstance(plant, dict) and plant.get("kind") == "servo" and isinstance(plant.get("file"), str):
            own = {key: value for key, value in plant.items() if key != "file"}
            held = servo_parameters(folder / plant["file"])
            plant.clear()
            plant.update(held | own)


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
