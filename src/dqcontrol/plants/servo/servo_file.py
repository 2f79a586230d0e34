"""Plant files: what the servos of one robot are, as ``dqcontrol identify`` or a user writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from dqcontrol.errors import FileFormatError
from dqcontrol.files.text_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.plants.servo.servo_plant import Servo


class _PlantFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    plant: Servo
    identified: dict[str, Any] = {}


def load_servo(path: str | Path) -> Servo:
    """Return the servos that a plant file holds.

    Parameters
    ----------
    path
        A YAML file with the mapping ``plant``, as in specs, and perhaps ``identified``: where its numbers are from.

    Raises
    ------
    FileFormatError
        If it cannot be read or holds something else.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "my_arm.yaml"
    >>> _ = file.write_text("plant: {kind: servo, time_constant: [0.05, 0.03], delay: 0.012}")
    >>> load_servo(file).time_constant
    [0.05, 0.03]
    """
    path = Path(path)
    return convert(path, _content(path), _PlantFile).plant


def servo_parameters(path: Path) -> dict[str, Any]:
    """Return what a plant file says of its servos, as plain data, without their kind.

    Raises
    ------
    FileFormatError
        As `load_servo`.
    """
    content = _content(path)
    convert(path, content, _PlantFile)
    return {key: value for key, value in content["plant"].items() if key != "kind"}


def _content(path: Path) -> dict[str, Any]:
    data = parse_yaml(path, read_text(path))
    if not isinstance(data, dict) or not isinstance(data.get("plant"), dict):
        raise FileFormatError(f"{path}: is no plant file: it needs the mapping 'plant', with kind: servo")
    if data["plant"].get("kind") != "servo":
        raise FileFormatError(f"{path}: plant.kind: expected 'servo', got {data['plant'].get('kind')!r:.40}")
    return data
