"""Save a clip, or one picture, of a run."""

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
    """Save a clip or a picture of a run: an arm, or a mobile manipulator that was in physics.

    Parameters
    ----------
    run
        Folder of a run.
    path
        New file: .mp4, .webp or .gif; or .png, one picture of the whole run.
    speed
        Of a clip: how much faster than it was.
    rate
        Of a clip: frames a second.
    width
        Pixels.
    height
        Pixels.
    azimuth
        Direction of view, degrees.
    elevation
        Direction of view, degrees; negative looks down.
    """
    from dqcontrol.cli.screen import progress_bar
    from dqcontrol.experiments import load_run
    from dqcontrol.films.clip import render_clip, render_whole

    done = load_run(run)
    look = {
        "width": width,
        "height": height,
        "azimuth": azimuth,
        "elevation": elevation,
        "overwrite": force,
        "kept": done.law.constraints if done.law else None,
    }
    if path.suffix.lower() == ".png":
        render_whole(done.robot, done.plant, done.record, path, **look)
    else:
        with progress_bar() as progress:
            render_clip(
                done.robot,
                done.plant,
                done.record,
                path,
                speed=speed,
                rate=rate,
                progress=lambda drawn, total: progress(drawn, total, "frames"),
                **look,
            )
    print(f"results: {path}")
