"""Six-axis force–torque sensor between arm and hand."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.compliant.controller_file import WristSensor
from dqcontrol.plants.compliant.loads_and_faults import WristFault


class LiveWrist:
    """The sensor at work: what kernels filter at every tick gets bias and noise when it is read.

    Attributes
    ----------
    filtered
        The filtered wrench that the arm exerts on the hand, shape (6,).
    """

    def __init__(self, sensor: WristSensor, filtered: Array, fault: WristFault | None = None) -> None:
        self.filtered = filtered
        self._bias = np.array([*sensor.force_bias, *sensor.torque_bias])
        self._scale = np.repeat([sensor.force_noise, sensor.torque_noise], 3)
        self._noise = np.empty(6)
        self._fails, self._recovers, self._stuck = np.inf, np.inf, np.zeros(6)
        if fault is not None:
            self._fails = fault.time
            self._recovers = self._fails + fault.duration
            self._stuck[:3] = fault.force

    def read(self, time: float, rng: np.random.Generator, out: Array) -> None:
        """Write force and torque at a time, (6,), N and N·m, that the hand exerts on the arm, axes of the tool."""
        rng.standard_normal(out=self._noise)
        np.multiply(self._noise, self._scale, out=out)
        out += self._bias
        out -= self.filtered
        if self._fails <= time < self._recovers:
            out[:] = self._stuck
