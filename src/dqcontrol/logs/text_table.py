"""Text tables that programs of users write: the line of column names, rows, units, columns by name."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from dqcontrol.errors import FileFormatError, suggest
from dqcontrol.logs.time_stamps import TIME_NAMES

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
            cells = (
                [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
                if delimiter
                else text.split()
            )
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
