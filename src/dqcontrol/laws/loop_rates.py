"""Gains of a law's loops: the rates at which it corrects small errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LoopRates:
    """Rates λ at which small errors decay, ė = −λe, with ideal joints and a short period.

    Attributes
    ----------
    position, orientation
        1/s, the largest modulus at each row of the law's parameters, shape (K,); complex where errors oscillate
        even so; None where the law leaves that part free.
    integral
        k_I of both, 1/s²: ė = −λe − k_I ∫e dt.
    lag
        k_v of laws that command accelerations, 1/s: their velocities follow what λ asks for, u̇ = k_v (−λe − u), also
        those in the null space. 0 for laws that command velocities.
    """

    position: NDArray[np.inexact] | None
    orientation: NDArray[np.inexact] | None
    integral: float = 0.0
    lag: float = 0.0


def largest_rates(gains: NDArray[np.float64]) -> NDArray[np.inexact]:
    """Return the eigenvalue of largest modulus of each matrix, shape (K,); real where all are."""
    values = np.linalg.eigvals(gains)
    largest = np.take_along_axis(values, np.abs(values).argmax(axis=-1)[:, None], axis=-1)[:, 0]
    return largest.real if (np.abs(largest.imag) <= 1e-9 * np.abs(largest)).all() else largest
