"""Clips and picture strips of mobile manipulators in physics, drawn from their recordings."""

from __future__ import annotations

import importlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.errors import (
    FileFormatError,
    ShapeError,
    ValueRangeError,
    as_array,
    as_count,
    as_positive,
)
from dqcontrol.plants.gripper import FINGERS
from dqcontrol.plants.mobile_live import coordinates_of
from dqcontrol.plants.mujoco_model import compiled, import_mujoco
from dqcontrol.plants.wheeled_base import WHEELS
from dqcontrol.view.offscreen import offscreen, renderer
from dqcontrol.view.picture_file import check_picture_file
from dqcontrol.view.stage import add_stage

if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.mobile import MobilePlant
    from dqcontrol.robots.robot import Robot

Pixels = NDArray[np.uint8]

CLIPS = (".gif", ".webp")
_MARGIN = 0.35  # m; around what moves
_MOST_FRAMES = 3000
_SHADOWS, _SAMPLES = 4096, 4  # less than for single pictures, as there are many


def render_clip(
    robot: Robot,
    plant: MobilePlant,
    record: Record,
    path: str | Path,
    *,
    speed: float = 2.0,
    rate: float = 12.5,
    width: int = 480,
    height: int = 360,
    azimuth: float = -110.0,
    elevation: float = -38.0,
    overwrite: bool = False,
) -> None:
    """Save a run in physics as a clip that plays for ever.

    Parameters
    ----------
    robot, plant, record
        What moved, in which plant, and what happened; a saved recording will do.
    path
        Where to save it: ``.gif``, which everything shows, or ``.webp``, a fifth of its size.
    speed
        How much faster than it was.
    rate
        Frames a second.
    width, height
        Pixels.
    azimuth, elevation
        Direction of view, degrees; negative elevations look down.
    overwrite
        True to replace an existing file.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed, or this machine has no OpenGL.
    ExistsError, FileFormatError
        If the file exists, its folder does not, or its ending is another.
    ShapeError, ValueRangeError
        If the recording is not of this robot and plant, or a number does not fit.
    """
    target = _target(path, CLIPS, overwrite)
    step = as_positive("speed", speed) / as_positive("rate", rate)
    count = int(record.time[-1] / step + 1e-9) + 1
    if count > _MOST_FRAMES:
        raise ValueRangeError(f"rate: makes {count} frames, at most {_MOST_FRAMES} are drawn; or more speed")
    view = (as_count("width", width), as_count("height", height), azimuth, elevation)
    frames = _frames(robot, plant, record, np.linspace(0.0, step * (count - 1), count), *view)
    image = importlib.import_module("PIL.Image")
    pictures = [image.fromarray(frame) for frame in frames]
    more: dict[str, Any] = (
        {"quality": 75, "method": 4} if target.suffix.lower() == ".webp" else {"optimize": True}
    )
    pictures[0].save(
        target, save_all=True, append_images=pictures[1:], duration=round(1000 / rate), loop=0, **more
    )


def render_strip(
    robot: Robot,
    plant: MobilePlant,
    record: Record,
    path: str | Path,
    times: Sequence[float],
    *,
    columns: int = 3,
    width: int = 480,
    height: int = 360,
    azimuth: float = -110.0,
    elevation: float = -38.0,
    overwrite: bool = False,
) -> None:
    """Save pictures of a run in physics at some times, side by side in one PNG file, each with its time.

    Parameters
    ----------
    robot, plant, record
        As for `render_clip`.
    path
        Where to save the file, ``.png``.
    times
        s.
    columns
        Pictures in a row.
    width, height
        Of each picture, pixels.
    azimuth, elevation, overwrite
        As for `render_clip`.

    Raises
    ------
    dqcontrol.Error
        As `render_clip`.
    """
    target = _target(path, (".png",), overwrite)
    moments = as_array("times", times, (None,))
    if moments.ndim != 1 or not len(moments) or moments.min() < 0 or moments.max() > record.time[-1] + 1e-9:
        raise ValueRangeError(f"times: must lie in 0 … {record.time[-1]:g} s, got {times}")
    across = as_count("columns", columns)
    if not across:
        raise ValueRangeError("columns: must be ≥ 1, got 0")
    view = (as_count("width", width), as_count("height", height), azimuth, elevation)
    frames = _frames(robot, plant, record, moments, *view)
    image, drawing = importlib.import_module("PIL.Image"), importlib.import_module("PIL.ImageDraw")
    rows = math.ceil(len(frames) / across)
    sheet = image.new("RGB", (across * width, rows * height), "white")
    for k, (moment, frame) in enumerate(zip(moments, frames, strict=True)):
        picture = image.fromarray(frame)
        drawing.Draw(picture).text((12, 8), f"{moment:.1f} s", fill=(20, 20, 20), font_size=height / 18)
        sheet.paste(picture, (k % across * width, k // across * height))
    sheet.save(target)


def _target(path: str | Path, endings: Sequence[str], overwrite: bool) -> Path:
    """Return where to save, or say why that cannot be."""
    target = Path(path)
    if target.suffix.lower() not in endings:
        raise FileFormatError(f"{target}: must end in {' or '.join(endings)}, got '{target.suffix}'")
    check_picture_file(target, overwrite=overwrite)
    return target


def _frames(
    robot: Robot,
    plant: MobilePlant,
    record: Record,
    times: NDArray[np.float64],
    width: int,
    height: int,
    azimuth: float,
    elevation: float,
) -> list[Pixels]:
    """Return the pictures of a run at some times."""
    if min(width, height) < 1:
        raise ValueRangeError(f"width, height: must be ≥ 1, got {width} and {height}")
    mujoco = import_mujoco()
    spec = plant.picture_model(robot)
    lower, upper = _extent(plant, record)
    middle, extent = 0.5 * (lower + upper), float(np.linalg.norm(upper - lower))
    add_stage(mujoco, spec, extent, 0.0, azimuth, (width, height))
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = _SHADOWS, _SAMPLES
    model = compiled(spec)
    data = mujoco.MjData(model)
    configurations = _configurations(robot, plant, record, model)
    scene = mujoco.MjvScene(model, maxgeom=2 * model.ngeom + 100)
    options, nobody, camera = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.MjvCamera()
    options.geomgroup[4] = 0
    camera.lookat[:], camera.distance = middle, 0.95 * extent
    camera.azimuth, camera.elevation = azimuth, elevation
    pictures = []
    with offscreen(width, height), renderer(model, width, height) as draw:
        for k in np.clip(np.searchsorted(record.time, times - 1e-9), 0, len(record.time) - 1):
            data.qpos[:] = configurations[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            everything = mujoco.mjtCatBit.mjCAT_ALL.value
            mujoco.mjv_updateScene(model, data, options, nobody, camera, everything, scene)
            pictures.append(draw(scene))
    return pictures


def _extent(plant: MobilePlant, record: Record) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two corners of the box that holds all that is to be seen."""
    things = [[*thing.position, 0.0] for thing in (*plant.scene.cubes, *plant.scene.baskets)]
    base = np.hstack([record.q[:, :2], np.zeros((len(record.q), 1))])
    points = np.vstack([base, translation(record.desired[:, :8]), *things])
    margin = np.array([_MARGIN, _MARGIN, 0.0])
    return points.min(axis=0) - margin, points.max(axis=0) + margin


def _configurations(robot: Robot, plant: MobilePlant, record: Record, model: Any) -> NDArray[np.float64]:
    """Return MuJoCo's coordinates at each sample; the base stands upright."""
    readings = record.readings
    cubes = [f"cube_{i + 1}" for i in range(len(plant.scene.cubes))]
    needed = ["wheel_angle", *(["gripper_opening"] if plant.gripper else [])]
    needed += [f"{cube}_{what}" for cube in cubes for what in ("position", "quaternion")]
    missing = [name for name in needed if name not in readings]
    if missing or record.q.shape[1] != robot.configuration_size:
        raise ShapeError(
            f"record: is not of this robot and plant; missing: {', '.join(missing) or 'coordinates'}"
        )
    out = np.zeros((len(record.q), model.nq))
    base = coordinates_of(model, ["base"])[0]
    out[:, base : base + 2] = record.q[:, :2]
    out[:, base + 3], out[:, base + 6] = np.cos(record.q[:, 2] / 2), np.sin(record.q[:, 2] / 2)
    out[:, coordinates_of(model, [f"wheel_{name}" for name in WHEELS])] = readings["wheel_angle"].values
    out[:, coordinates_of(model, robot.joint_names[3:])] = record.q[:, 3:]
    if plant.gripper:
        closed = 0.5 * (plant.gripper.opening - readings["gripper_opening"].values)
        out[:, coordinates_of(model, FINGERS)] = closed
    for name in cubes:
        first = coordinates_of(model, [name])[0]
        out[:, first : first + 3] = readings[f"{name}_position"].values
        out[:, first + 3 : first + 7] = readings[f"{name}_quaternion"].values
    return out
