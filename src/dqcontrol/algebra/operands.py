"""What `DualQuaternion` combines with, compares to and prints as."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra.batch import broadcast_lead
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ShapeError, as_array

_SHOWN_AS_ZERO = 5e-13
_UNITS = ("", "i", "j", "k")


def as_number(value: Any) -> float | None:
    """Return a real number, or None for a foreign type; arrays are refused: they might mean coefficients."""
    if isinstance(value, Real | np.ndarray) and not getattr(value, "ndim", 0):
        return float(as_array("number", np.asarray(value), ()))
    if isinstance(value, np.ndarray | list | tuple):
        raise ShapeError(
            f"operand: expected a number or a DualQuaternion, got an array of shape {np.shape(value)}; "
            "make coefficients a DualQuaternion(…), or compute with .vec8"
        )
    return None


def coefficients(value: Any) -> Array | None:
    """Return the coefficients of a DualQuaternion or of a real number, or None for a foreign type."""
    if hasattr(value, "vec8"):
        return np.asarray(value)
    number = as_number(value)
    return None if number is None else np.array([number, 0.0, 0, 0, 0, 0, 0, 0])


def add(a: Array, b: Array) -> Array:
    """Return the sum of two batches."""
    broadcast_lead(a=a, b=b)
    return a + b


def close(a: Array, b: Array, tolerance: float) -> NDArray[np.bool_]:
    """Return where all 8 coefficients agree, relative to the largest of them where that exceeds 1."""
    broadcast_lead(value=a, other=b)
    scale = np.maximum(1.0, np.maximum(np.abs(a).max(axis=-1), np.abs(b).max(axis=-1)))
    return np.abs(a - b).max(axis=-1) <= tolerance * scale


def text(x: Array) -> str:
    """Return one dual quaternion as in the papers: ``0.7 + 0.7i + ε(0.1j)``."""
    primary, dual = _quaternion_text(x[:4]), _quaternion_text(x[4:])
    if not dual:
        return primary or "0"
    return f"{primary} + ε({dual})" if primary else f"ε({dual})"


def batch_text(x: Array, shown: int = 6) -> str:
    """Return the first few of a batch, one a line, or one dual quaternion."""
    if x.ndim == 1:
        return text(x)
    lines = [batch_text(row, shown).replace("\n", "\n ") for row in x[:shown]]
    return "[" + ",\n ".join(lines + ["…"] * (len(x) > shown)) + "]"


def _quaternion_text(q: Array) -> str:
    out = ""
    for value, unit in zip(q, _UNITS, strict=True):
        if abs(value) >= _SHOWN_AS_ZERO:
            sign = (" - " if value < 0 else " + ") if out else ("-" if value < 0 else "")
            out += f"{sign}{abs(value):.6g}{unit}"
    return out


def pose_markdown(x: Any) -> str | None:
    """Return what notebooks show of a `DualQuaternion`: position and turn of a pose; None if it is no single pose."""
    if x.batch_shape:
        return None
    try:
        (axis, angle), place = x.axis_angle(), x.translation
    except Error:  # not of unit norm
        return None
    p, n = (", ".join(f"{value + 0.0:.4g}" for value in vector.round(6)) for vector in (place, axis))
    return f"pose: position ({p}) m, turned by {np.rad2deg(angle):.4g}° about ({n})"
