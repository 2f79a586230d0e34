"""What a plant senses beside its configuration."""

from __future__ import annotations

from typing import NamedTuple

WRENCH_READINGS = ("wrist_force", "wrist_torque")  # of a force sensor, its axes, N and N·m
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
