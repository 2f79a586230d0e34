"""Trace of a loop's samples, and why it ended."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Protocol

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.controller.controller import Controller
from dqcontrol.files.long_array import long_array
from dqcontrol.loop.signals import Signal
from dqcontrol.named_fields import NamedFields


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


FARTHEST = 1e4  # rad or m: no robot goes there


class Stop(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """End a run early, once the error norm has stayed below a tolerance."""

    error: Annotated[float, Meta(gt=0, description="|vec8(1 − x*x_d)|")]
    samples: Annotated[int, Meta(ge=1, description="consecutive samples")] = 50


@dataclass(frozen=True)
class Trace:
    """What the loop saw at each sample, and why it ended.

    With a supervisor the last samples are those in which the robot came to rest: what is desired rests there too.
    """

    q: Array
    measured: Array
    command: Array
    stopped: str
    desired: Array
    disturbance: Array | None = None  # inertial twist, shape (done, 6)
    readings: dict[str, Signal] = field(default_factory=dict)  # what else the plant sensed
    kept: Array | None = None  # reports of the law's constraints


def empty_records(law: Controller, samples: Array) -> tuple[Array, Array, Array, Array]:
    """Return empty arrays for configurations, measured configurations, commands and reports of constraints."""
    n, m, size = law.robot.configuration_size, law.robot.input_size, len(samples)
    reports = long_array(size, len(law.report)) if len(law.report) else np.zeros((size, 0))
    return long_array(size, n), long_array(size, n), long_array(size, m), reports


def ended(
    done: int,
    samples: Array,
    records: tuple[Array, Array, Array, Array],
    realised: Array | None,
    failure: str | None,
    halted: str = "",
    finished: str = "",
) -> Trace:
    """Return the samples done, and say why there are no more: by failure, by a halt, or ``finished`` as it is said."""
    lost = _first_beyond(FARTHEST, records[0][:done])
    if lost > 0:
        done, failure = lost, f"a joint went beyond {FARTHEST:g} rad or m"
    if failure is not None:
        stopped = f"diverged at {samples[done, -1]:g} s: {failure}"
    elif halted:
        stopped = f"halted at {samples[max(done - 1, 0), -1]:g} s: {halted}"
    else:
        stopped = finished or ("duration" if done == len(samples) else "settled")
    q, measured, command, kept = (array[:done] for array in records)
    twists = None if realised is None else realised[:done]
    return Trace(q, measured, command, stopped, samples[:done], twists, kept=kept)


def _first_beyond(bound: float, rows: Array) -> int:
    """Return the first row with a number beyond ± bound, or 0."""
    if not rows.size or max(rows.max(), -rows.min()) <= bound:  # a tenth of the time of looking at each row
        return 0
    found = np.flatnonzero((np.abs(rows) > bound).any(axis=1))
    return int(found[0]) if len(found) else 0
