"""Joint positions over time in a text file, as `read_joint_log` describes it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import msgspec
import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, suggest, unreadable
from dqcontrol.files.input_file import as_number, open_regular, read_text
from dqcontrol.logs import text_table
from dqcontrol.robots import Robot

Angles = Literal["rad", "deg"]

DEGREES_NOTE = "angles without a unit are taken for degrees: as radians they leave the joints' limits"
_WRENCH = ("fx", "fy", "fz", "tx", "ty", "tz")
_BLOCK = 1 << 22  # bytes of lines that are read at a time
_MANY_TURNS = 4 * math.pi  # rad; no joint turns so far, so such numbers without a unit are degrees


class JointTable(NamedTuple):
    """What a table holds: time (N,) s after the first sample; positions, commands, commanded positions (N, n).

    And the wrench of a force sensor (N, 6), N and N·m.
    """

    time: Array
    q: Array
    command: Array | None
    target: Array | None
    wrench: Array | None
    notes: tuple[str, ...]


class _Columns(NamedTuple):
    """Names and units of all columns, and the places of those that are read."""

    where: str
    names: list[str]
    units: list[str]
    time: int
    joints: list[int]
    commands: list[int]
    targets: list[int]
    wrench: list[int]

    @property
    def numbers(self) -> list[int]:
        """Places of all but the time."""
        return [*self.joints, *self.commands, *self.targets, *self.wrench]


def read_joint_table(
    path: Path,
    robot: Robot,
    joint_names: Sequence[str],
    *,
    angles: Angles | None = None,
    targets: str | Sequence[str] | None = None,
    missing: text_table.Missing = "interpolate",
) -> JointTable:
    """Return what a table holds of a robot's joints.

    For the columns, see `read_joint_log`.

    Raises
    ------
    FileFormatError
        If the file is missing or malformed; the message begins with the file and the line.
    ValueRangeError
        If angles without a unit must be degrees, and it cannot be told which.
    ShapeError
        If ``targets`` does not fit the robot.
    """
    columns, stamps, values, notes = _read(path, joint_names, targets)
    unit = columns.units[columns.time]
    if not unit:
        unit, said = text_table.time_unit(stamps)
        notes += said
    time = text_table.seconds_from(stamps, text_table.TIME_UNITS[unit])
    if angles is None and must_be_degrees(path, robot, [columns.units[i] for i in columns.joints], values):
        angles = "deg"
        notes.append(DEGREES_NOTE)
    values *= _scales(columns, robot.joint_types, angles)
    n = len(joint_names)
    names = [columns.names[i] for i in columns.numbers]
    time, values = text_table.fill_missing(path, time, values, names, n, missing, notes)
    ends = np.cumsum([n, len(columns.commands), len(columns.targets)])
    parts = np.split(values, ends, axis=1)
    command, target, wrench = (part if part.shape[1] else None for part in parts[1:])
    return JointTable(time, parts[0], command, target, wrench, tuple(notes))


def column_names(path: Path, known: Sequence[str]) -> list[str]:
    """Return the names of the columns of a table without their units; raises as `read_joint_table`."""
    with _opened(path) as stream:
        _, cells = next(text_table.table_rows(path, _text_lines(path, stream)))
    return [text_table.name_and_unit(cell, known)[0] for cell in cells]


def _read(
    path: Path, joint_names: Sequence[str], targets: str | Sequence[str] | None
) -> tuple[_Columns, list[Decimal], Array, list[str]]:
    """Return the columns, the stamps with all digits, the numbers of the other columns, NaN where a cell is empty."""
    found = _plain(path, joint_names, targets)
    if found is not None:
        return found[0], found[1], found[2], []
    text, notes = read_text(path), list[str]()
    header, *rows = text_table.table_rows(path, text.splitlines())
    columns = _chosen(path, header, joint_names, targets)
    width = len(columns.names)
    if rows and len(rows[-1][1]) < width and not text.endswith("\n"):
        notes.append(f"line {rows.pop()[0]}, the last one, is cut off and left out")
    for number, cells in rows:
        if len(cells) != width:
            raise FileFormatError(f"{path}:{number}: expected {width} values, got {len(cells)}")
    stamped = [row for row in rows if row[1][columns.time].lower() not in text_table.EMPTY]
    if len(stamped) < len(rows):
        notes.append(f"{len(rows) - len(stamped)} of {len(rows)} lines have no time and are left out")
    if not stamped:
        raise FileFormatError(f"{path}: has no samples below the column names")
    return columns, _stamps(path, stamped, columns), _numbers(path, stamped, columns), notes


def _chosen(
    path: Path,
    header: tuple[int, list[str]],
    joint_names: Sequence[str],
    targets: str | Sequence[str] | None,
) -> _Columns:
    """Return which columns are read."""
    where, n = f"{path}:{header[0]}", len(joint_names)
    commanded = [f"command.{name}" for name in joint_names], [f"u{i + 1}" for i in range(n)]
    wanted = _target_names(joint_names, targets)
    numbered = [f"q{i + 1}" for i in range(n)]
    known = {*joint_names, *numbered, *text_table.TIME_NAMES, *_WRENCH}.union(*commanded, *wanted)
    cells = [text_table.name_and_unit(cell, known) for cell in header[1]]
    names, units = [cell[0] for cell in cells], [cell[1] for cell in cells]
    joints = text_table.find_columns(where, "joints", names, _measured_names(names, joint_names), "q")
    is_commanded = not set(names).isdisjoint({*commanded[0], *commanded[1]})
    commands = text_table.find_columns(where, "commands", names, commanded[0], "u") if is_commanded else []
    lowered = [name.lower() for name in names]
    time = next((name for name in text_table.TIME_NAMES if name in lowered), "time")
    place = text_table.find_columns(where, "column", lowered, [time], "")[0]
    if units[place] and units[place] not in text_table.TIME_UNITS:
        raise FileFormatError(
            f"{where}: {names[place]}: unknown unit '{units[place]}' (allowed: {', '.join(text_table.TIME_UNITS)})"
        )
    found = next((each for each in wanted if set(each) <= set(names)), None)
    if found is None and targets is not None:
        raise ShapeError(
            f"targets or reference_joints: {where}: columns missing: {', '.join(wanted[0])}"
            f"{suggest(wanted[0][0], names)} (columns: {', '.join(names)})"
        )
    held = text_table.find_columns(where, "commanded positions", names, found, "") if found else []
    wrench = [lowered.index(name) for name in _WRENCH] if set(_WRENCH) <= set(lowered) else []
    return _Columns(where, names, units, place, joints, commands, held, wrench)


def _measured_names(names: Sequence[str], joint_names: Sequence[str]) -> Sequence[str]:
    """Return the names of the joints' columns: the robot's, or those of the interface of Universal Robots."""
    theirs = [f"actual_q_{i}" for i in range(len(joint_names))]
    ours = {*joint_names, "q1"}
    return theirs if theirs[0] in names and ours.isdisjoint(names) else joint_names


def _target_names(joint_names: Sequence[str], targets: str | Sequence[str] | None) -> list[list[str]]:
    """Return which names commanded positions may have, in the order in which they are looked for."""
    count = range(1, len(joint_names) + 1)
    if targets is None:
        usual = [[f"target{dot}{name}" for name in joint_names] for dot in "._"]
        return [*usual, [f"r{i}" for i in count], [f"target_q_{i - 1}" for i in count]]
    listed = targets.split(",") if isinstance(targets, str) else list(targets)
    listed = [name.strip() for name in listed]
    if len(listed) == 1:
        stem = listed[0].rstrip("*…")
        numbered = [[f"{stem}{letter}{i}" for i in count] for letter in ("", "q")]
        numbered.append([f"{stem}{i - 1}" for i in count])
        return [[f"{stem}{name}" for name in joint_names], *numbered, *([listed] if len(count) == 1 else [])]
    if len(listed) != len(joint_names) or len(set(listed)) != len(listed):
        raise ShapeError(
            f"targets or reference_joints: expected {len(joint_names)} different names, or what they begin with, "
            f"as target_, got {', '.join(listed)}"
        )
    return [listed]


def _scales(columns: _Columns, joint_types: Sequence[str], angles: Angles | None) -> list[float]:
    """Return what turns the numbers of each column into rad, m, rad/s and m/s."""

    def scale(i: int, allowed: dict[str, float], default: str) -> float:
        where = f"{columns.where}: {columns.names[i]}"
        return text_table.unit_scale(where, columns.units[i], allowed, default)

    scales, usual = [], {"revolute": (text_table.ANGLES, angles or "rad")}
    for chosen, per in ((columns.joints, ""), (columns.commands, "/s"), (columns.targets, "")):
        for kind, i in zip(joint_types if chosen else (), chosen, strict=True):
            table, default = usual.get(kind, (text_table.LENGTHS, "m"))
            scales.append(scale(i, {unit + per: factor for unit, factor in table.items()}, default + per))
    for k, i in enumerate(columns.wrench):
        unit = "N" if k < 3 else "N·m"
        scales.append(scale(i, {unit: 1.0}, unit))
    return scales


def must_be_degrees(path: Path, robot: Robot, units: Sequence[str], values: Array) -> bool:
    """Whether angles without a unit are degrees: no joint turns so far, and as degrees they respect the limits.

    Parameters
    ----------
    path
        The file, for errors.
    robot
        For its limits.
    units
        Of the columns of the joints, in the robot's order; empty where none is named.
    values
        Whose first columns are those, NaN where a cell is empty.

    Raises
    ------
    ValueRangeError
        If the robot has no limits that would tell.
    """
    types, limits = robot.joint_types, robot.limits
    unsaid = [k for k, unit in enumerate(units) if types[k] == "revolute" and not unit]
    angles = values[:, unsaid]
    least, most = (find(angles, axis=0, initial=0.0, where=~np.isnan(angles)) for find in (np.min, np.max))
    largest = max(float(-least.min(initial=0.0)), float(most.max(initial=0.0)))
    if largest <= _MANY_TURNS:
        return False
    lower, upper = limits.lower[unsaid], limits.upper[unsaid]
    crossed = ((least < lower) | (most > upper)).any()
    inside = ((np.radians(least) >= lower - 0.1) & (np.radians(most) <= upper + 0.1)).all()
    if crossed and inside:
        return True
    raise ValueRangeError(
        f"{path}: angles up to {largest:.4g} rad look like degrees; say which (--angles deg or --angles rad), "
        f"or name the unit behind the column, as q1 [deg]"
    )


def _opened(path: Path) -> BinaryIO:
    try:
        return open_regular(path)
    except OSError as error:
        raise unreadable(path, error) from None


def _text_lines(path: Path, stream: BinaryIO) -> Iterator[str]:
    for line in iter(lambda: stream.readline(_BLOCK), b""):
        if b"\0" in line:
            raise FileFormatError(f"{path}: not a text file")
        try:
            yield line.decode("utf-8-sig").rstrip("\r\n")
        except UnicodeDecodeError:
            raise FileFormatError(f"{path}: not a text file (UTF-8)") from None


def _plain(
    path: Path, joint_names: Sequence[str], targets: str | Sequence[str] | None
) -> tuple[_Columns, list[Decimal], Array] | None:
    """Return columns, stamps and numbers, a block of lines at a time; None if not all lines are plain numbers.

    msgspec reads numbers as JSON, 30 times as fast as cell by cell.
    """
    values, stamps = [], list[Decimal]()
    with _opened(path) as stream:
        try:
            header = next(text_table.table_rows(path, _text_lines(path, stream)))
        except FileFormatError:
            return None
        columns = _chosen(path, header, joint_names, targets)
        for block in iter(lambda: stream.readlines(_BLOCK), []):
            part = _plain_block(b"".join(block), columns)
            if part is None:
                return None
            values.append(part[0])
            stamps += part[1]
    increasing = all(after > before for before, after in pairwise(stamps))
    return (columns, stamps, np.concatenate(values)) if stamps and increasing else None


def _plain_block(text: bytes, columns: _Columns) -> tuple[Array, list[Decimal]] | None:
    """Return the chosen columns of some lines and their stamps with all digits, or None."""
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        return np.zeros((0, len(columns.numbers))), []
    delimiter = max((each.encode() for each in text_table.DELIMITERS), key=lines[0].count)
    try:
        content = b"[[" + b"],[".join(lines).replace(delimiter, b",").replace(b"nan", b"null") + b"]]"
        table = np.array(msgspec.json.decode(content, type=list[list[float | None]]), dtype=np.float64)
        place = columns.time
        stamps = [Decimal(line.split(delimiter, place + 1)[place].strip().decode()) for line in lines]
    except (ValueError, msgspec.DecodeError, InvalidOperation):
        return None
    if table.shape[1:] != (len(columns.names),) or not np.isfinite(table[:, place]).all():
        return None
    values = table[:, columns.numbers]
    return None if np.isinf(values).any() else (values, stamps)


def _numbers(path: Path, rows: list[tuple[int, list[str]]], columns: _Columns) -> Array:
    """Return the chosen columns, NaN for empty cells, or name the first cell that is no finite number."""
    places = columns.numbers
    try:
        table = np.array(
            [
                [cells[i] if cells[i].lower() not in text_table.EMPTY else "nan" for i in places]
                for _, cells in rows
            ],
            dtype=np.float64,
        )
    except ValueError:
        table = np.array([np.inf])
    if np.isinf(table).any():
        for number, cells in rows:
            for i in places:
                if cells[i].lower() not in text_table.EMPTY:
                    as_number(f"{path}:{number}: {columns.names[i]}", cells[i])
    return table


def _stamps(path: Path, rows: list[tuple[int, list[str]]], columns: _Columns) -> list[Decimal]:
    """Return the stamps with all digits: those of Unix time do not fit a float."""
    name = columns.names[columns.time]
    places = [(f"{path}:{number}: {name}", cells[columns.time]) for number, cells in rows]
    stamps = [text_table.written_stamp(*place) for place in places]
    for k in range(1, len(stamps)):
        if stamps[k] <= stamps[k - 1]:
            now, before = (rows[i][1][columns.time] for i in (k, k - 1))
            raise FileFormatError(f"{path}:{rows[k][0]}: {name}: must increase, got {now} after {before}")
    return stamps
