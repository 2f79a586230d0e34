"""What a loop end effectors its samples to while the robot moves."""

from __future__ import annotations

from typing import Protocol

from dqcontrol.arrays import Array


class SampleSink(Protocol):
    """Takes samples one by one and returns at once; `dqcontrol.recording.RecordStream` is one.

    Attributes
    ----------
    failure
        Why samples are lost, empty while none is: the loop then stops the robot.
    """

    failure: str

    def take(
        self, sample: Array, q: Array, measured: Array, command: Array, interventions: float = 0.0
    ) -> None:
        """Take one sample.

        Parameters
        ----------
        sample
            As of ``Sample.data``, shape (21,); the time increases.
        q, measured
            True and measured configuration, shape (n,), rad or m.
        command
            Inputs after all limits, shape (m,), rad/s or m/s.
        interventions
            Code of the supervisor.
        """
        ...
