"""What a plant senses beside its configuration."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

BASE_POSITION, BASE_QUATERNION = "base_position", "base_quaternion"  # of a base that may lift and tilt


class Channel(NamedTuple):
    """One quantity that a plant senses.

    Attributes
    ----------
    name
        Of the quantity.
    parts
        Names of its numbers; empty for a single one.
    unit
        Of each of them; empty where there is none.
    """

    name: str
    parts: tuple[str, ...]
    unit: str

    @property
    def size(self) -> int:
        """How many numbers it has."""
        return len(self.parts) or 1


@runtime_checkable
class SensingPlant(Protocol):
    """A plant at work that senses more than its configuration: what it senses is recorded at every sample.

    Attributes
    ----------
    channels
        The quantities.
    readings
        Their present values one after the other, shape (sum of sizes,), updated in place.
    """

    channels: tuple[Channel, ...]
    readings: NDArray[np.float64]
