"""Pictures by MuJoCo for the reproductions, where this machine has OpenGL."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol import figures, films
from dqcontrol.errors import MissingExtraError
from dqcontrol.loop import Record
from dqcontrol.plants import Plant
from dqcontrol.robots import Robot, load_robot
from dqcontrol_theses.reproduced import Write
from dqcontrol_theses.silva2017.pick_and_drop_task import ROBOT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AZIMUTH, _ELEVATION = 100.0, -25.0  # degrees; across the way of the base


def if_drawable(files: Mapping[str, Write]) -> dict[str, Write]:
    """Return the files, or none and a warning where MuJoCo or OpenGL is missing."""
    try:
        with films.offscreen(16, 16):
            return dict(files)
    except MissingExtraError as error:
        warnings.warn(str(error), stacklevel=2)
        return {}


def filmed(
    name: str, plant: Plant, record: Record, times: Sequence[float], *, speed: float
) -> dict[str, Write]:
    """Return what draws a run of `ROBOT` in physics: a clip, and a strip of some times, s."""
    robot = load_robot(ROBOT)

    def clip(path: Path) -> None:
        films.render_clip(
            robot, plant, record, path, speed=speed, rate=12.5, width=480, height=360, overwrite=True
        )

    def strip(path: Path) -> None:
        films.render_strip(robot, plant, record, path, times, width=440, height=330, overwrite=True)

    return {f"{name}.webp": clip, f"{name}.png": strip}


def ghosted_strip(robot: Robot, records: Mapping[str, Record], times: Sequence[float]) -> Write:
    """Return what draws runs at some times in one scene, others through the first. [S17 Fig. 5.4]"""

    def write(path: Path) -> None:
        first, *others = records.values()
        films.render_strip(
            robot,
            None,
            first,
            path,
            times,
            width=480,
            height=300,
            azimuth=_AZIMUTH,
            elevation=_ELEVATION,
            further=[(None, each) for each in others],
            labels=list(records),
            overwrite=True,
        )

    return write


def told_inputs(records: Mapping[str, Record]) -> Figure:
    """Return the inputs that wheels and joints are told, law beside law."""
    signals = {label: record.readings["actuator_command"] for label, record in records.items()}
    inputs = {label: (records[label].time, each.values) for label, each in signals.items()}
    parts = next(iter(signals.values())).parts
    return figures.compare_inputs(inputs, [f"{name} [rad/s]" for name in parts])
