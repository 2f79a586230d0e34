"""Numbers with a unit, as people write them in files: ``-88.6 deg``, ``60 mm``, ``8 ms``."""

from __future__ import annotations

import math
import re

_UNITS = {
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
    "Hz": ("Hz", 1.0),
}
_QUANTITY = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*("
    + "|".join(sorted(_UNITS, key=len, reverse=True))
    + r")(/s(?:[²³]|\^?[23])?)?\s*"
)
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
    unit, factor = _UNITS[match[2]]
    number = float(match[1])
    value = math.radians(number) if factor == math.pi / 180 else number * factor
    return value, unit + (match[3] or "").translate(_POWERS)


def as_seconds(text: str) -> float | None:
    """Return a time, as ``0.008``, ``8ms`` or ``8 ms``, in seconds; None if the text is none."""
    try:
        return float(text)
    except ValueError:
        value, unit = as_quantity(text) or (0.0, "")
        return value if unit == "s" else None
