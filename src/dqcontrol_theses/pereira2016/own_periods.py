"""Laws that did not keep their period on the robot, at the mean period that Table 61 prints of them.

Their commands took longer than the period, and so did their runs: "their numerical performance ... was done based on
their own duration" [P16 5.7]. The program multiplied commands by the nominal period all the same, as far as the numbers
tell: then the mean of each criterion over the samples stays what it was (within 1 %, `dqcontrol reproduce
pereira2016/spiral`, duration-does-not-matter), and its integral grows by the printed period over the nominal one.

In physics they also run so. The program took the samples of its reference and of its gains one by one, however late: so
a run here is as many samples, most of a nominal period and some one tick of the joint controllers longer, so that their
mean is the printed one. It is out of step with the exchange of states at 100 Hz, as the robot was. No number is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dqcontrol.experiments import Combination, PreparedExperiment, measure, prepare
from dqcontrol.loop import Record
from dqcontrol.plants import CompliantPlant
from dqcontrol.references import TIME
from dqcontrol.tables import Cell, Column, Ratio, Table
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS, published_spec
from dqcontrol_theses.pereira2016.published_numbers import published_cells
from dqcontrol_theses.printed import PublishedCell
from dqcontrol_theses.results import METRICS, NAMES, Results

_LATE = 1.01  # times the nominal period, from which a law is listed
_OVER_TIME = ("error", "control", "joint_step")  # the hand's path is as long however long it takes


class LateLaw(NamedTuple):
    """A law of a spec with one of its sets."""

    spec: str
    law: str
    set: str


@dataclass(frozen=True)
class LateRun:
    """The published criteria of a run in physics at the printed period, by their names, over its own duration."""

    criteria: dict[str, float]


def stretch(law: str, period: float) -> float:
    """Return the mean period that Table 61 prints of a law over the nominal one, s; 1 where it prints none.

    Examples
    --------
    >>> round(stretch("LQR-DQ", 0.02), 4), stretch("LQR-DQ", 0.025)
    (1.0587, 1.0)
    """
    label = f"{1e3 * period:g} ms"
    means = [c.mean for c in published_cells("sampling-time") if (c.law, c.set) == (law, label)]
    return means[0] / period if means else 1.0


def run_late(late: LateLaw) -> LateRun:
    """Run a law in physics at the period that Table 61 prints of it."""
    setting = prepare(published_spec(late.spec, PHYSICS))
    case = next(
        case for case in setting.cases if case.names.law == late.law and late.set in ("", case.names.set)
    )
    record = late_record(setting, case, stretch(late.law, setting.spec.period))
    found = measure(record, case.scene.robot, setting.spec.skip_initial, setting.spec.metrics_from).flat()
    return LateRun({name: float(str(found[key])) for name, key in METRICS.items()})


def late_record(setting: PreparedExperiment, case: Combination, factor: float) -> Record:
    """Return a run on the compliant arm whose periods are longer than the nominal one by a factor ≥ 1, in the mean."""
    robot, samples, period = case.scene.robot, case.scene.samples, setting.spec.period
    assert isinstance(case.plant, CompliantPlant)
    count = len(samples)
    tick = case.plant.tick
    ends = tick * np.rint(factor * period / tick * np.arange(count + 1, dtype=np.float64))
    law = case.prepare_law(setting.spec)
    arm = case.plant.start(robot, case.scene.start, period, count, setting.spec.seed)
    state = law.initial_state(arm.measured.copy())
    q, measured = (np.empty((count, robot.configuration_size)) for _ in range(2))
    command, taken = np.zeros((count, robot.input_size)), samples.copy()
    taken[:, TIME] = ends[:-1]
    for k, late in enumerate(np.diff(ends) - period):
        q[k], measured[k] = arm.q, arm.measured
        law.step(measured[k], samples[k], k, state, command[k])
        arm.step(command[k])
        arm.wait(max(late, 0.0))
    return Record(
        ends[:-1],
        q,
        measured,
        command,
        robot.fkm(q),
        taken,
        robot.joint_names,
        robot.input_names,
    )


def late_laws(
    cells: Sequence[PublishedCell], settings: Mapping[str, PreparedExperiment], specs: Mapping[str, str]
) -> list[LateLaw]:
    """Return the laws and sets of the cells that did not keep their period; ``specs`` by the experiment's name."""
    found = (
        LateLaw(specs[cell.experiment], cell.law, cell.set)
        for cell in cells
        if cell.metric in _OVER_TIME and _lateness(cell, settings) > _LATE
    )
    return list(dict.fromkeys(found))


def _lateness(cell: PublishedCell, settings: Mapping[str, PreparedExperiment]) -> float:
    return stretch(cell.law, settings[cell.experiment].spec.period)


def own_durations_table(
    cells: Sequence[PublishedCell],
    ours: Results,
    settings: Mapping[str, PreparedExperiment],
    title: str = "",
    runs: Mapping[LateLaw, LateRun] | None = None,
) -> Table | None:
    """Return the cells of laws that did not keep their period, ours over the printed duration; None without any.

    Parameters
    ----------
    cells
        The published ones.
    ours
        Our results, at the nominal period.
    settings
        The specs made ready, by the experiment's name in the published tables.
    title
        Appended to the caption.
    runs
        Of the `late_laws`, at their printed periods; None where there are none.
    """
    rows: list[list[tuple[Column, Cell]]] = []
    late = {(run.law, run.set): each.criteria for run, each in (runs or {}).items()}
    ratio = Column("Ratio", "", ".3g")
    for cell in cells:
        factor = _lateness(cell, settings)
        if cell.metric not in NAMES or factor <= _LATE:
            continue
        mean = ours.mean(cell.law, cell.set, cell.metric, cell.experiment)
        longer = factor * mean if cell.metric in _OVER_TIME else mean
        row: list[tuple[Column, Cell]] = [
            (Column("Law"), cell.law),
            (Column("Set"), cell.set),
            (Column("Metric"), NAMES[cell.metric]),
            (Column("Published"), cell.mean),
            (Column("Ours"), mean),
            (ratio, Ratio(mean / cell.mean)),
            (Column("Period, printed over nominal", "", ".4g"), factor),
            (Column("Ours over that duration"), longer),
            (ratio, Ratio(longer / cell.mean)),
        ]
        if late:
            run = late[cell.law, cell.set][cell.metric]
            row += [(Column("Ours, run at that period"), run), (ratio, Ratio(run / cell.mean))]
        rows.append(row)
    caption = "Over the durations of Table 61, of laws whose commands took longer than their period"
    return Table.of(rows, " · ".join(filter(None, (caption, title)))) if rows else None
