"""Save a clip of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

Replace = Annotated[bool, Parameter(name="--force", negative=(), help="Replace an existing file.")]


def clip(
    run: Path,
    path: Path,
    /,
    *,
    force: Replace = False,
    speed: float = 1.0,
    rate: float = 25.0,
    width: int = 640,
    height: int = 480,
    azimuth: float | None = None,
    elevation: float | None = None,
) -> None:
    """Save a clip of a run: an arm, or a mobile manipulator that was in physics.

    Parameters
    ----------
    run
        Folder of a run.
    path
        New file: .mp4, .webp or .gif.
    speed
        How much faster than it was.
    rate
        Frames a second.
    width
        Pixels.
    height
        Pixels.
    azimuth
        Direction of view, degrees.
    elevation
        Direction of view, degrees; negative looks down.
    """
    from dqcontrol.experiments import load_run
    from dqcontrol.view.clip import render_clip

    done = load_run(run)
    render_clip(
        done.robot,
        done.plant,
        done.record,
        path,
        speed=speed,
        rate=rate,
        width=width,
        height=height,
        azimuth=azimuth,
        elevation=elevation,
        overwrite=force,
    )
    print(f"results: {path}")
