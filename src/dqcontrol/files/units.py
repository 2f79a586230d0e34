"""Numbers with a unit, as people write them in files: ``-88.6 deg``, ``60 mm``, ``8 ms``."""

from __future__ import annotations

import math
import re

UNITS = {
    "rad": ("rad", 1.0),
    "mrad": ("rad", 1e-3),
    "deg": ("rad", math.pi / 180),
    "°": ("rad", math.pi / 180),
    "degrees": ("rad", math.pi / 180),
    "m": ("m", 1.0),
    "cm": ("m", 1e-2),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "µm": ("m", 1e-6),
    "s": ("s", 1.0),
    "ms": ("s", 1e-3),
    "us": ("s", 1e-6),
    "µs": ("s", 1e-6),
    "min": ("s", 60.0),
    "kg": ("kg", 1.0),
    "g": ("kg", 1e-3),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "N/m": ("N/m", 1.0),
    "kN/m": ("N/m", 1e3),
    "Hz": ("Hz", 1.0),
}
_QUANTITY = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*("
    + "|".join(sorted(UNITS, key=len, reverse=True))
    + r")(/s(?:[²³]|\^?[23])?)?\s*"
)
_SHORT_TIMES = frozenset(  # of servos, networks and filters: milliseconds; none of ours is longer than 1 s
    ["period", "delay", "lag", "time_constant", "base_time_constant", "wheel_time_constant", "filter_time"]
)
_CONFIGURATIONS = frozenset(("start", "rest"))  # of bases, too, which stand many metres away
_POWERS = str.maketrans({"2": "²", "3": "³", "^": None})


def as_quantity(text: str) -> tuple[float, str] | None:
    """Return a number in SI units and its unit; None if the text is not a number with a unit.

    Parameters
    ----------
    text
        A number and one of the units of angle, length, time, mass, force and frequency, perhaps ``/s``, ``/s²`` or
        ``/s³``; a space between them may be left out.

    Examples
    --------
    >>> as_quantity("60 mm"), as_quantity("180deg/s^2"), as_quantity("circle")
    ((0.06, 'm'), (3.141592653589793, 'rad/s²'), None)
    """
    if not (match := _QUANTITY.fullmatch(text)):
        return None
    unit, factor = UNITS[match[2]]
    number = float(match[1])
    value = math.radians(number) if factor == math.pi / 180 else number * factor
    return value, unit + (match[3] or "").translate(_POWERS)


def unsaid_unit(key: str, number: float, unit: str) -> str:
    """Return what is to be asked of a number without a unit that is more likely in another; empty if nothing is.

    Parameters
    ----------
    key
        Name of what is given, as ``"rpy"`` or ``"delay"``.
    number
        Its value.
    unit
        In which a plain number is taken, perhaps ``"rad or m"``.

    Examples
    --------
    >>> unsaid_unit("rpy", 90, "rad")
    '90 is more than a full turn in radians; write 90 deg or 90 rad'
    >>> unsaid_unit("delay", 30, "s")
    '30 s is long for a delay; write 30 ms or 30 s'
    >>> unsaid_unit("rpy", 1.57, "rad"), unsaid_unit("duration", 30, "s")
    ('', '')
    """
    units = unit.split(" or ")
    if "rad" in units and key not in _CONFIGURATIONS and abs(number) > math.tau:
        written = " or ".join(f"{number:g} {each}" for each in ("deg", *units))
        return f"{number:g} is more than a full turn in radians; write {written}"
    if unit == "s" and key in _SHORT_TIMES and number > 1:
        name = key.replace("_", " ")
        return f"{number:g} s is long for a {name}; write {number:g} ms or {number:g} s"
    return ""


def number_in(text: str, unit: str) -> float | None:
    """Return a number, as ``0.008``, ``8ms`` or ``8 ms``, in a unit of SI; None if the text is none.

    Parameters
    ----------
    text
        The number; without a unit it is taken in that.
    unit
        Which; one of several for ``"rad or m"``.

    Examples
    --------
    >>> number_in("8ms", "s"), number_in("0.008", "s"), number_in("8 mm", "s")
    (0.008, 0.008, None)
    """
    try:
        return float(text)
    except ValueError:
        value, given = as_quantity(text) or (0.0, "")
        return value if given in unit.split(" or ") else None
