"""Six-axis force–torque sensor between arm and hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol.plants.controller_file import WristSensor
from dqcontrol.plants.elastic_model import TICK
from dqcontrol.plants.filters import MEMORY, butterworth


class LiveWrist:
    """The sensor at work: what kernels filter at every tick gets bias and noise when it is read.

    Attributes
    ----------
    coefficients, memory, filtered
        Of its filter, and the filtered wrench that the arm exerts on the hand, shapes (5,), (6, 3) and (6,).
    """

    def __init__(self, sensor: WristSensor) -> None:
        self.coefficients = butterworth(sensor.cutoff, TICK)
        self.memory, self.filtered = np.zeros((6, MEMORY)), np.zeros(6)
        self._bias = np.array([*sensor.force_bias, *sensor.torque_bias])
        self._scale = np.repeat([sensor.force_noise, sensor.torque_noise], 3)
        self._noise = np.empty(6)

    def read(self, rng: np.random.Generator, out: NDArray[np.float64]) -> None:
        """Write force and torque, shape (6,), N and N·m, that the hand exerts on the arm, axes of the tool."""
        rng.standard_normal(out=self._noise)
        np.multiply(self._noise, self._scale, out=out)
        out += self._bias
        out -= self.filtered
