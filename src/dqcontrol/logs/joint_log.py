"""Joint positions over time as the user's own programs and robots have logged them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError
from dqcontrol.files.lerobot_dataset import ACTION, COMMAND, STATE, Dataset, Feature, episode_of, only_episode
from dqcontrol.logs.joint_messages import held, is_recording, read_commands, read_joint_states
from dqcontrol.logs.joint_table import DEGREES_NOTE, Angles, must_be_degrees, read_joint_table
from dqcontrol.logs.text_table import Missing
from dqcontrol.loop import Record
from dqcontrol.plants.plant import WRENCH_READINGS
from dqcontrol.recording import load_metadata, load_record
from dqcontrol.robots import Robot, SerialArm, load_robot

_GAP = 3.0  # periods
_FAR = 12.0  # standard deviations of the noise
_STEPS = 3.0  # times what a joint moves in a period, or the least step that it was ever seen to make
_LEAST = 1e-3  # rad or m
_BEYOND = 0.05  # rad or m over a limit


def _gaps(time: Array) -> list[str]:
    steps = np.diff(time)
    period = float(np.median(steps)) if len(steps) > 2 else np.inf  # too few to tell: none is wide
    wide = np.flatnonzero(steps > _GAP * period)
    if not len(wide):
        return []
    longest = wide[steps[wide].argmax()]
    return [
        f"time: {len(wide)} gap{'s' * (len(wide) > 1)} of more than {_GAP:g} periods of {period:.4g} s, "
        f"the longest {steps[longest]:.4g} s at {time[longest]:.4g} s"
    ]


def spikes(values: Array) -> Array:
    """Return by how much each sample stands out from both its neighbours to the same side; 0 where it does not.

    A spike is larger than 12 standard deviations of the noise, as the median of the second differences gives it, and
    than what the signal moves in three periods.
    """
    if len(values) < 5:
        return np.zeros(len(values))
    steps = np.diff(values)
    sizes = np.abs(steps)
    noise = float(np.median(np.abs(np.diff(steps)))) / (0.6745 * np.sqrt(6))
    moving = sizes[sizes > 0]
    quantum = float(moving.min()) if len(moving) else 0.0
    least = max(_FAR * noise, _STEPS * quantum, _STEPS * float(np.quantile(sizes, 0.9)), _LEAST)
    found = np.zeros(len(values))
    out = (steps[:-1] * steps[1:] < 0) & (np.minimum(sizes[:-1], sizes[1:]) > least)
    found[1:-1][out] = np.minimum(sizes[:-1], sizes[1:])[out]
    return found


def _outliers(time: Array, q: Array, robot: Robot, names: Sequence[str]) -> list[str]:
    lines = []
    for i, name in enumerate(names):
        sizes = spikes(q[:, i])
        count = int(np.count_nonzero(sizes))
        if count:
            unit = "rad" if robot.joint_types[i] == "revolute" else "m"
            lines.append(
                f"{name}: {count} sample{'s' * (count > 1)} far from both neighbours, the largest by "
                f"{sizes.max():.3g} {unit} at {time[sizes.argmax()]:.4g} s; they count in all peaks"
            )
    return lines


def _beyond(q: Array, robot: Robot, names: Sequence[str]) -> list[str]:
    limits = robot.limits
    over = np.maximum(limits.lower - q.min(axis=0), q.max(axis=0) - limits.upper)
    lines = [f"{names[i]} by {over[i]:.3g}" for i in range(len(names)) if over[i] > _BEYOND]
    if not lines:
        return []
    listed = ", ".join(lines)
    return [f"joints leave the limits of {robot.name} ({listed} rad or m): other units, zeros or signs?"]


@dataclass(frozen=True, eq=False)
class JointLog:
    """N samples of a robot with n joints.

    Attributes
    ----------
    path
        The file or folder.
    time
        s after the first sample, shape (N,), increasing from 0.
    q
        Configuration, shape (N, n), rad or m.
    command
        Commanded inputs, shape (N, m), rad/s or m/s; None if the log has none.
    origin
        Stamp of the first sample, ns; 0 for tables.
    record
        The record, if the log is a recording of ours.
    target
        Commanded positions, shape (N, n), rad or m; None if the log has none.
    notes
        What was recognised, left out or joined, and what is unusual, a line each.
    wrench
        Force and torque at a sensor, its axes, shape (N, 6), N and N·m; None if the log has none.
    """

    path: Path
    time: Array
    q: Array
    command: Array | None
    origin: int = 0
    record: Record | None = None
    target: Array | None = None
    notes: tuple[str, ...] = ()
    wrench: Array | None = None


def read_joint_log(
    path: str | os.PathLike[str],
    robot: Robot,
    *,
    joints: Sequence[str] | None = None,
    angles: Angles | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
    targets: str | Sequence[str] | None = None,
    missing: Missing = "interpolate",
) -> JointLog:
    r"""Read a joint log: a table, an MCAP file, a ROS 1 or ROS 2 bag, an episode of a LeRobot dataset.

    A table is a text file with a line of column names, separated by commas, semicolons, tabs or blanks, and one
    line a sample. Its columns, in any order: ``time`` (or ``timestamp``, ``t``, ``stamp``; s, or dates as ISO 8601
    writes them), one for each joint, by the robot's joint names or
    ``q1`` … ``qn``, and, if commands were logged, ``command.JOINT`` for each or ``u1`` … ``um``; commanded positions
    are ``target.JOINT``, ``target_JOINT`` or ``r1`` … ``rn``; what a force sensor shows ``fx``, ``fy``, ``fz``, ``tx``,
    ``ty``, ``tz``. A unit may stand
    behind a name, as ``time [ms]`` (s, ms, us, ns), ``q1 [deg]`` (rad, deg; m, mm for sliding joints), ``q1_deg`` or
    ``u1 [deg/s]``. Other columns, empty lines and lines that begin with ``#`` are left out; a ``#`` before the
    names themselves is allowed. Time without a unit whose steps are 0.5 or longer is taken for ms, µs or ns; angles
    without a unit that leave the robot's limits by turns are taken for degrees; ``JointLog.notes`` says so.

    In recordings, positions come from a topic of type sensor_msgs/JointState at the times in the headers (at the
    times of recording, where the headers have none); messages that name no joint of the robot are left out.

    In LeRobot datasets (version 3.0; ``FOLDER``, or ``FOLDER:EPISODE`` where there are several) positions are the parts
    ``JOINT.pos`` of ``observation.state``, commanded positions those of ``action``, and commanded velocities the parts
    ``INPUT.vel`` of ``command`` or ``action``; angles are rad where the dataset tells no unit.

    Parameters
    ----------
    path
        ``.mcap``; ``.bag`` or the folder of a ROS 2 bag (both need rosbags); the folder of a run, or of a dataset
        (needs pyarrow); else a table.
    robot
        Whose joints to look for.
    joints
        Their names in the log, if it has others, in the robot's order.
    angles
        Unit of the columns of a table that do not name theirs: ``"rad"`` (default) or ``"deg"``.
    joint_topic
        Default: ``/joint_states``, or the only one of the type.
    command_topic
        Of type JointState (its velocities) or std_msgs/Float64MultiArray, each held until the next; 0 before the first.
    targets
        Columns of commanded positions of a table: their names in the robot's order, or what they begin with, as
        ``"target_"``, before joint names or numbers.
    missing
        What to do with samples of a table that lack a position: ``"interpolate"`` joins them linearly, ``"skip"``
        leaves them out. Commands that are missing are held.

    Raises
    ------
    ShapeError
        If ``joints`` does not fit the robot, or an option does not apply to this kind of log.
    FileFormatError
        If the file is missing or malformed, a joint is missing, a number is not finite, or time does not increase;
        the message begins with the file and its line or topic.
    ValueRangeError
        If numbers without a unit must be degrees.
    MissingExtraError
        If rosbags is needed and not installed.

    Examples
    --------
    >>> import tempfile, pathlib, dqcontrol as dqc
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "log.csv"
    >>> _ = file.write_text("time; q1 [deg]; q2 [deg]\n100.0; 0; 90\n100.1; 1; 90\n")
    >>> arm = dqc.SerialArm.from_dh([0, 0], [0, 0], [1, 1], [0, 0])
    >>> read_joint_log(file, arm).q.round(3).tolist()
    [[0.0, 1.571], [0.017, 1.571]]
    """
    path, names = Path(path), names_in_log(robot, joints)
    if (dataset := episode_of(path)) is not None:
        number = only_episode(path, *dataset)
        refuse_topics(path, "dataset", joint_topic=joint_topic, command_topic=command_topic)
        if targets is not None:
            raise ShapeError(
                f"targets: {path} is a dataset, whose commanded positions are its action; leave it out"
            )
        return _with_remarks(_read_episode(path, dataset[0], number, robot, names, angles), robot, names)
    if path.is_dir() and not (path / "metadata.yaml").exists() and (path / "record.mcap").is_file():
        path = path / "record.mcap"
    if not is_recording(path):
        refuse_topics(path, "table", joint_topic=joint_topic, command_topic=command_topic)
        table = read_joint_table(path, robot, names, angles=angles, targets=targets, missing=missing)
        return _with_remarks(JointLog(path, **table._asdict()), robot, names)
    if targets is not None:
        raise ShapeError(
            f"targets or reference_joints: {path} is a recording and has no columns; name the topic that holds the "
            "commanded positions (--target-topic or --reference-topic)"
        )
    if angles is not None:
        raise ShapeError(f"angles: {path} is a recording, and its messages are in rad; leave it out")
    if joint_topic is None and command_topic is None and is_own(path):
        return _read_record(path, names, robot)
    stamps, q = read_joint_states(path, names, joint_topic)
    command = held(*read_commands(path, names, command_topic), stamps) if command_topic is not None else None
    time = (stamps - stamps[0]) / 1e9
    return _with_remarks(JointLog(path, time, q, command, int(stamps[0])), robot, names)


def _with_remarks(log: JointLog, robot: Robot, names: Sequence[str]) -> JointLog:
    """Return a log with a line for each thing that is unusual in it."""
    found = *_gaps(log.time), *_outliers(log.time, log.q, robot, names), *_beyond(log.q, robot, names)
    return replace(log, notes=(*log.notes, *found))


def _read_episode(
    path: Path, data: Dataset, number: int, robot: Robot, names: Sequence[str], angles: Angles | None
) -> JointLog:
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
        command = values[ACTION][:, rows]
        if kind == "pos":
            command, target = None, command * _scales(robot, [action.units[i] for i in rows], angles)
    if COMMAND in data.features:
        rows = _rows(path, COMMAND, data.features[COMMAND], robot.input_names, "vel")
        command = values[COMMAND][:, rows]
    return JointLog(path, time, q, command, target=target, notes=tuple(notes))


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


def refuse_topics(path: Path, what: str, **topics: str | None) -> None:
    """Raise if a topic is named of what has none."""
    for field, topic in topics.items():
        if topic is not None:
            raise ShapeError(f"{field}: {path} is a {what} and has no topics, got '{topic}'")


def arm_of(robot: str | Path | Robot, why_not: str, *links: str | None) -> SerialArm:
    """Return an arm on a fixed base, by its name or file with the ends of its chain, or say why a robot is none."""
    arm = robot if isinstance(robot, Robot) else load_robot(robot, *links)
    if not isinstance(arm, SerialArm):
        raise ValueRangeError(f"robot: {arm.name} {why_not}")
    return arm


def names_in_log(robot: Robot, joints: Sequence[str] | None) -> tuple[str, ...]:
    """Return what a robot's joints are called in a log: as ``joints`` says, or as the robot does.

    Raises
    ------
    ShapeError
        If ``joints`` does not fit the robot.
    """
    names = tuple(robot.joint_names if joints is None else joints)
    if len(names) != robot.configuration_size or len(set(names)) != len(names):
        raise ShapeError(
            f"joints: {robot.name} has {robot.configuration_size} joints; "
            f"expected as many different names, got {', '.join(names) or 'none'}"
        )
    return names


def is_own(path: Path) -> bool:
    """Whether a file is a recording of ours."""
    try:
        return path.suffix.lower() == ".mcap" and bool(load_metadata(path))
    except FileFormatError:
        return False


def _read_record(path: Path, names: tuple[str, ...], robot: Robot) -> JointLog:
    record = load_record(path)
    if record.joint_names not in (names, tuple(robot.joint_names)):
        raise FileFormatError(
            f"{path}: holds the joints {', '.join(record.joint_names)}; expected {', '.join(names)}"
        )
    for k in np.flatnonzero(~np.isfinite(record.q).all(axis=1))[:1]:
        raise FileFormatError(
            f"{path}: /joint_states: must be finite, got {record.q[k]} at {record.time[k]:g} s"
        )
    stamp = round((record.time[0] - min(0.0, record.time[0])) * 1e9)
    read = [record.readings[name].values for name in WRENCH_READINGS if name in record.readings]
    wrench = np.hstack(read) if len(read) == len(WRENCH_READINGS) else None
    time = record.time - record.time[0]
    return JointLog(path, time, record.q, record.command, stamp, record, wrench=wrench)
