"""The last seconds of a supervised motion, always kept in memory, to be written when something has happened."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import Error
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.references.sample import TIME
from dqcontrol.robots.robot import Robot
from dqcontrol.supervisor.interventions import INTERVENTIONS

SECONDS = 20.0
_MOST_ROWS = 20_000


class BlackBox:
    """A ring of the last samples; it takes its memory once.

    Parameters
    ----------
    robot
        Whose motion it keeps.
    period
        Of the loop, s.
    seconds
        How far back it remembers, s; 20 000 samples at most.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> box = BlackBox(dqc.load_robot("iiwa7"), period=0.01)
    >>> for k in range(3000):
    ...     box.take(0.01, np.zeros(21), np.zeros(7), np.zeros(7), np.zeros(7), 0)
    >>> len(box), round(float(box.record("tracking error too large").time[0]), 9)
    (2000, 10.0)
    """

    def __init__(self, robot: Robot, period: float, seconds: float = SECONDS) -> None:
        self._robot = robot
        rows = max(min(math.ceil(seconds / period - 1e-9), _MOST_ROWS), 1)
        n, m = robot.configuration_size, robot.input_size
        self._desired, self._codes = np.zeros((rows, 21)), np.zeros((rows, 1))
        self._q, self._measured, self._command = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, m))
        self._count, self._time = 0, 0.0

    def __len__(self) -> int:
        return min(self._count, len(self._desired))

    def take(
        self, elapsed: float, desired: Array, q: Array, measured: Array, command: Array, code: float
    ) -> None:
        """Keep one sample, and forget the oldest.

        Parameters
        ----------
        elapsed
            Since the last sample, s.
        desired
            Sample of the reference, shape (21,).
        q, measured
            True (or again measured) and measured configuration, shape (n,), rad or m.
        command
            Inputs that left, shape (m,), rad/s or m/s.
        code
            Of what the supervisor did.
        """
        k = self._count % len(self._desired)
        if self._count:
            self._time += elapsed if 0.0 < elapsed < math.inf else 1e-9
        self._desired[k], self._q[k], self._measured[k], self._command[k] = desired, q, measured, command
        self._desired[k, TIME], self._codes[k, 0] = self._time, code
        self._count += 1

    def record(self, stopped: str) -> Record:
        """Return what is kept, in the order of time, as a record that ended for a reason.

        Raises
        ------
        Error
            If nothing is kept yet.
        """
        if not self._count:
            raise Error("black box: holds no samples yet")
        order = np.arange(self._count - len(self), self._count) % len(self._desired)
        q, desired = self._q[order], self._desired[order]
        finite = np.isfinite(q).all(
            axis=1
        )  # what an encoder said before it stopped the robot may be anything
        pose = np.full((len(q), 8), np.nan)
        pose[finite] = self._robot.fkm(q[finite])
        return Record(
            desired[:, TIME],
            q,
            self._measured[order],
            self._command[order],
            pose,
            desired,
            self._robot.joint_names,
            self._robot.input_names,
            stopped=stopped,
            readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), self._codes[order])},
        )
