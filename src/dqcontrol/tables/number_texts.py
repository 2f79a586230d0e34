"""Numbers as people read them: as many digits as tell something, and powers of ten only from a million on."""

from __future__ import annotations

import math


def without_powers(value: float, form: str) -> str:
    """Return a number in a format that ends in ``g``, with all digits before the point where that has a power of ten.

    Examples
    --------
    >>> without_powers(46512.3, ".3g"), without_powers(1e6, ".3g")
    ('46512', '1e+06')
    """
    text = format(value, form)
    return f"{value:.0f}" if "e+" in text and abs(value) < 1e6 else text


def number_text(value: float, digits: int = 3) -> str:
    """Return a number with so many digits, or all before the point.

    Examples
    --------
    >>> number_text(0.12345), number_text(99.7, 2), number_text(46512.3)
    ('0.123', '100', '46512')
    >>> number_text(5.7e-5, 2)
    '0.000057'
    """
    if 0 < abs(value) < 1e-4:  # where Python begins with powers of ten
        places = digits - 1 - math.floor(math.log10(abs(value)))
        return f"{value:.{places}f}".rstrip("0") if abs(value) >= 1e-9 else "0"
    return without_powers(value, f".{digits}g")


def length_text(value: float, digits: int = 3) -> str:
    """Return a length in mm, one of a metre and more in m; negative inside of something."""
    sign, size = "−" if value < 0 else "", abs(value)
    return (
        f"{sign}{number_text(size, digits)} m" if size >= 1 else f"{sign}{number_text(1e3 * size, digits)} mm"
    )


def force_text(value: float) -> str:
    """Return a force in N."""
    return f"{number_text(value)} N"


def angle_text(value: float) -> str:
    """Return an angle, rad, in degrees."""
    return f"{number_text(math.degrees(value), 2)}°"


def percent_text(share: float, digits: int = 2) -> str:
    """Return a share in percent."""
    return f"{number_text(100 * share, digits)} %"
