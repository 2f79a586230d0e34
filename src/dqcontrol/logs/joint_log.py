"""Joint positions over time as the user's own programs and robots have logged them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError
from dqcontrol.logs.joint_messages import held, is_recording, read_commands, read_joint_states
from dqcontrol.logs.joint_table import Angles, read_joint_table
from dqcontrol.logs.log_quality import remarks
from dqcontrol.logs.missing_cells import Missing
from dqcontrol.loop import Record
from dqcontrol.plants.channels import WRENCH_READINGS
from dqcontrol.recording import load_metadata, load_record
from dqcontrol.robots import Robot


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
    r"""Read a joint log: a table, an MCAP file, a ROS 1 or ROS 2 bag.

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

    Parameters
    ----------
    path
        ``.mcap``; ``.bag`` or the folder of a ROS 2 bag (both need rosbags); the folder of a run; else a table.
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
    path, names = Path(path), tuple(joints if joints is not None else robot.joint_names)
    if len(names) != robot.configuration_size or len(set(names)) != len(names):
        raise ShapeError(
            f"joints: {robot.name} has {robot.configuration_size} joints; "
            f"expected as many different names, got {', '.join(names) or 'none'}"
        )
    if path.is_dir() and not (path / "metadata.yaml").exists() and (path / "record.mcap").is_file():
        path = path / "record.mcap"
    if not is_recording(path):
        for field, topic in (("joint_topic", joint_topic), ("command_topic", command_topic)):
            if topic is not None:
                raise ShapeError(f"{field}: {path} is a table and has no topics, got '{topic}'")
        table = read_joint_table(path, robot, names, angles=angles, targets=targets, missing=missing)
        notes = (*table.notes, *remarks(table.time, table.q, robot, names))
        return JointLog(
            path, table.time, table.q, table.command, target=table.target, notes=notes, wrench=table.wrench
        )
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
    command = None
    if command_topic is not None:
        command = held(*read_commands(path, names, command_topic), stamps)
    time = (stamps - stamps[0]) / 1e9
    return JointLog(path, time, q, command, int(stamps[0]), notes=remarks(time, q, robot, names))


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
    return JointLog(
        path, record.time - record.time[0], record.q, record.command, stamp, record, wrench=wrench
    )
