"""Clips and picture strips of runs, drawn from their recordings by MuJoCo."""

from __future__ import annotations

import contextlib
import importlib
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.constraints.constraint_view import ConstraintView
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.errors import (
    FileFormatError,
    ShapeError,
    ValueRangeError,
    as_array,
    as_count,
    as_positive,
    from_extra,
    writing,
)
from dqcontrol.figures.paths import desired_in_room, tip_paths
from dqcontrol.files.output_file import whole_file
from dqcontrol.films.drawn_scene import COLOURS, check_picture_file
from dqcontrol.films.film import Film, film_arm, film_physics, frames, with_rolling_wheels
from dqcontrol.films.physics_picture import render_run
from dqcontrol.loop.signals import DISTANCE
from dqcontrol.measures.held import plans_of_run
from dqcontrol.measures.metrics import contact_force
from dqcontrol.plants.mobile.mobile_plant import MobilePlant
from dqcontrol.robots import SerialArm, TreeRobot
from dqcontrol.world import World, stands

CLIPS = (".gif", ".mp4", ".webp")
Pixels = NDArray[np.uint8]


def write_clip(frames: Iterable[Pixels], path: Path, rate: float) -> None:
    """Write frames, shapes (height, width, 3), as the file's ending says; .gif and .webp play for ever.

    Parameters
    ----------
    frames
        Of one size, for .mp4 even.
    path
        Ends in one of `CLIPS`.
    rate
        Frames a second.

    Raises
    ------
    MissingExtraError
        If it ends in .mp4 and PyAV is not installed.
    """
    if path.suffix.lower() == ".mp4":
        _write_mp4(frames, path, rate)
        return
    image = importlib.import_module("PIL.Image")
    pictures = [image.fromarray(frame) for frame in frames]
    is_webp = path.suffix.lower() == ".webp"
    more: dict[str, Any] = {"quality": 75, "method": 4} if is_webp else {"optimize": True}
    more["duration"] = round(1000 / rate)
    pictures[0].save(path, save_all=True, append_images=pictures[1:], loop=0, **more)


def _write_mp4(frames: Iterable[Pixels], path: Path, rate: float) -> None:
    """Write frames as H.264, which browsers and presentations play."""
    av = from_extra("av", "video", _MP4)
    with av.open(str(path), "w") as file:
        whole = Fraction(rate).limit_denominator(1000)
        stream = file.add_stream("libx264", rate=whole, options={"crf": "20"})
        every = iter(frames)
        first = next(every)
        stream.height, stream.width = first.shape[:2]
        stream.pix_fmt = "yuv420p"

        def add(pixels: Pixels) -> None:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(pixels), format="rgb24")))

        with ThreadPoolExecutor(1) as beside:  # a frame is encoded while the next one is drawn
            last = beside.submit(add, first)
            for pixels in every:
                last.result()
                last = beside.submit(add, pixels)
            last.result()
        file.mux(stream.encode())


if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import PhysicsPicture, Plant
    from dqcontrol.robots.robot import Robot

    Further = Sequence[tuple[Plant | None, Record]]

_MP4 = "clips as .mp4, not those as .webp or .gif,"
_MOST_FRAMES = 3000  # two minutes at 25 a second
_PICTURES = 6  # of a strip
_INK = (20, 20, 20)
_SLOWEST, _FASTEST = 0.1, 100  # frames a second; a GIF counts hundredths of a second


def render_clip(
    robot: Robot,
    plant: Plant | None,
    record: Record,
    path: str | Path,
    *,
    speed: float = 1.0,
    rate: float = 25.0,
    width: int = 640,
    height: int = 480,
    azimuth: float | None = None,
    elevation: float | None = None,
    further: Further = (),
    labels: Sequence[str] = (),
    overwrite: bool = False,
    kept: Constraints | None = None,
    progress: Callable[[int, int], None] = lambda drawn, total: None,
) -> None:
    """Save a clip of an arm, or of a mobile manipulator, with the time in its corner.

    Further runs show through the first, in colours of their own. A mobile manipulator that was not in physics is drawn
    as physics would, on wheels that do not slip. Of an arm also the desired path (dashed, blue), the end effector's
    path so far (red), and the world.

    Parameters
    ----------
    robot, plant, record
        What moved, in which plant, and what happened; a saved recording will do. An arm needs no plant.
    path
        Where to save it: ``.mp4``, ``.webp``, or ``.gif``; the last two play for ever.
    speed
        How much faster than it was.
    rate
        Frames a second.
    width, height
        Pixels; even for ``.mp4``.
    azimuth, elevation
        Direction of view, degrees; negative elevations look down. By default from before and above.
    further
        Plant and recording of further runs of the same robot, among the same things.
    labels
        One a run, the first's first, to stand in the picture's corner; none if omitted.
    overwrite
        True to replace an existing file.
    kept
        Constraints whose obstacles and zones are drawn, with the nearest pair; of the plant's world if omitted.
    progress
        Told how many frames of how many are drawn.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed, this machine has no OpenGL, or ``.mp4`` is wanted without PyAV.
    ExistsError, FileFormatError
        If the file exists, its folder does not, or its ending is another.
    ShapeError, ValueRangeError
        If the recording is not of this robot and plant, a number does not fit, or it cannot be drawn.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> run = dqc.run("examples/circle.yaml")  # doctest: +SKIP
    >>> render_clip(run.robot, None, run.record, "circle.webp")  # doctest: +SKIP
    """
    target = _target(path, CLIPS, overwrite)
    step = as_positive("speed", speed) / as_positive("rate", rate)
    count = int(_end(record, further) / step + 1e-9) + 1
    if count > _MOST_FRAMES:
        raise ValueRangeError(f"rate: makes {count} frames, at most {_MOST_FRAMES} are drawn; or more speed")
    if not _SLOWEST <= rate <= _FASTEST:
        raise ValueRangeError(f"rate: must lie in {_SLOWEST} … {_FASTEST} frames a second, got {rate:g}")
    if target.suffix.lower() == ".mp4":
        from_extra("av", "video", _MP4)  # before the work: it may be missing
        if width % 2 or height % 2:
            raise ValueRangeError(f"width, height: must be even for .mp4, got {width} and {height}")
    moments = np.linspace(0.0, step * (count - 1), count)
    runs = [(plant, record), *further]
    pictures = _pictures(robot, runs, moments, (width, height), (azimuth, elevation), labels, kept)
    with writing(target), whole_file(target, overwrite=overwrite) as draft:
        write_clip((np.asarray(picture) for picture in _told(pictures, count, progress)), draft, rate)


def render_whole(
    robot: Robot,
    plant: Plant | None,
    record: Record,
    path: str | Path,
    *,
    width: int = 640,
    height: int = 480,
    azimuth: float | None = None,
    elevation: float | None = None,
    further: Further = (),
    labels: Sequence[str] = (),
    overwrite: bool = False,
    kept: Constraints | None = None,
) -> None:
    """Save one picture of a whole run as a PNG file.

    An arm is seen at its end, earlier configurations through it, and its paths, as `render_run` draws them; of a mobile
    manipulator, of several runs, and where constraints are drawn, there is a strip of six pictures at equal
    times, but one where the robot was nearest to what it keeps away from, or was pressed hardest.

    Parameters
    ----------
    robot, plant, record, azimuth, elevation, further, labels, overwrite, kept
        As for `render_clip`.
    path
        Where to save it, ``.png``.
    width, height
        Of each picture, pixels.

    Raises
    ------
    Error
        As `render_clip`.
    """
    look: dict[str, Any] = {"width": width, "height": height, "overwrite": overwrite}
    film = _film(robot, [(plant, record), *further], kept)
    if further or kept is not None or getattr(plant, "world", None) or not film.is_overlaid:
        times = _moments(record, _end(record, further))
        look |= {"azimuth": azimuth, "elevation": elevation, "further": further, "labels": labels}
        render_strip(robot, plant, record, path, times, kept=kept, **look)
        return
    desired = desired_in_room(robot, record.q, record.desired[:, :8])
    hand, *hands = tip_paths(robot, record)
    look["azimuth"] = film.azimuth if azimuth is None else azimuth
    look["elevation"] = film.elevation if elevation is None else elevation
    render_run(robot, record.q, hand, desired, path, further=hands, **look)


def render_strip(
    robot: Robot,
    plant: Plant | None,
    record: Record,
    path: str | Path,
    times: Sequence[float],
    *,
    columns: int = 3,
    width: int = 480,
    height: int = 360,
    azimuth: float | None = None,
    elevation: float | None = None,
    further: Further = (),
    labels: Sequence[str] = (),
    overwrite: bool = False,
    kept: Constraints | None = None,
) -> None:
    """Save pictures of a run at some times, side by side in one PNG file, each with its time.

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
    azimuth, elevation, further, labels, overwrite, kept
        As for `render_clip`.

    Raises
    ------
    Error
        As `render_clip`.
    """
    target = _target(path, (".png",), overwrite)
    moments = as_array("times", times, (None,))
    end = _end(record, further)
    if moments.ndim != 1 or not len(moments) or moments.min() < 0 or moments.max() > end + 1e-9:
        raise ValueRangeError(f"times: must lie in 0 … {end:g} s, got {times}")
    across = as_count("columns", columns)
    if not across:
        raise ValueRangeError("columns: must be ≥ 1, got 0")
    runs = [(plant, record), *further]
    pictures = list(_pictures(robot, runs, moments, (width, height), (azimuth, elevation), labels, kept))
    rows = math.ceil(len(pictures) / across)
    sheet = importlib.import_module("PIL.Image").new("RGB", (across * width, rows * height), "white")
    for k, picture in enumerate(pictures):
        sheet.paste(picture, (k % across * width, k // across * height))
    with writing(target), whole_file(target, overwrite=overwrite) as draft:
        sheet.save(draft)


def _told(pictures: Iterable[Any], count: int, progress: Callable[[int, int], None]) -> Iterator[Any]:
    """Give pictures on, and tell how many there were."""
    progress(0, count)
    for drawn, picture in enumerate(pictures, 1):
        yield picture
        progress(drawn, count)


def _moments(record: Record, end: float) -> list[float]:
    """Return six times from 0 to the end, s: the nearest to where it was closest, or pressed hardest, is that."""
    times = np.linspace(0.0, end, _PICTURES)
    force, kept = contact_force(record), record.readings.get(DISTANCE)
    if force is not None and force.any():
        closest = float(record.time[int(force.argmax())])
    elif kept is not None and np.isfinite(kept.values).any():
        closest = float(record.time[np.unravel_index(int(np.nanargmin(kept.values)), kept.values.shape)[0]])
    else:
        return times.tolist()
    inner = 1 + int(np.abs(times[1:-1] - closest).argmin())
    times[inner] = min(max(closest, times[inner - 1]), times[inner + 1])
    return times.tolist()


def _end(record: Record, further: Further) -> float:
    """Return when the longest of some runs ends, s."""
    return max(float(each.time[-1]) for each in (record, *(each for _, each in further)))


def _pictures(
    robot: Robot,
    runs: Further,
    times: NDArray[np.float64],
    size: tuple[int, int],
    view: tuple[float | None, float | None],
    labels: Sequence[str],
    kept: Constraints | None,
) -> Iterator[Any]:
    """Give the pictures of runs at some times, with the time in their corner; a run that has ended stays as it was."""
    if min(as_count("width", size[0]), as_count("height", size[1])) < 1:
        raise ValueRangeError(f"width, height: must be ≥ 1, got {size[0]} and {size[1]}")
    for field, angle in zip(("azimuth", "elevation"), view, strict=True):
        if angle is not None and not math.isfinite(angle):
            raise ValueRangeError(f"{field}: must be finite, got {angle}")
    if labels and len(labels) != len(runs):
        raise ShapeError(f"labels: expected {len(runs)}, one a run, got {len(labels)}")
    image, drawing = importlib.import_module("PIL.Image"), importlib.import_module("PIL.ImageDraw")
    samples = [
        np.clip(np.searchsorted(record.time, times - 1e-9), 0, len(record.time) - 1) for _, record in runs
    ]
    film = _film(robot, runs, kept)
    plans = plans_of_run(runs[0][1])
    height = size[1] / 18
    for time, pixels in zip(times, frames(film, np.column_stack(samples), *size, *view), strict=True):
        picture = image.fromarray(pixels)
        pen = drawing.Draw(picture)
        pen.text((12, 8), f"{time:.1f} s", fill=_INK, font_size=height)
        if (planned := [each for each in plans if each.time <= time]) and np.isfinite(planned[-1].room):
            words = f"way proved: {1e3 * planned[-1].room:.3g} mm to spare"
            pen.text((12, size[1] - 1.2 * height), words, fill=_INK, font_size=0.7 * height)
        for i, label in enumerate(labels):
            colour = COLOURS[(i - 1) % len(COLOURS)]
            ink = tuple(round(255 * part) for part in colour) if i else _INK
            pen.text((12, 8 + 1.3 * height * (i + 1)), label, fill=ink, font_size=0.8 * height)
        yield picture


def _film(robot: Robot, runs: Further, kept: Constraints | None) -> Film:
    """Return what a camera needs of runs."""
    (plant, record), *further = runs
    period = float(record.time[1] - record.time[0]) if len(record.time) > 1 else 1e-3
    if kept is None and isinstance(world := getattr(plant, "world", None), World):
        kept = Constraints(world=world)
    around = None if kept is None else ConstraintView(kept, robot, period)
    if plant is not None and (picture := plant.picture(robot)) is not None:
        others = [_in_physics(robot, *each, World(bodies={})) for each in further]
        return film_physics(robot, picture, record, others)
    if isinstance(robot, SerialArm) or (isinstance(robot, TreeRobot) and not robot.bases):
        return film_arm(robot, record, [each for _, each in further], around)
    bodies = kept.world.bodies if kept is not None and kept.world is not None else {}
    around_base = World(bodies={name: body for name, body in bodies.items() if stands(body)})
    first, *others = (_in_physics(robot, *each, around_base) for each in runs)
    return film_physics(robot, *first, others)


def _in_physics(
    robot: Robot, plant: Plant | None, record: Record, world: World
) -> tuple[PhysicsPicture, Record]:
    """Return how physics draws a mobile manipulator among what stands, and its run with the angles of the wheels."""
    if plant is not None and (picture := plant.picture(robot)) is not None:
        return picture, record
    if robot.bases:
        with contextlib.suppress(ValueRangeError):
            return MobilePlant(world=world).picture(robot), with_rolling_wheels(robot, record)
    raise ValueRangeError(
        f"clip: draws arms, and mobile manipulators on one differential drive of known size; to see {robot.name}: "
        "dqcontrol view"
    )


def _target(path: str | Path, endings: Sequence[str], overwrite: bool) -> Path:
    """Return where to save, or say why that cannot be."""
    target = Path(path)
    if target.suffix.lower() not in endings:
        raise FileFormatError(f"{target}: must end in {' or '.join(endings)}, got '{target.suffix}'")
    check_picture_file(target, overwrite=overwrite)
    return target
