"""One run to a goal as [S17] judges it, and the gain with which another law takes as long."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.laws import GuidedProportional, Law
from dqcontrol.loop import Record, part_of, simulate_prepared
from dqcontrol.measures import evaluate
from dqcontrol.plants import Integrator
from dqcontrol.references import POSE, DriveTo
from dqcontrol.robots import Robot
from dqcontrol_theses.printed import PRINTED_INVERSE
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH

_SLOWEST, _FASTEST, _HALVINGS = 0.02, 10.0, 14
_MATCHED = 0.05  # settling times that differ by less are matched [S17 5.2.2]


@dataclass(frozen=True)
class RaceOutcome:
    """What came of one run.

    Attributes
    ----------
    settling
        Iterations until the error norm stays below `GOOD_ENOUGH`; NaN if it does not. Of a run that ended when it first
        was: until then.
    first_below
        Iterations until it is first below `GOOD_ENOUGH`; NaN if it never is.
    effort
        √∫|u_f|² dt, rad/√s. [S17 Table 5.1]
    first, largest_change
        |u_f| of the first sample, and of its largest change from one sample to the next or from rest, rad/s.
    overshoot
        Of the position, as a share of the first error.
    final
        Last error norm.
    """

    settling: float
    first_below: float
    effort: float
    first: float
    largest_change: float
    overshoot: float
    final: float

    @classmethod
    def of(cls, record: Record, period: float) -> RaceOutcome:
        """Measure a whole run of a body with drives."""
        metrics = evaluate(record, tolerance=GOOD_ENOUGH)
        told = record.readings["actuator_command"].values
        changes = np.linalg.norm(np.diff(told, axis=0, prepend=np.zeros((1, told.shape[1]))), axis=1)
        below = np.flatnonzero(record.error < GOOD_ENOUGH)
        return cls(
            metrics.settling_time / period,
            float(below[0]) if len(below) else math.nan,
            metrics.effort,
            float(changes[0]),
            float(changes.max()),
            metrics.position_overshoot,
            metrics.final_error,
        )


def until_good_enough(record: Record) -> Record:
    """Return a record up to where S17 ends its runs on the robot: its first error norm below `GOOD_ENOUGH`."""
    below = np.flatnonzero(record.error < GOOD_ENOUGH)
    return part_of(record, 0, int(below[0]) + 1) if len(below) else record


def outcome(
    robot: Robot, start: Array, samples: Array, law: Law, period: float, *, as_s17: bool = False
) -> RaceOutcome:
    """Run a law on ideal joints, with S17's stop or to the end."""
    record = simulate_prepared(law.prepare(robot, None, period), Integrator(), start, samples)
    return RaceOutcome.of(until_good_enough(record) if as_s17 else record, period)


def guided_outcome(robot: Robot, start: Array, samples: Array, period: float) -> RaceOutcome:
    """Run the remedy on ideal joints: a planned way to the goal of some samples, judged by its distance from that."""
    way = DriveTo.pose(robot, start, samples[-1, POSE])
    law = GuidedProportional(gain=1.0, inverse=PRINTED_INVERSE).prepare(robot, way, period)
    record = simulate_prepared(law, Integrator(), start, way.samples(samples[:, -1]))
    return RaceOutcome.of(replace(record, desired=samples), period)


def matched_gain(settling: Callable[[float], float], target: float) -> float | None:
    """Return a gain with which a law settles within 5 % of a number of iterations; None if there is none.

    Parameters
    ----------
    settling
        Iterations that a gain takes, fewer the higher it is; NaN for those that do not end in time.
    target
        Iterations.
    """
    if not math.isfinite(target):
        return None
    low, high = math.log(_SLOWEST), math.log(_FASTEST)
    for _ in range(_HALVINGS):
        gain = math.exp((low + high) / 2)
        took = settling(gain)
        if abs(took - target) <= _MATCHED * target:
            return gain
        if took < target:
            high = math.log(gain)
        else:
            low = math.log(gain)
    return None
