"""Laws that did not keep their period on the robot, run at the mean period that Table 61 prints of them.

Their program multiplied commands by the nominal period all the same, as far as the numbers tell, and took the samples
of its reference and of its gains one by one, however late. So a run here is as many samples, most of a nominal period
and some one tick of the joint controllers longer, so that their mean is the printed one. It is out of step with the
exchange of states at 100 Hz, as the robot was. No number is fitted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.experiments import Combination, PreparedExperiment, measure, prepare
from dqcontrol.loop import Record
from dqcontrol.plants import CompliantPlant
from dqcontrol.references import TIME
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS
from dqcontrol_theses.pereira2016.published_numbers import published_cells
from dqcontrol_theses.pereira2016.published_specs import published_spec
from dqcontrol_theses.results import METRICS


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
    command = np.zeros((count, robot.input_size))
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
        _at(samples, ends[:-1]),
        robot.joint_names,
        robot.input_names,
    )


def _at(samples: Array, times: Array) -> Array:
    """Return samples that are taken at other times."""
    taken = samples.copy()
    taken[:, TIME] = times
    return taken
