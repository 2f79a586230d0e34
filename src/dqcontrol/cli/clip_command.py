"""Save a clip, or one picture, of a run or several."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from dqcontrol.cli.options import ANGLES, in_unit

Replace = Annotated[bool, Parameter(name="--force", negative=(), help="Replace an existing file.")]


def clip(
    *runs_and_path: Path,
    force: Replace = False,
    faster: Annotated[float, Parameter(metavar="<times>")] = 1.0,
    rate: Annotated[float, in_unit("Hz", "25Hz")] = 25.0,
    size: Annotated[str, Parameter(metavar="<pixels>")] = "640x480",
    azimuth: Annotated[float | None, ANGLES] = None,
    elevation: Annotated[float | None, ANGLES] = None,
) -> None:
    """Save a clip or a picture of a run, or of several of one robot in one scene: arms, and mobile manipulators.

    Parameters
    ----------
    runs_and_path
        Folders of runs, and the new file: .mp4, .webp or .gif; or .png, one picture of the whole run. The second run
        and further ones show through the first.
    faster
        Of a clip: how much faster than it was.
    rate
        Of a clip: frames a second.
    size
        Width and height of the picture or of each frame.
    azimuth
        Direction of view, rad or as 60deg.
    elevation
        Direction of view, rad or as -25deg; negative looks down.
    """
    from dqcontrol.cli.screen import progress_bar
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments import load_run
    from dqcontrol.films.clip import render_clip, render_whole

    pixels = re.fullmatch(r"(\d+)x(\d+)", size)
    if not pixels:
        raise ValueRangeError(f"--size: expected width and height in pixels, as 640x480, got '{size}'")

    if len(runs_and_path) < 2:
        raise ValueRangeError(
            "clip: expected the folder of a run, or several, and a file: dqcontrol clip RUN run.webp"
        )
    *folders, path = runs_and_path
    first, *others = (load_run(folder) for folder in folders)
    for folder, other in zip(folders[1:], others, strict=True):
        if other.robot.name != first.robot.name:
            raise ValueRangeError(
                f"{folder}: is of {other.robot.name}, and the first run of {first.robot.name}"
            )
    look: dict[str, Any] = {
        "width": int(pixels[1]),
        "height": int(pixels[2]),
        "azimuth": None if azimuth is None else math.degrees(azimuth),
        "elevation": None if elevation is None else math.degrees(elevation),
        "overwrite": force,
        "kept": first.surroundings,
        "further": [(other.plant, other.record) for other in others],
        "labels": [folder.name for folder in folders] if others else (),
    }
    if path.suffix.lower() == ".png":
        render_whole(first.robot, first.plant, first.record, path, **look)
    else:
        with progress_bar() as progress:
            render_clip(
                first.robot,
                first.plant,
                first.record,
                path,
                speed=faster,
                rate=rate,
                progress=lambda drawn, total: progress(drawn, total, "frames"),
                **look,
            )
    print(f"results: {path}")
