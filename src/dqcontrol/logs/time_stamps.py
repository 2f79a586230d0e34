"""Time in tables as robots write it: units that are not named, stamps of Unix time, dates."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.files.text_file import as_number

TIME_NAMES = ("time", "timestamp", "t", "stamp", "%time", "__time")
"""Names of the column of time, in small letters."""

TIME_UNITS = {
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "µs": 1e-6,
    "sec": 1.0,
}

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
    unit = next(
        (
            name
            for name in _WORDS
            if _UNIX[0] <= first * TIME_UNITS[name] < _UNIX[1] and step * TIME_UNITS[name] < 0.5
        ),
        next(name for name, most in _LARGEST_STEP.items() if step < most),
    )
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
