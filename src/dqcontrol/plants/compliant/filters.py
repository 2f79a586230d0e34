"""Third-order Butterworth low-pass filters, and the step that kernels share."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compiled.compile import inline

COEFFICIENTS, MEMORY = (
    5,
    3,
)  # numbers a filter: gain and pole of its first section, gain and poles of its second


def butterworth(cutoff: float, period: float) -> NDArray[np.float64]:
    """Return the coefficients of a third-order Butterworth filter, shape (5,).

    A first-order section g₁ (1 + z⁻¹) / (1 + a z⁻¹) and a second-order one g₂ (1 + z⁻¹)² / (1 + b z⁻¹ + c z⁻²), by
    the bilinear transform with the cutoff at its place.

    Parameters
    ----------
    cutoff
        Hz, where the gain is √½; below half the sampling rate.
    period
        Sampling time, s.

    Examples
    --------
    >>> bool(abs(butterworth(250.0, 1e-3)[1]) < 1e-12)  # a quarter of the sampling rate
    True
    """
    w = math.tan(math.pi * cutoff * period)
    second = 1 + w + w * w  # poles of s² + s + 1
    return np.array(
        [w / (1 + w), (w - 1) / (1 + w), w * w / second, 2 * (w * w - 1) / second, (1 - w + w * w) / second]
    )


@inline
def rest(coefficients, memory, value):
    """Set a filter's memory as if it had seen the value for ever."""
    memory[0] = value * (coefficients[0] - coefficients[1])
    memory[1] = value * (1.0 - coefficients[2])
    memory[2] = value * (coefficients[2] - coefficients[4])


@inline
def filtered(coefficients, memory, value):
    """Return the filter's answer to the next value."""
    first = coefficients[0] * value + memory[0]
    memory[0] = coefficients[0] * value - coefficients[1] * first
    second = coefficients[2] * first + memory[1]
    memory[1] = 2.0 * coefficients[2] * first - coefficients[3] * second + memory[2]
    memory[2] = coefficients[2] * first - coefficients[4] * second
    return second
