"""A force sensor at an end effector, and what hangs on it."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.plants.plant import WRENCH_READINGS, Channel

TOUCH_FORCE = "touch_force"  # of the environment on the end effector, base axes
AXES = ("x", "y", "z")
CHANNELS = (
    Channel(WRENCH_READINGS[0], AXES, "N"),
    Channel(WRENCH_READINGS[1], AXES, "N·m"),
    Channel(TOUCH_FORCE, AXES, "N"),
)


class Wrist(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A force sensor at the end effector, along its axes and about its origin, and what hangs on it.

    Parameters
    ----------
    force_noise, torque_noise
        Standard deviation, white, N and N·m.
    force_bias, torque_bias
        What it shows without load, N and N·m.
    filter
        Time constant of its low pass, s.
    mass, center
        Of the tool beyond it, kg and m.
    length, radius
        Of the tool in physics: a rod along z of the end effector that ends at its origin, m; none where the length is
        0.
    flat
        True: it ends flat, as a peg; else round, as a pen.
    """

    spec_key: ClassVar[str] = "plant.wrist"
    force_noise: Annotated[float, Meta(ge=0, description="N")] = 0.0
    torque_noise: Annotated[float, Meta(ge=0, description="N·m")] = 0.0
    force_bias: Annotated[Three, Meta(description="N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Three, Meta(description="N·m")] = (0.0, 0.0, 0.0)
    filter: Annotated[float, Meta(ge=0, description="s")] = 0.0
    mass: Annotated[float, Meta(ge=0, le=1e4, description="kg")] = 0.0
    center: Annotated[Three, Meta(description="m")] = (0.0, 0.0, 0.0)
    length: Annotated[float, Meta(ge=0, description="m")] = 0.0
    radius: Annotated[float, Meta(gt=0, description="m")] = 0.005
    flat: bool = False

    @property
    def bias(self) -> Array:
        """Force and torque without load, shape (6,)."""
        return np.array([*self.force_bias, *self.torque_bias])

    @property
    def noise(self) -> Array:
        """Standard deviation of force and torque, shape (6,)."""
        return np.repeat([self.force_noise, self.torque_noise], 3)

    def kept(self, period: float) -> float:
        """Return what is left of the filter's value after a period, s."""
        return math.exp(-period / self.filter) if self.filter else 0.0
