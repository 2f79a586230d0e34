"""Measure, identify, calibrate and convert what a robot's logs hold."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from dqcontrol.cli import options
from dqcontrol.cli.screen import FAILED, print_found

if TYPE_CHECKING:
    from collections.abc import Iterator

    from dqcontrol.arrays import Array
    from dqcontrol.files.lerobot_dataset import Feature
    from dqcontrol.robots import Robot

Way = Annotated[float, options.in_unit("rad or m", "17deg")]
Start = Annotated[
    str | None,
    Parameter(help="Configuration about which it moves: a,b,c in rad or m, or with units: 90deg,0."),
]
SensorPosition = Annotated[
    str | None,
    Parameter(help="Of the force sensor as seen from the hand: x,y,z in m.", allow_leading_hyphen=True),
]
SensorTurn = Annotated[
    str | None, Parameter(help="Its roll, pitch, yaw: a,b,c in rad.", allow_leading_hyphen=True)
]
_WORLDS, _MAPS = (".yaml", ".yml", ".xml", ".urdf", ".scene"), (".pgm", ".png")


def evaluate(
    log: Path,
    /,
    *,
    robot: str | None = None,
    logged: options.LogOptions = options.DEFAULT_LOG_OPTIONS,
    reference: Path | None = None,
    reference_topic: str | None = None,
    reference_joints: str | None = None,
    missing: Literal["interpolate", "skip"] = "interpolate",
    start_time: options.Seconds = 0.0,
    align: options.Switch = False,
    duration: Annotated[float | None, options.SECONDS] = None,
    skip_initial: Annotated[float | None, options.SECONDS] = None,
    low_pass: Annotated[float | None, options.in_unit("Hz", "10Hz")] = None,
    out: options.Out = None,
    force: options.ReplaceResults = False,
) -> None:
    """Measure your own joint log against a reference: table, and plots and report if --out is given.

    It begins with the verdict. Exit status: 0 if the end effector did what was asked, 1 if it did not, 2 if nothing was
    measured, because something is wrong.

    Parameters
    ----------
    log
        Table (CSV), MCAP file, ROS 1 or ROS 2 bag, or folder of a run; see docs/own-data.md.
    robot
        Name, .yaml or .urdf file, or example-robot-data:PATH; recordings of dqcontrol name theirs.
    reference
        YAML file with a reference, points file, or a second log; recordings of dqcontrol hold their own.
    reference_topic
        Topic of PoseStamped with the desired poses, or of JointState with the commanded positions, in --reference or
        else in the log.
    reference_joints
        Columns of the log with the commanded positions: what their names begin with (target_), or a,b,c.
    missing
        What to do with samples of a table that lack a position: join their neighbours linearly, or skip them.
    start_time
        When the reference begins, s after the log's first sample.
    align
        Find the start at which the reference fits the log best.
    duration
        How many seconds from there on are judged.
    skip_initial
        Length of the start that the settled errors leave out, s.
    low_pass
        Cut-off of the filter behind speeds and accelerations, Hz; 0 for none; default 10, none for own recordings.
    out
        New folder for record, metrics, plots and report.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.evaluation import evaluate_log
    from dqcontrol.measures import summary_table

    if out is not None:
        check_new(out, force=force)
    result = evaluate_log(
        log,
        robot,
        reference,
        reference_topic=reference_topic,
        reference_joints=reference_joints,
        **logged.arguments(),
        missing=missing,
        start=start_time,
        align=align,
        duration=duration,
        skip_initial=skip_initial,
        low_pass=low_pass,
    )
    if out is not None:
        result.save(out, force=force)
    filtered = ""
    if result.low_pass is not None:
        filtered = f"; speeds, accelerations and joint steps low-passed at {result.low_pass:g} Hz"
    print(result.verdict.words)
    print_found(summary_table(result.metrics, f"{result.label}{filtered}"), folder=out)
    if result.verdict.failure:
        sys.exit(FAILED)


def excite(
    robot: options.LoggedRobot,
    /,
    *,
    start: Start = None,
    base_link: options.BaseLink = None,
    tip_link: options.TipLink = None,
    signal: Literal["zigzag", "multisine", "chirp"] = "zigzag",
    together: options.Switch = False,
    duration: options.Seconds = 60.0,
    period: options.Seconds = 0.008,
    amplitude: Way = 0.3,
    joint_speed: Annotated[float, options.in_unit("rad/s or m/s", "60deg/s")] = 1.0,
    joint_acceleration: Annotated[float, options.in_unit("rad/s² or m/s²", "90deg/s²")] = 6.0,
    workspace: Annotated[
        str | None, Parameter(help="Box that the hand does not leave: x0,x1,y0,y1,z0,z1 in m, base frame.")
    ] = None,
    lag: options.Seconds = 0.05,
    delay: options.Seconds = 0.02,
    noise: Way = 1e-4,
    resolution: Way = 0.0,
    seed: int = 1,
    out: options.Out = None,
    force: options.Force = False,
) -> None:
    """Generate an excitation trajectory for `identify`, and say how precise the estimates will be.

    Numbers may have a unit: 8ms, 17deg.

    Parameters
    ----------
    signal
        zigzag (tells most), multisine or chirp (smoother).
    together
        All joints at once, the whole time; else one after the other, then all together by a multisine.
    duration
        Of the motion, s.
    period
        Control period, s.
    amplitude
        Largest distance of a joint from its start, rad or m.
    joint_speed
        Largest of a joint, rad/s or m/s; no more than 0.9 of the robot's limits.
    joint_acceleration
        Largest of a joint, rad/s² or m/s².
    lag
        To expect, s: what the precision is said for; so are delay, noise and resolution.
    delay
        To expect, s.
    noise
        Of the encoders to expect, rad or m.
    resolution
        Of the encoders to expect, rad or m.
    seed
        Of turning points and phases.
    out
        New folder for motion.csv, hand.csv and excite.yaml, which runs them.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.servos import excite as design

    if out is not None and not force:
        check_new(out, force=False)
    found = design(
        robot,
        options.numbers("start", start, "rad or m"),
        base_link=base_link,
        tip_link=tip_link,
        signal=signal,
        together=together,
        duration=duration,
        period=period,
        amplitude=amplitude,
        speed=joint_speed,
        acceleration=joint_acceleration,
        workspace=options.numbers("workspace", workspace, "m"),
        lag=lag,
        delay=delay,
        noise=noise,
        resolution=resolution,
        seed=seed,
    )
    if out is not None:
        found.save(out, force=force)
    print_found(found.table, folder=out, words=found.remarks)
    if out is not None:
        print(f"run it: dqcontrol run {out / 'excite.yaml'} --out RESULTS")


identify: App = App(
    name="identify",
    help="Estimate what a robot is from its logs: servos, or the tool on its force sensor.",
    help_format="plaintext",
)


@identify.default
def servos(
    logs: list[Path],
    /,
    *,
    robot: options.LoggedRobot,
    logged: options.LogOptions = options.DEFAULT_LOG_OPTIONS,
    targets: str | None = None,
    target_topic: str | None = None,
    replay: options.Switch = False,
    out: options.Out = None,
    force: options.Force = False,
) -> None:
    """Find lag, delay, gain, sag and encoder of each joint from logs of commands and measured positions.

    Parameters
    ----------
    logs
        Tables (CSV), MCAP files, ROS 1 or ROS 2 bags of one robot; see docs/identify.md.
    targets
        Columns with the commanded positions: what their names begin with (target_), or a,b,c.
    target_topic
        Topic of JointState or Float64MultiArray with the commanded positions.
    replay
        Also run the commands of the first log on the plant: OUT/log and OUT/replay are runs to compare and to view.
    out
        New folder for identification.json, plant.yaml and report.html.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.servos import identify as identify_servos
    from dqcontrol.reports.study_reports import write_identification_report

    if out is not None and not force:
        check_new(out, force=False)
    if replay and out is None:
        raise ValueRangeError("--replay: needs a folder for its runs; give --out")
    found = identify_servos(logs, robot, targets=targets, target_topic=target_topic, **logged.arguments())
    print_found(found.table, folder=out, words=found.remarks)
    if out is not None:
        found.save(out, force=force)
        write_identification_report(found, out)
        if replay and found.fitted:
            print(found.save_replay(out))
            print(f"beside each other: dqcontrol compare {out / 'log'} {out / 'replay'}")
        if not found.fitted:
            print("no plant.yaml: no joint could be identified")


@identify.command
def tool(
    logs: list[Path],
    /,
    *,
    robot: options.LoggedRobot,
    known: Path | None = None,
    sensor_position: SensorPosition = None,
    sensor_rpy: SensorTurn = None,
    wrench_topic: str | None = None,
    logged: options.JointOptions = options.DEFAULT_JOINT_OPTIONS,
    out: options.Out = None,
    force: options.Force = False,
) -> None:
    """Find mass, centre and bias of the tool on a force sensor, from logs in which the robot rests in several poses.

    Parameters
    ----------
    logs
        Runs, tables with columns fx, fy, fz, tx, ty, tz beside the joints, or recordings of ROS.
    known
        File of a tool whose mass and centre are kept: a tare, for which one rest in the air is enough.
    wrench_topic
        Topic of WrenchStamped, the only one if omitted.
    out
        New file for contact.sensor.tool and supervisor.payload of specs.
    force
        Replace that file.
    """
    from dqcontrol.contact import load_tool
    from dqcontrol.logs import tool_from_logs
    from dqcontrol.robots import load_robot

    chosen = logged.arguments()
    found = tool_from_logs(
        logs,
        load_robot(robot, chosen.pop("base_link"), chosen.pop("tip_link")),
        _sensor(sensor_position, sensor_rpy),
        known=None if known is None else load_tool(known),
        wrench_topic=wrench_topic,
        **chosen,
    )
    print_found(found.table, folder=out and found.save(out, force=force))


@identify.command
def tool_motion(
    robot: options.LoggedRobot,
    /,
    *,
    start: Start = None,
    sensor_position: SensorPosition = None,
    sensor_rpy: SensorTurn = None,
    period: options.Seconds = 0.008,
    out: options.Out = None,
    force: options.Force = False,
) -> None:
    """Propose a motion that rests where the tool on a force sensor can be told, and say how well.

    Parameters
    ----------
    period
        Control period, s.
    out
        New folder for motion.csv and tool.yaml, which runs it.
    force
        Replace these files in an existing folder.
    """
    from dqcontrol.logs import tool_motion as propose

    found = propose(
        robot,
        options.numbers("start", start, "rad or m"),
        _sensor(sensor_position, sensor_rpy),
        period=period,
    )
    print_found(found.table, folder=out and found.save(out, force=force))
    if out is not None:
        print(f"run it: dqcontrol run {out / 'tool.yaml'} --out RESULTS")
        print(f"then:   dqcontrol identify tool RESULTS --robot {robot} --out my_tool.yaml")


def _sensor(position: str | None, rpy: str | None) -> Any:
    from dqcontrol.contact import ForceSensor

    given = {
        "position": options.numbers("sensor-position", position, "m"),
        "rpy": options.numbers("sensor-rpy", rpy, "rad"),
    }
    told: dict[str, Any] = {key: tuple(value) for key, value in given.items() if value is not None}
    return ForceSensor(**told)


def calibrate(
    log: Path,
    /,
    *,
    robot: options.LoggedRobot,
    logged: options.JointOptions = options.DEFAULT_JOINT_OPTIONS,
    pose_topic: str | None = None,
    out: options.Out = None,
    force: options.Force = False,
) -> None:
    """Correct DH parameters, base and tool frame of an arm from measured poses of its end effector.

    Parameters
    ----------
    log
        Table (CSV) of joint positions and measured poses x, y, z, qw, qx, qy, qz; or a recording with both.
    pose_topic
        Topic of PoseStamped with the measured poses.
    out
        New folder for robot.yaml, the corrected arm, and calibration.json.
    force
        Replace these two files in an existing folder.
    """
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.logs.calibration import calibrate as calibrate_arm

    if out is not None and not force:
        check_new(out, force=False)
    found = calibrate_arm(log, robot, pose_topic=pose_topic, **logged.arguments())
    if out is not None:
        found.save(out, force=force)
    print_found(found.table, found.error_table, folder=out, words=found.remarks)


def convert(
    run: Path,
    file: Path | None = None,
    /,
    *,
    to: Literal["lerobot"] | None = None,
    fps: int | None = None,
    task: str | None = None,
    robot: str | None = None,
    logged: options.LogOptions = options.DEFAULT_LOG_OPTIONS,
    targets: str | None = None,
    force: options.Force = False,
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
    from dqcontrol.files.output_file import whole_file
    from dqcontrol.geometry import save_map
    from dqcontrol.world import floor_around

    if to == "lerobot":
        _write_dataset(run, file, fps, task, robot, {**logged.arguments(), "targets": targets}, force=force)
        return
    given = {"--fps": fps, "--task": task, "--robot": robot, "--targets": targets}
    for option in (name for name, value in given.items() if value is not None):
        raise ValueRangeError(f"{option}: is for datasets: give --to lerobot, too")
    if file is None:
        raise ValueRangeError("file: expected a new file, as run.csv; its suffix chooses the format")
    suffix = file.suffix.lower()
    if not run.is_file():
        print(f"results: {load_run(run).export(file, force=force)}")
    elif suffix in _MAPS:
        if file.with_suffix(".yaml").resolve() == run.resolve():
            raise ExistsError(f"{file}: its .yaml would be {run} itself; choose another name")
        floor = floor_around(load_world(run), "all", "world")
        print(f"results: {file}, {save_map(floor, file, force=force)}")
    elif suffix in _WORLDS:
        text = world_text(load_world(run), suffix)
        if file.exists() and not force:
            raise ExistsError(f"{file}: exists already; give --force to replace it")
        with writing(file), whole_file(file, overwrite=force) as draft:
            draft.write_text(text, encoding="utf-8")
        print(f"results: {file}")
    else:
        raise ShapeError(
            f"{run}: is a file; signals are those of a run, whose folder dqcontrol run writes; "
            f"a controller in C: dqcontrol export {run} --out FOLDER"
        )


def _write_dataset(
    source: Path,
    folder: Path | None,
    fps: int | None,
    task: str | None,
    robot: str | None,
    logged: dict[str, Any],
    *,
    force: bool,
) -> None:
    from dqcontrol.errors import ShapeError, ValueRangeError
    from dqcontrol.files.lerobot_dataset import Episode, whole_rate, write_dataset
    from dqcontrol.recording.export import at_rate

    if fps is not None and fps < 1:
        raise ValueRangeError(f"--fps: must be ≥ 1, got {fps}")
    motions = list(_motions(source, robot, logged))
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
    source: Path, robot: str | None, logged: dict[str, Any]
) -> Iterator[tuple[str, Robot, Array, dict[str, tuple[Feature, Array]]]]:
    """Yield name, robot, time and columns of each motion of a log, a run or a folder of runs."""
    from dqcontrol.errors import ValueRangeError
    from dqcontrol.experiments import load_run
    from dqcontrol.experiments.load_results import run_folders
    from dqcontrol.logs import read_joint_log
    from dqcontrol.recording.export import motion_columns, record_columns
    from dqcontrol.robots import load_robot

    if robot is not None:
        ends = logged.pop("base_link", None), logged.pop("tip_link", None)
        arm = load_robot(robot, *ends)
        log = read_joint_log(source, arm, **logged)
        yield source.stem, arm, log.time, motion_columns(arm, log.time, log.q, log.command, log.target)
        return
    if source.is_file():
        raise ValueRangeError(f"--robot: {source} is a log, which does not name its robot; give one")
    for path in run_folders(source):
        run = load_run(path)
        yield path.name, run.robot, run.record.time, record_columns(run.robot, run.record)
