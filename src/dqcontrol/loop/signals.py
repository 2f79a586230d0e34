"""Quantities over time, and the collection of what a plant senses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.plants.channels import SensingPlant
from dqcontrol.plants.plant import LivePlant


class Signal(NamedTuple):
    """One quantity over time.

    Attributes
    ----------
    name
        Of the quantity.
    parts
        Names of its columns; empty for a single number.
    units
        One for each column; empty where there is none.
    values
        Shape (N, number of columns).
    """

    name: str
    parts: tuple[str, ...]
    units: tuple[str, ...]
    values: NDArray[np.float64]

    def headings(self) -> list[str]:
        """Return the columns' names with their units."""
        prefix = "" if self.name == "q" else f"{self.name}."
        names = [prefix + part for part in self.parts] or [self.name]
        return [f"{name} [{unit}]" if unit else name for name, unit in zip(names, self.units, strict=True)]


class Readings:
    """Collects what a plant senses, if it does, at each of a number of samples."""

    def __init__(self, plant: LivePlant, count: int) -> None:
        self._plant = plant if isinstance(plant, SensingPlant) else None
        self._rows = np.empty((count, len(self._plant.readings))) if self._plant else np.empty((0, 0))

    def take(self, k: int) -> None:
        """Keep the present values as those of sample k."""
        if self._plant:
            self._rows[k] = self._plant.readings

    def signals(self, count: int) -> dict[str, Signal]:
        """Return the first samples of all quantities by name."""
        found, first = {}, 0
        for channel in self._plant.channels if self._plant else ():
            values = self._rows[:count, first : first + channel.size]
            units = (channel.unit,) * channel.size
            found[channel.name] = Signal(channel.name, channel.parts, units, values)
            first += channel.size
        return found
