"""Control periods of the laws in real time, in Python, on this machine. [P16 5.8]"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.errors import ValueRangeError, as_count, as_positive
from dqcontrol.experiments import prepare
from dqcontrol.loop import Clock, Timing, close_loop
from dqcontrol.tables import Cell, Column, Table

BARE = "bare loop"  # label of loops without law or plant


@dataclass(frozen=True)
class SamplingTime:
    """One law at one period.

    Attributes
    ----------
    label
        Of law, parameter set and plant.
    timing
        All that was measured; ``timing.periods`` make a histogram.
    """

    label: str
    timing: Timing

    @property
    def mean(self) -> float:
        """Mean of the measured periods, s."""
        return float(self.timing.periods.mean())

    @property
    def deviation(self) -> float:
        """Standard deviation of the measured periods, s."""
        return float(self.timing.periods.std(ddof=1))

    @property
    def tail(self) -> float:
        """What 99 % of the periods deviate at most from the one set, s."""
        return float(np.quantile(np.abs(self.timing.periods - self.timing.period), 0.99))

    @property
    def computation(self) -> float:
        """Mean time of the law's command, kinematics included, s."""
        return float(self.timing.computation.mean())


def sampling_times(
    source: str | Path | dict[str, Any],
    periods: Sequence[float],
    samples: int,
    *,
    clock: Clock | None = None,
    progress: Callable[[float, int], None] | None = None,
) -> list[SamplingTime]:
    """Run every law and plant of a spec in real time at each period, and measure the steps.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary; its own period is only checked.
    periods
        Control periods, s.
    samples
        How many steps each runs, at least 3; beyond its end a reference rests.
    clock
        What paces and measures; default: the machine's.
    progress
        Called with the number of runs done, with parts of the one that runs, and of runs in all.

    Raises
    ------
    Error
        If something does not fit; before anything moves.

    Examples
    --------
    >>> from dqcontrol_theses.pereira2016.sampling_time import sampling_times
    >>> rows = sampling_times({
    ...     "name": "pace", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.01,
    ...     "reference": {"kind": "circle", "radius": 0.07, "duration": 2},
    ...     "law": {"kind": "proportional", "gain": 10}, "plant": {"kind": "servo"},
    ... }, periods=[0.004], samples=25)
    >>> rows[0].timing.periods.shape
    (24,)
    """
    if as_count("samples", samples) < 3:
        raise ValueRangeError(f"samples: must be at least 3, got {samples}")
    setting, clock = prepare(source), clock or Clock()
    runs = []
    for period in [as_positive("periods", period) for period in periods]:
        for case in setting.cases:
            scene = case.scene
            law = case.variant.law.prepare(
                scene.robot, scene.reference, period, case.limits, tasks=scene.tasks
            )
            plant = case.plant.start(scene.robot, scene.start, period, samples, setting.spec.seed)
            runs.append((case, law, plant, scene.reference.samples(period * np.arange(samples))))
    rows = []
    for done, (case, law, plant, motion) in enumerate(runs):
        report = progress and (lambda step, steps, done=done: progress(done + step / steps, len(runs)))
        close_loop(law, plant, motion, clock=clock, progress=report)
        rows.append(SamplingTime(case.names.label, clock.timing))
    return rows


def bare_loops(periods: Sequence[float], samples: int, *, clock: Clock | None = None) -> list[SamplingTime]:
    """Run loops without law or plant: what this machine itself makes of each period, beside `sampling_times`."""
    clock, rows = clock or Clock(), []
    for period in periods:
        with clock.running(period, samples):
            for _ in range(samples):
                clock.await_step()
                clock.commanded()
        rows.append(SamplingTime(BARE, clock.timing))
    return rows


def sampling_table(rows: Sequence[SamplingTime], title: str = "") -> Table:
    """Return one row a law and period."""
    cells: list[list[tuple[Column, Cell]]] = [
        [
            (Column("law"), row.label),
            (Column("T", "ms", ".4g"), 1e3 * row.timing.period),
            (Column("mean", "ms", ".4f"), 1e3 * row.mean),
            (Column("std. dev.", "ms", ".4f"), 1e3 * row.deviation),
            (Column("99 % within", "ms", ".4f"), 1e3 * row.tail),
            (Column("command", "ms", ".4f"), 1e3 * row.computation),
            (Column("overruns"), row.timing.overruns),
        ]
        for row in rows
    ]
    return Table.of(cells, title)
