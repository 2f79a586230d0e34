"""An episode of a LeRobot dataset as a joint log."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError
from dqcontrol.files.lerobot_dataset import ACTION, COMMAND, STATE, Dataset, Feature
from dqcontrol.logs.joint_table import DEGREES_NOTE, Angles, must_be_degrees
from dqcontrol.robots import Robot


class EpisodeLog(NamedTuple):
    """What an episode holds of a robot's joints: time (N,) s; positions, commands and commanded positions (N, n)."""

    time: Array
    q: Array
    command: Array | None
    target: Array | None
    notes: tuple[str, ...]


def read_episode_log(
    path: Path, data: Dataset, number: int, robot: Robot, names: Sequence[str], angles: Angles | None
) -> EpisodeLog:
    """Return what an episode holds of the named joints, by ``NAME`` or ``NAME.pos``, without others beside them.

    Raises
    ------
    FileFormatError
        If a joint is missing, or fewer than two samples are there.
    ValueRangeError
        If angles without a unit must be degrees, and it cannot be told which.
    """
    if STATE not in data.features:
        raise FileFormatError(f"{path}: has no column {STATE}; it has {', '.join(data.features) or 'none'}")
    values = data.episode(number)
    time = values["timestamp"][:, 0]
    if len(time) < 2 or not (np.diff(time) > 0).all():
        raise FileFormatError(f"{path}: timestamp: expected at least two samples whose time increases")
    time = np.arange(len(time)) / data.fps  # stamps are float32: 1e-4 s after half an hour
    notes: list[str] = []
    state = data.features[STATE]
    rows = _rows(path, STATE, state, names, "pos")
    q = values[STATE][:, rows]
    units = [state.units[i] for i in rows]
    if angles is None and must_be_degrees(path, robot, units, q):
        angles = "deg"
        notes.append(DEGREES_NOTE)
    q = q * _scales(robot, units, angles)
    target = command = None
    if ACTION in data.features:
        action = data.features[ACTION]
        kind = "vel" if all(name.endswith(".vel") for name in action.names) else "pos"
        rows = _rows(path, ACTION, action, names if kind == "pos" else robot.input_names, kind)
        told = values[ACTION][:, rows]
        if kind == "pos":
            target = told * _scales(robot, [action.units[i] for i in rows], angles)
        else:
            command = told
    if COMMAND in data.features:
        rows = _rows(path, COMMAND, data.features[COMMAND], robot.input_names, "vel")
        command = values[COMMAND][:, rows]
    return EpisodeLog(time, q, command, target, tuple(notes))


def _rows(path: Path, column: str, feature: Feature, names: Sequence[str], kind: str) -> list[int]:
    known: dict[str, int] = {}
    for i, name in enumerate(feature.names):
        known.setdefault(name.removesuffix(f".{kind}"), i)
    missing = [name for name in names if name not in known]
    if missing:
        raise FileFormatError(
            f"{path}: {column}: has no {', '.join(missing)}; it has {', '.join(known)} "
            "(--joints names the joints as the dataset does, in the robot's order)"
        )
    return [known[name] for name in names]


def _scales(robot: Robot, units: Sequence[str], angles: Angles | None) -> Any:
    """Return what turns the numbers of each joint into rad and m."""
    degrees = [
        kind == "revolute" and (unit in ("deg", "°") or (not unit and angles == "deg"))
        for kind, unit in zip(robot.joint_types, units, strict=True)
    ]
    return np.where(degrees, np.pi / 180, 1.0)
