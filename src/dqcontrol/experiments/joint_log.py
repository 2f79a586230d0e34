"""Joint positions over time as the user's own programs and robots have logged them."""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, suggest
from dqcontrol.experiments.joint_messages import held, is_recording, read_commands, read_joint_states
from dqcontrol.loop import Record, load_metadata, load_record
from dqcontrol.references.text_file import as_number, read_text
from dqcontrol.robots import SerialArm

Array = NDArray[np.float64]
Angles = Literal["rad", "deg"]

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
_LENGTH = {"m": 1.0, "mm": 1e-3}
_DELIMITERS = ",;\t"
_MANY_TURNS = 4 * math.pi  # rad; no joint turns so far, so such numbers without a unit are degrees


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
    """

    path: Path
    time: Array
    q: Array
    command: Array | None
    origin: int = 0
    record: Record | None = None


def read_joint_log(
    path: str | os.PathLike[str],
    robot: SerialArm,
    *,
    angles: Angles | None = None,
    joint_topic: str | None = None,
    command_topic: str | None = None,
) -> JointLog:
    r"""Read a joint log: a table, an MCAP file, a ROS 1 or ROS 2 bag.

    A table is a text file with a line of column names, separated by commas, semicolons, tabs or blanks, and one
    line a sample. Its columns, in any order: ``time`` (s), one for each joint, by the robot's joint names or
    ``q1`` … ``qn``, and, if commands were logged, ``command.JOINT`` for each or ``u1`` … ``um``. A unit may stand
    behind a name, as ``time [ms]`` (s, ms, us, ns), ``q1 [deg]`` (rad, deg; m, mm for sliding joints) or
    ``u1 [deg/s]``. Other columns, empty lines and lines that begin with ``#`` are left out; a ``#`` before the
    names themselves is allowed.

    In recordings, positions come from a topic of type sensor_msgs/JointState at the times in the headers (at the
    times of recording, where the headers have none); messages that name no joint of the robot are left out.

    Parameters
    ----------
    path
        ``.mcap``; ``.bag`` or the folder of a ROS 2 bag (both need rosbags); the folder of a run; else a table.
    robot
        Whose joints to look for.
    angles
        Unit of the columns of a table that do not name theirs: ``"rad"`` (default) or ``"deg"``.
    joint_topic
        Default: ``/joint_states``, or the only one of the type.
    command_topic
        Of type JointState (its velocities) or std_msgs/Float64MultiArray, each held until the next; 0 before the first.

    Raises
    ------
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
    path = Path(path)
    if path.is_dir() and not (path / "metadata.yaml").exists() and (path / "record.mcap").is_file():
        path = path / "record.mcap"
    if not is_recording(path):
        for field, topic in (("joint_topic", joint_topic), ("command_topic", command_topic)):
            if topic is not None:
                raise ShapeError(f"{field}: {path} is a table and has no topics, got '{topic}'")
        return _read_table(path, robot, angles)
    if angles is not None:
        raise ShapeError(f"angles: {path} is a recording, and its messages are in rad; leave it out")
    if joint_topic is None and command_topic is None and is_own(path):
        return _read_record(path, robot)
    stamps, q = read_joint_states(path, robot.joint_names, joint_topic)
    command = None
    if command_topic is not None:
        command = held(*read_commands(path, robot.joint_names, command_topic), stamps)
    return JointLog(path, (stamps - stamps[0]) / 1e9, q, command, int(stamps[0]))


def is_own(path: Path) -> bool:
    """Whether a file is a recording of ours."""
    try:
        return path.suffix.lower() == ".mcap" and bool(load_metadata(path))
    except FileFormatError:
        return False


def _read_record(path: Path, robot: SerialArm) -> JointLog:
    record = load_record(path)
    if record.joint_names != tuple(robot.joint_names):
        raise FileFormatError(
            f"{path}: holds the joints {', '.join(record.joint_names)}; {robot.name} has {', '.join(robot.joint_names)}"
        )
    for k in np.flatnonzero(~np.isfinite(record.q).all(axis=1))[:1]:
        raise FileFormatError(
            f"{path}: /joint_states: must be finite, got {record.q[k]} at {record.time[k]:g} s"
        )
    stamp = round((record.time[0] - min(0.0, record.time[0])) * 1e9)
    return JointLog(path, record.time - record.time[0], record.q, record.command, stamp, record)


def _read_table(path: Path, robot: SerialArm, angles: Angles | None) -> JointLog:
    header, rows = _lines(path)
    where = f"{path}:{header[0]}"
    names, units = zip(*(_name_and_unit(cell) for cell in header[1]), strict=True)
    joints = _find(where, "joints", names, robot.joint_names, "q")
    inputs = _find_commands(where, names, robot.joint_names)
    columns = [_find(where, "column", names, ["time"], "")[0], *joints, *inputs]
    n = len(joints)
    scales = [_scale(f"{where}: time", units[columns[0]], _TIME, "s")]
    for chosen, per in ((joints, ""), (inputs, "/s")):
        for kind, i in zip(robot.joint_types if chosen else (), chosen, strict=True):
            table, default = (_ANGLE, angles or "rad") if kind == "revolute" else (_LENGTH, "m")
            allowed = {unit + per: scale for unit, scale in table.items()}
            scales.append(_scale(f"{where}: {names[i]}", units[i], allowed, default + per))
    if not rows:
        raise FileFormatError(f"{path}: has no samples below the column names")
    for number, cells in rows:
        if len(cells) != len(names):
            raise FileFormatError(f"{path}:{number}: expected {len(names)} values, got {len(cells)}")
    values = _numbers(path, rows, names, columns)
    time = _times(path, rows, columns[0], scales[0])
    table = values[:, 1:] * scales[1:]
    unsaid = [k for k in range(n) if robot.joint_types[k] == "revolute" and not units[joints[k]]]
    most = np.abs(table[:, unsaid]).max(initial=0.0)
    if angles is None and most > _MANY_TURNS:
        raise ValueRangeError(
            f"{path}: angles up to {most:.4g} rad look like degrees; say which (--angles deg or --angles rad), "
            f"or name the unit behind the column, as q1 [deg]"
        )
    return JointLog(path, time, table[:, :n], table[:, n:] if inputs else None)


def _lines(path: Path) -> tuple[tuple[int, list[str]], list[tuple[int, list[str]]]]:
    """Return the column names and the rows of a table, each with the number of its line."""
    header, delimiter, rows = None, None, []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        text = line.strip(" ")
        if header is None:
            text = text.lstrip("# ")
            delimiter = max(_DELIMITERS, key=text.count)
            delimiter = delimiter if delimiter in text else None
        if not text.strip() or text.startswith("#"):
            continue
        try:
            cells = (
                [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
                if delimiter
                else text.split()
            )
        except csv.Error as error:
            raise FileFormatError(f"{path}:{number}: {error}") from None
        if header is not None:
            rows.append((number, cells))
        elif not line.lstrip().startswith("#") or "time" in [_name_and_unit(cell)[0] for cell in cells]:
            header = number, cells
    if header is None:
        raise FileFormatError(f"{path}: is empty; expected a line of column names: time, q1, q2, …")
    return header, rows


def _name_and_unit(cell: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.*?)\s*(?:\[(.*)\]|\((.*)\))?", cell)
    return (match[1], (match[2] or match[3] or "").strip()) if match else (cell, "")


def _find(where: str, what: str, names: Sequence[str], wanted: Sequence[str], letter: str) -> list[int]:
    """Return the columns of these names, or else of the letter with the numbers from 1."""
    numbered = [f"{letter}{i + 1}" for i in range(len(wanted))] if letter else list(wanted)
    by_name = [name for name in wanted if name in names]
    chosen = numbered if not by_name and any(name in names for name in numbered) else list(wanted)
    missing = [name for name in chosen if name not in names]
    if missing:
        other = f" (or {numbered[0]} … {numbered[-1]})" if letter and chosen != numbered else ""
        raise FileFormatError(
            f"{where}: {what} missing: {', '.join(missing)}{other}{suggest(missing[0], names)} "
            f"(columns: {', '.join(names)})"
        )
    for name in chosen:
        if names.count(name) > 1:
            raise FileFormatError(f"{where}: column '{name}' is there {names.count(name)} times")
    return [names.index(name) for name in chosen]


def _find_commands(where: str, names: Sequence[str], inputs: Sequence[str]) -> list[int]:
    """Return the columns of the commands, if there are any."""
    named = [f"command.{name}" for name in inputs]
    if not any(name in names for name in (*named, *(f"u{i + 1}" for i in range(len(inputs))))):
        return []
    return _find(where, "commands", names, named, "u")


def _scale(where: str, unit: str, allowed: dict[str, float], default: str) -> float:
    if unit and unit not in allowed:
        raise FileFormatError(f"{where}: unknown unit '{unit}' (allowed: {', '.join(allowed)})")
    return allowed[unit or default]


def _numbers(
    path: Path, rows: list[tuple[int, list[str]]], names: Sequence[str], columns: list[int]
) -> Array:
    """Return the chosen columns, or name the first cell that is no finite number."""
    try:
        table = np.array([[cells[i] for i in columns] for _, cells in rows], dtype=np.float64)
    except ValueError:
        table = np.array([np.nan])
    if not np.isfinite(table).all():
        for number, cells in rows:
            for i in columns:
                as_number(f"{path}:{number}: {names[i]}", cells[i])
    return table


def _times(path: Path, rows: list[tuple[int, list[str]]], column: int, scale: float) -> Array:
    """Return s after the first sample, with all digits of long stamps: those of Unix time do not fit a float."""
    try:
        stamps = [Decimal(cells[column]) for _, cells in rows]
    except InvalidOperation:  # a way to write numbers that only Python's floats know
        stamps = [Decimal(float(cells[column])) for _, cells in rows]
    time = np.array([float(stamp - stamps[0]) for stamp in stamps]) * scale
    for k in np.flatnonzero(np.diff(time) <= 0)[:1]:
        raise FileFormatError(
            f"{path}:{rows[k + 1][0]}: time: must increase, got {rows[k + 1][1][column]} after {rows[k][1][column]}"
        )
    return time
