"""Rows of a live robot since it was last put at rest, up to a number of rows."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.loop.record import Record
from dqcontrol.references.sample import SAMPLE_SIZE
from dqcontrol.robots import Robot


class RecordedRows:
    """A `SampleSink` in memory that stops taking rows when it is full.

    Parameters
    ----------
    robot
        Whose rows they are.
    most
        Rows at most; memory is taken as they come.
    """

    failure: str = ""

    def __init__(self, robot: Robot, most: int) -> None:
        self._robot, self._most = robot, most
        n, m = robot.configuration_size, robot.input_size
        self._sizes = SAMPLE_SIZE, n, n, m
        self._rows = np.zeros((1024, sum(self._sizes)))
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def is_full(self) -> bool:
        """Whether it takes no more."""
        return self._count >= self._most

    def take(
        self, sample: Array, q: Array, measured: Array, command: Array, interventions: float = 0.0
    ) -> None:
        """Keep a row; see `SampleSink`."""
        if self.is_full:
            return
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = np.concatenate([sample, q, measured, command])
        self._count += 1

    def record(self) -> Record:
        """Return what was kept."""
        robot = self._robot
        rows = self._rows[: self._count]
        sample, q, measured, command = np.split(rows, np.cumsum(self._sizes)[:-1], axis=1)
        return Record(
            time=sample[:, -1].copy(),
            q=q.copy(),
            measured=measured.copy(),
            command=command.copy(),
            pose=robot.fkm(q),
            desired=sample.copy(),
            joint_names=robot.joint_names,
            input_names=robot.input_names,
        )
