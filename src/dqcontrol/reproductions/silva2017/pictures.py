"""Pictures by MuJoCo for the reproductions, where this machine has OpenGL."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

from dqcontrol.errors import MissingExtraError
from dqcontrol.loop.record import Record
from dqcontrol.reproductions.reproduced import Write
from dqcontrol.robots import Robot

_AZIMUTH, _ELEVATION = 100.0, -25.0  # degrees; across the way of the base


def if_drawable(files: Mapping[str, Write]) -> dict[str, Write]:
    """Return the files, or none and a warning where MuJoCo or OpenGL is missing."""
    from dqcontrol.films.offscreen import offscreen

    try:
        with offscreen(16, 16):
            return dict(files)
    except MissingExtraError as error:
        warnings.warn(str(error), stacklevel=2)
        return {}


def ghosted_strip(robot: Robot, records: Mapping[str, Record], times: Sequence[float]) -> Write:
    """Return what draws runs at some times in one scene, others through the first. [S17 Fig. 5.4]"""

    def write(path: Path) -> None:
        from dqcontrol.films.clip import render_strip

        first, *others = records.values()
        render_strip(
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
