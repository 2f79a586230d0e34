"""Write the signals of a run, or a world, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dqcontrol.cli.options import DEFAULT_LOG_OPTIONS, Force, LogOptions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dqcontrol.arrays import Array
    from dqcontrol.files.lerobot_dataset import Feature
    from dqcontrol.robots import Robot

_WORLDS = (".yaml", ".yml", ".xml", ".urdf", ".scene")
_MAPS = (".pgm", ".png")


def convert(
    run: Path,
    file: Path | None = None,
    /,
    *,
    to: Literal["lerobot"] | None = None,
    fps: int | None = None,
    task: str | None = None,
    robot: str | None = None,
    options: LogOptions = DEFAULT_LOG_OPTIONS,
    targets: str | None = None,
    force: Force = False,
) -> None:
    """Write all signals of a run for other programs; runs and logs as a LeRobot dataset; a world in another format.

    Parameters
    ----------
    run
        Folder of a run; or the file of a world: .yaml, .xml (MJCF), .urdf or .scene (MoveIt). With --to lerobot also a
        folder of several runs, each an episode, or a log.
    file
        New file; its suffix chooses the format: of signals .csv, .parquet or .mat, of worlds those above, or .pgm and
        .png: a map of the floor for ROS's map server, with its .yaml beside it. With --to lerobot a new folder;
        default: results/NAME-lerobot.
    to
        lerobot: a dataset of version 3.0 (extra lerobot); see docs/lerobot.md.
    fps
        Frames a second of the dataset; default: the samples of the run.
    task
        What the dataset's episodes do, in words; default: the name of each run.
    robot
        Of a log: name, .yaml or .urdf file, or example-robot-data:PATH.
    targets
        Of a log: columns with the commanded positions, what their names begin with (target_), or a,b,c.
    force
        Replace an existing file or dataset.
    """
    from dqcontrol.errors import ExistsError, ShapeError, ValueRangeError, writing
    from dqcontrol.experiments import load_run
    from dqcontrol.experiments.spec.world_file import load_world, world_text
    from dqcontrol.files.whole_file import whole_file
    from dqcontrol.geometry import save_map
    from dqcontrol.world import floor_around

    if to == "lerobot":
        _write_dataset(run, file, fps, task, robot, {**options.arguments(), "targets": targets}, force=force)
        return
    given = {"--fps": fps, "--task": task, "--robot": robot, "--targets": targets}
    for option in (name for name, value in given.items() if value is not None):
        raise ValueRangeError(f"{option}: is for datasets: give --to lerobot, too")
    if file is None:
        raise ValueRangeError("file: expected a new file, as run.csv; its suffix chooses the format")
    if run.is_file() and file.suffix.lower() in _MAPS:
        if file.with_suffix(".yaml").resolve() == run.resolve():
            raise ExistsError(f"{file}: its .yaml would be {run} itself; choose another name")
        floor = floor_around(load_world(run), "all", "world")
        print(f"results: {file}, {save_map(floor, file, force=force)}")
        return
    if run.is_file() and file.suffix.lower() in _WORLDS:
        text = world_text(load_world(run), file.suffix.lower())
        if file.exists() and not force:
            raise ExistsError(f"{file}: exists already; give --force to replace it")
        with writing(file), whole_file(file, overwrite=force) as draft:
            draft.write_text(text, encoding="utf-8")
        print(f"results: {file}")
        return
    if run.is_file():
        raise ShapeError(
            f"{run}: is a file; signals are those of a run, whose folder dqcontrol run writes; "
            f"a controller in C: dqcontrol export {run} --out FOLDER"
        )
    print(f"results: {load_run(run).export(file, force=force)}")


def _write_dataset(
    source: Path,
    folder: Path | None,
    fps: int | None,
    task: str | None,
    robot: str | None,
    options: dict[str, Any],
    *,
    force: bool,
) -> None:
    from dqcontrol.errors import ShapeError, ValueRangeError
    from dqcontrol.files.lerobot_dataset import Episode, whole_rate, write_dataset
    from dqcontrol.recording.export import at_rate

    if fps is not None and fps < 1:
        raise ValueRangeError(f"--fps: must be ≥ 1, got {fps}")
    motions = list(_motions(source, robot, options))
    first = motions[0]
    rate = fps or whole_rate(first[2])
    features = {name: feature for name, (feature, _) in first[3].items()}
    for name, _, _, columns in motions[1:]:
        if {key: feature for key, (feature, _) in columns.items()} != features:
            raise ShapeError(
                f"{source}: {name} has other joints or readings than {first[0]}; convert them each to its own dataset"
            )
    episodes = [Episode(task or name, at_rate(time, columns, rate)) for name, _, time, columns in motions]
    out = folder or Path("results") / f"{source.stem}-lerobot"
    write_dataset(out, rate, features, episodes, robot_type=first[1].name, force=force)
    count = sum(len(next(iter(each.values.values()))) for each in episodes)
    plural = "s" * (len(episodes) != 1)
    print(f"{len(episodes)} episode{plural}, {count} frames at {rate} a second: {', '.join(features)}")
    print(f"results: {out}")


def _motions(
    source: Path, robot: str | None, options: dict[str, Any]
) -> Iterator[tuple[str, Robot, Array, dict[str, tuple[Feature, Array]]]]:
    """Yield name, robot, time and columns of each motion of a log, a run or a folder of runs."""
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments import load_run
    from dqcontrol.experiments.load_results import run_folders
    from dqcontrol.logs import read_joint_log
    from dqcontrol.recording.export import motion_columns, record_columns
    from dqcontrol.robots import load_robot

    if robot is not None:
        ends = options.pop("base_link", None), options.pop("tip_link", None)
        arm = load_robot(robot, *ends)
        log = read_joint_log(source, arm, **options)
        yield source.stem, arm, log.time, motion_columns(arm, log.time, log.q, log.command, log.target)
        return
    if source.is_file():
        raise ValueRangeError(f"--robot: {source} is a log, which does not name its robot; give one")
    for path in run_folders(source):
        run = load_run(path)
        yield path.name, run.robot, run.record.time, record_columns(run.robot, run.record)
