"""Text tables that programs of users write: the line of column names, rows, units, columns by name."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Literal

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, suggest
from dqcontrol.files.input_file import as_number

TIME_NAMES = ("time", "timestamp", "t", "stamp", "%time", "__time")
"""Names of the column of time, in small letters."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "µs": 1e-6, "sec": 1.0}

# Joints are logged with periods of 0.25 ms to half a second: of the units that make a period of that, one is left.
_LARGEST_STEP = {"s": 0.5, "ms": 250.0, "us": 250e3, "ns": math.inf}
_UNIX = (1e9, 4e9)  # s: the years 2001 to 2096
_WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}


def written_stamp(where: str, cell: str) -> Decimal:
    """Return a stamp with all digits; of a date, s of Unix time.

    Raises
    ------
    FileFormatError
        If it is neither a finite number nor a date.
    """
    try:
        stamp = Decimal(cell)
    except InvalidOperation:
        date = _date(cell)
        return date if date is not None else Decimal(as_number(where, cell))
    if not math.isfinite(float(stamp)):
        as_number(where, cell)
    return stamp


def seconds_from(stamps: list[Decimal], scale: float) -> Array:
    """Return s after the first stamp."""
    begin = stamps[0]
    return np.array([float(stamp - begin) for stamp in stamps]) * scale


def time_unit(stamps: list[Decimal]) -> tuple[str, list[str]]:
    """Return the unit of stamps that do not name theirs, and what is to be said of it.

    Examples
    --------
    >>> from decimal import Decimal
    >>> time_unit([Decimal(k) for k in (0, 8, 16)])[0], time_unit([Decimal(k) for k in (0, 1)])[0]
    ('ms', 'ms')
    """
    if len(stamps) < 2:
        return "s", []
    step = float(np.median([float(stamps[k] - stamps[k - 1]) for k in range(1, min(len(stamps), 1001))]))
    first = abs(float(stamps[0]))
    seconds = [name for name in _WORDS if _UNIX[0] <= first * TIME_UNITS[name] < _UNIX[1]]
    of_dates = [name for name in seconds if step * TIME_UNITS[name] < 0.5]
    unit = of_dates[0] if of_dates else next(name for name, most in _LARGEST_STEP.items() if step < most)
    if unit == "s":
        return unit, []
    return unit, [
        f"time: steps of {step:g} without a unit are taken for {_WORDS[unit]}; "
        "if they are others, name the unit in the column, as time [s]"
    ]


def _date(cell: str) -> Decimal | None:
    """Return s of Unix time of a date as ISO 8601 writes it; without a zone, UTC."""
    try:
        date = datetime.fromisoformat(cell)
    except ValueError:
        return None
    if date.tzinfo is None:
        date = date.replace(tzinfo=UTC)
    passed = date - datetime(1970, 1, 1, tzinfo=UTC)
    return Decimal(passed.days * 86400 + passed.seconds) + Decimal(passed.microseconds) / 10**6


Missing = Literal["interpolate", "skip"]


def fill_missing(
    path: Path,
    time: Array,
    values: Array,
    names: Sequence[str],
    measured: int,
    missing: Missing,
    notes: list[str],
) -> tuple[Array, Array]:
    """Return time and values without NaN.

    Measured positions are joined linearly in between, and samples before the first or after the last number of a joint
    left out; or all samples with one missing are. Of what was commanded the last number holds.

    Parameters
    ----------
    path
        The file, for errors.
    time, values
        (N,) s and (N, columns).
    names
        Of the columns.
    measured
        How many of the columns are measured positions; the others were commanded.
    missing
        What to do with missing positions.
    notes
        Takes a line that counts what was done.

    Raises
    ------
    FileFormatError
        If a column has no number at all, or no sample is left.
    """
    empty = np.isnan(values)
    if not empty.any():
        return time, values
    for i in np.flatnonzero(empty.all(axis=0))[:1]:
        raise FileFormatError(f"{path}: {names[i]}: all {len(time)} cells are empty")
    counts = [f"{names[i]} {count}" for i, count in enumerate(empty.sum(axis=0)) if count]
    values = values.copy()
    for i in range(measured, values.shape[1]):
        given = np.flatnonzero(~empty[:, i])
        last = np.searchsorted(given, np.arange(len(time)), side="right") - 1
        values[:, i] = values[given[np.maximum(last, 0)], i]
    if missing == "skip":
        kept = ~empty[:, :measured].any(axis=1)
        done = f"{np.count_nonzero(~kept)} of {len(time)} samples are left out"
    else:
        given = ~empty[:, :measured]
        first, final = given.argmax(axis=0).max(), (len(time) - 1 - given[::-1].argmax(axis=0)).min()
        kept = np.zeros(len(time), dtype=bool)
        kept[first : final + 1] = True
        widest = 0.0
        for i in range(measured):
            known = time[given[:, i]]
            values[:, i] = np.interp(time, known, values[given[:, i], i])
            if not given[:, i].all() and len(known) > 1:
                beside = np.searchsorted(known, time[~given[:, i]]).clip(1, len(known) - 1)
                widest = max(widest, float((known[beside] - known[beside - 1]).max()))
        done = f"positions are joined linearly over at most {widest:.4g} s, commands held"
    if not kept.any():
        raise FileFormatError(
            f"{path}: no sample has the positions of all joints ({', '.join(counts)} cells empty)"
        )
    notes.append(f"empty cells, of {len(time)}: {', '.join(counts)}; {done}")
    time = time[kept]
    return time - time[0], values[kept]


ANGLES = {"rad": 1.0, "deg": math.pi / 180, "°": math.pi / 180}
LENGTHS = {"m": 1.0, "mm": 1e-3}
DELIMITERS = ",;\t"
EMPTY = ("", "nan", "na", "n/a", "null", "none", "-")
_NUMBER = re.compile(r"[+-]?\d*\.?\d+(e[+-]?\d+)?", re.IGNORECASE)
_SUFFIX = re.compile(r"(.+)_(s|sec|ms|us|ns|rad|deg|m|mm)")


def table_rows(path: Path, lines: Iterable[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the column names, then the rows of a table, each with the number of its line."""
    header, delimiter = None, None
    for number, line in enumerate(lines, start=1):
        text = line.strip(" ")
        if header is None:
            text = text.lstrip("# ")
            delimiter = max(DELIMITERS, key=text.count)
            delimiter = delimiter if delimiter in text else None
        if not text.strip() or text.startswith("#"):
            continue
        try:
            row = next(csv.reader([text], delimiter=delimiter)) if delimiter else text.split()
            cells = [cell.strip() for cell in row]
        except csv.Error as error:
            raise FileFormatError(f"{path}:{number}: {error}") from None
        if header is not None:
            yield number, cells
        elif not line.lstrip().startswith("#") or any(
            name_and_unit(cell, TIME_NAMES)[0].lower() in TIME_NAMES for cell in cells
        ):
            if all(_NUMBER.fullmatch(cell) for cell in cells):
                raise FileFormatError(
                    f"{path}:{number}: expected a line of column names: time, q1, q2, …; got numbers"
                )
            header = number, cells
            yield header
    if header is None:
        raise FileFormatError(f"{path}: is empty; expected a line of column names: time, q1, q2, …")


def name_and_unit(cell: str, known: Iterable[str] = ()) -> tuple[str, str]:
    """Split the unit off a name: in brackets, or behind an underscore where that leaves a known name.

    A number in brackets, as in ``q[0]``, is part of the name.
    """
    match = re.fullmatch(r"(.+?)\s*(?:\[\s*([^\]\d]*)\]|\(\s*([^)\d]*)\))", cell)
    if match:
        return match[1], (match[2] or match[3] or "").strip()
    suffix = _SUFFIX.fullmatch(cell)
    if suffix and cell not in known and (suffix[1] in known or suffix[1].lower() in known):
        return suffix[1], suffix[2]
    return cell, ""


def find_columns(
    where: str, what: str, names: Sequence[str], wanted: Sequence[str], letter: str
) -> list[int]:
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


def unit_scale(where: str, unit: str, allowed: dict[str, float], default: str) -> float:
    """Return by what a column is multiplied; ``default`` is the unit of those that name none."""
    if unit and unit not in allowed:
        raise FileFormatError(f"{where}: unknown unit '{unit}' (allowed: {', '.join(allowed)})")
    return allowed[unit or default]
