"""Joint positions over time in a text file, as `read_joint_log` describes it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

import msgspec
import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ValueRangeError, suggest
from dqcontrol.files.input_file import open_regular
from dqcontrol.files.text_file import as_number, read_text

Angles = Literal["rad", "deg"]

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
_LENGTH = {"m": 1.0, "mm": 1e-3}
_DELIMITERS = ",;\t"
_BLOCK = 1 << 22  # bytes of lines that are read at a time
_MANY_TURNS = 4 * math.pi  # rad; no joint turns so far, so such numbers without a unit are degrees


def read_joint_table(
    path: Path, joint_names: Sequence[str], joint_types: Sequence[str], angles: Angles | None
) -> tuple[Array, Array, Array | None]:
    """Return time (N,), s after the first sample, positions (N, n) and, if there are any, commands (N, n).

    For the columns, see `read_joint_log`.

    Raises
    ------
    FileFormatError
        If the file is missing or malformed; the message begins with the file and the line.
    ValueRangeError
        If angles without a unit must be degrees.
    """
    found = _plain(path, joint_names, joint_types, angles)
    if found is None:
        header, *rows = _rows(path, read_text(path).splitlines())
        columns = _chosen(path, header, joint_names, joint_types, angles)
        if not rows:
            raise FileFormatError(f"{path}: has no samples below the column names")
        for number, cells in rows:
            if len(cells) != len(columns.names):
                raise FileFormatError(
                    f"{path}:{number}: expected {len(columns.names)} values, got {len(cells)}"
                )
        found = columns, _numbers(path, rows, columns.names, columns.places), _times(path, rows, columns)
    columns, values, time = found
    n, scales, joints = len(joint_names), columns.scales, columns.places[1:]
    table = values[:, 1:] * scales[1:]
    unsaid = [k for k in range(n) if joint_types[k] == "revolute" and not columns.units[joints[k]]]
    most = np.abs(table[:, unsaid]).max(initial=0.0)
    if angles is None and most > _MANY_TURNS:
        raise ValueRangeError(
            f"{path}: angles up to {most:.4g} rad look like degrees; say which (--angles deg or --angles rad), "
            f"or name the unit behind the column, as q1 [deg]"
        )
    return time, table[:, :n], table[:, n:] if len(joints) > n else None


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a table without their units; raises as `read_joint_table`."""
    with _opened(path) as stream:
        return [_name_and_unit(cell)[0] for cell in next(_rows(path, _text_lines(path, stream)))[1]]


class _Columns(NamedTuple):
    """Names and units of all columns; places of time, joints and perhaps commands, and what scales them."""

    names: Sequence[str]
    units: Sequence[str]
    places: list[int]
    scales: list[float]


def _chosen(
    path: Path,
    header: tuple[int, list[str]],
    joint_names: Sequence[str],
    joint_types: Sequence[str],
    angles: Angles | None,
) -> _Columns:
    """Return which columns are read."""
    where = f"{path}:{header[0]}"
    names, units = zip(*(_name_and_unit(cell) for cell in header[1]), strict=True)
    joints = _find(where, "joints", names, joint_names, "q")
    inputs = _find_commands(where, names, joint_names)
    places = [_find(where, "column", names, ["time"], "")[0], *joints, *inputs]
    scales = [_scale(f"{where}: time", units[places[0]], _TIME, "s")]
    for chosen, per in ((joints, ""), (inputs, "/s")):
        for kind, i in zip(joint_types if chosen else (), chosen, strict=True):
            table, default = (_ANGLE, angles or "rad") if kind == "revolute" else (_LENGTH, "m")
            allowed = {unit + per: scale for unit, scale in table.items()}
            scales.append(_scale(f"{where}: {names[i]}", units[i], allowed, default + per))
    return _Columns(names, units, places, scales)


def _opened(path: Path) -> BinaryIO:
    try:
        return open_regular(path)
    except OSError:
        read_text(path)  # says what is wrong, and which file may be meant
        raise


def _text_lines(path: Path, stream: BinaryIO) -> Iterator[str]:
    for line in iter(lambda: stream.readline(_BLOCK), b""):
        try:
            yield line.decode("utf-8-sig").rstrip("\r\n")
        except UnicodeDecodeError:
            raise FileFormatError(f"{path}: not a text file (UTF-8)") from None


def _plain(
    path: Path, joint_names: Sequence[str], joint_types: Sequence[str], angles: Angles | None
) -> tuple[_Columns, Array, Array] | None:
    """Return columns, their numbers and the time, a block of lines at a time; None if not all lines are plain numbers.

    msgspec reads numbers as JSON, 30 times as fast as cell by cell.
    """
    values, stamps = [], []
    with _opened(path) as stream:
        header, columns = None, None
        for block in iter(lambda: stream.readlines(_BLOCK), []):
            if header is None:
                if any(b"\0" in line for line in block):
                    return None
                lines = iter(block)
                try:
                    header = next(_rows(path, (line.decode("utf-8-sig").rstrip("\r\n") for line in lines)))
                except (StopIteration, UnicodeDecodeError, FileFormatError):
                    return None
                columns = _chosen(path, header, joint_names, joint_types, angles)
                block = list(lines)  # what is behind the header
            assert columns
            part = _plain_block(b"".join(block), columns)
            if part is None:
                return None
            values.append(part[0])
            stamps += part[1]
    if columns is None or not stamps:
        return None
    begin = stamps[0]
    time = np.array([float(stamp - begin) for stamp in stamps]) * columns.scales[0]
    return (columns, np.concatenate(values), time) if (np.diff(time) > 0).all() else None


def _plain_block(text: bytes, columns: _Columns) -> tuple[Array, list[Decimal]] | None:
    """Return the chosen columns of some lines and their stamps with all digits, or None."""
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines:
        return np.zeros((0, len(columns.places))), []
    delimiter = max((each.encode() for each in _DELIMITERS), key=lines[0].count)
    try:
        content = b"[[" + b"],[".join(lines).replace(delimiter, b",").replace(b"nan", b"null") + b"]]"
        table = np.array(msgspec.json.decode(content, type=list[list[float | None]]), dtype=np.float64)
        place = columns.places[0]
        stamps = [Decimal(line.split(delimiter, place + 1)[place].strip().decode()) for line in lines]
    except (ValueError, msgspec.DecodeError, InvalidOperation):
        return None
    if table.shape[1:] != (len(columns.names),) or not np.isfinite(table[:, columns.places]).all():
        return None
    return table[:, columns.places], stamps


def _rows(path: Path, lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the column names, then the rows of a table, each with the number of its line."""
    header, delimiter = None, None
    for number, line in enumerate(lines, start=1):
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
            yield number, cells
        elif not line.lstrip().startswith("#") or "time" in [_name_and_unit(cell)[0] for cell in cells]:
            header = number, cells
            yield header
    if header is None:
        raise FileFormatError(f"{path}: is empty; expected a line of column names: time, q1, q2, …")


def _name_and_unit(cell: str) -> tuple[str, str]:
    """Split what stands behind a name in brackets off it; a number there, as in ``q[0]``, is part of the name."""
    match = re.fullmatch(r"(.+?)\s*(?:\[\s*([^\]\d]*)\]|\(\s*([^)\d]*)\))", cell)
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


def _times(path: Path, rows: list[tuple[int, list[str]]], columns: _Columns) -> Array:
    """Return s after the first sample, with all digits of long stamps: those of Unix time do not fit a float."""
    column, scale = columns.places[0], columns.scales[0]
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
