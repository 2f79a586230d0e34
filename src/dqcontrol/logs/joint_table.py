"""Joint positions over time in a text file, as `read_joint_log` describes it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import FileFormatError, ValueRangeError, suggest
from dqcontrol.files.text_file import as_number, read_text

Array = NDArray[np.float64]
Angles = Literal["rad", "deg"]

_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
_LENGTH = {"m": 1.0, "mm": 1e-3}
_DELIMITERS = ",;\t"
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
    header, rows = _lines(path)
    where = f"{path}:{header[0]}"
    names, units = zip(*(_name_and_unit(cell) for cell in header[1]), strict=True)
    joints = _find(where, "joints", names, joint_names, "q")
    inputs = _find_commands(where, names, joint_names)
    columns = [_find(where, "column", names, ["time"], "")[0], *joints, *inputs]
    n = len(joints)
    scales = [_scale(f"{where}: time", units[columns[0]], _TIME, "s")]
    for chosen, per in ((joints, ""), (inputs, "/s")):
        for kind, i in zip(joint_types if chosen else (), chosen, strict=True):
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
    unsaid = [k for k in range(n) if joint_types[k] == "revolute" and not units[joints[k]]]
    most = np.abs(table[:, unsaid]).max(initial=0.0)
    if angles is None and most > _MANY_TURNS:
        raise ValueRangeError(
            f"{path}: angles up to {most:.4g} rad look like degrees; say which (--angles deg or --angles rad), "
            f"or name the unit behind the column, as q1 [deg]"
        )
    return time, table[:, :n], table[:, n:] if inputs else None


def column_names(path: Path) -> list[str]:
    """Return the names of the columns of a table without their units; raises as `read_joint_table`."""
    return [_name_and_unit(cell)[0] for cell in _lines(path)[0][1]]


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
