"""Plant files: what the servos of one robot are, as ``dqcontrol identify`` or a user writes it."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dqcontrol.errors import FileFormatError, NoteWarning
from dqcontrol.files.input_file import read_text
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


_LEAST_LAG = 1e-3  # s; quicker servos are as quick as that
_OF_SERVOS = {  # what other plants may have no place for, and how it is called
    "gain": (1.0, "", "a gain of {}"),
    "delay": (0.0, " s", "a delay of {}"),
    "friction": (0.0, " rad", "play of ± {}"),
    "sag": (0.0, "", "the sag of the joints"),
    "lags": (0.0, " s", "lags of {}"),
}


def fitting_lags(servo: Servo) -> list[tuple[float, float]]:
    """Return ω (rad/s) and ζ of each joint, of first-order ones that of a critically damped one that is as late."""
    columns = (servo.bandwidth, servo.damping_ratio, servo.time_constant)
    size = max(np.size(each) for each in columns)
    rows = zip(*(np.broadcast_to(each, size).tolist() for each in columns), strict=True)
    return [(omega, ratio) if omega else (2 / max(lag, _LEAST_LAG), 1.0) for omega, ratio, lag in rows]


def encoders_and_mode(servo: Servo) -> dict[str, Any]:
    """Return what all plants with joints take of a servo: its encoders, and from where commands count."""
    keys = ("command_mode", "encoder_resolution", "encoder_noise")
    return {key: getattr(servo, key) for key in keys}


def say_what_is_left_out(path: Path, servo: Servo, plant: str, keys: Sequence[str]) -> None:
    """Warn with a note of what a plant file holds that a plant of another kind has no place for."""
    left = []
    for key in keys:
        usual, unit, words = _OF_SERVOS[key]
        if key == "lags":
            values = [2 * ratio / omega for omega, ratio in fitting_lags(servo)]
        else:
            values = np.ravel(getattr(servo, key)).tolist()
        if any(abs(value - usual) > 1e-9 for value in values):
            ends = sorted({f"{min(values):.3g}", f"{max(values):.3g}"}, key=float)
            left.append(words.format(" to ".join(ends) + unit))
    if left:
        warnings.warn(
            f"{path}: {plant} has no place for {', '.join(left)}: left out", NoteWarning, stacklevel=3
        )


def _content(path: Path) -> dict[str, Any]:
    data = parse_yaml(path, read_text(path))
    if not isinstance(data, dict) or not isinstance(data.get("plant"), dict):
        raise FileFormatError(f"{path}: is no plant file: it needs the mapping 'plant', with kind: servo")
    if data["plant"].get("kind") != "servo":
        raise FileFormatError(f"{path}: plant.kind: expected 'servo', got {data['plant'].get('kind')!r:.40}")
    return data
