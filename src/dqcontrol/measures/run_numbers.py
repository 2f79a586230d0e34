"""The numbers of many runs at once, for searches: those of `dqcontrol.measures.metrics`, and the command's jerk."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK
from dqcontrol.measures.metric_tables import METRIC_COLUMNS
from dqcontrol.measures.run_kernels import NUMBERS, REACHED, measure_kernel
from dqcontrol.references.sample import TIME
from dqcontrol.robots.chain_robot import ChainRobot
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot
from dqcontrol.tables.table_cells import Column

_JERK = Column("Command jerk RMS", "rad/s³ or m/s³")
NUMBER_COLUMNS: dict[str, Column] = {name: METRIC_COLUMNS.get(name, _JERK) for name in NUMBERS}
"""Heading, unit and format of each."""

_LARGEST = [i for i, name in enumerate(NUMBERS) if "peak" in name]
_LEAST = NUMBERS.index("limit_margin")


def of_all_runs(rows: Array) -> Array:
    """Return what several runs come to: of peaks the largest, of `limit_margin` the least, of all others the mean.

    Parameters
    ----------
    rows
        `NUMBERS` of each run, shape (runs, 46).

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.run_numbers import NUMBERS, of_all_runs
    >>> both = of_all_runs(np.array([[1.0] * len(NUMBERS), [2.0] * len(NUMBERS)]))
    >>> [float(both[NUMBERS.index(name)]) for name in ("position.rms", "position.peak", "limit_margin")]
    [1.5, 2.0, 1.0]
    """
    numbers = rows.mean(axis=0)
    numbers[_LARGEST] = rows[:, _LARGEST].max(axis=0)
    numbers[_LEAST] = rows[:, _LEAST].min()
    return numbers


class RunMeasure:
    """What `measure_run` needs to know of a robot and its runs, made ready once.

    Parameters
    ----------
    robot
        Any; of trees what their task is.
    limits
        Of its joints and inputs; commands that count from the measured joints have no limits of speed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.run_numbers import RunMeasure, NUMBERS
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target = dqc.references.SetPoint(arm.fkm(q))
    >>> record = dqc.simulate(arm, target, dqc.laws.Proportional(gain=2.0), dqc.plants.Integrator(), q, 0.01, 1.0)
    >>> numbers = RunMeasure(arm, arm.limits)(record.desired, record.q, record.command, skipped=0)
    >>> round(float(numbers[NUMBERS.index("effort")]), 9) == round(dqc.measures.evaluate(record).effort, 9)
    True
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        is_chain = robot.kernels is ChainRobot.kernels
        self._forward = 0 if is_chain else robot.kernels.forward.pointer
        self._table = robot.table
        self._lower, self._upper = (np.ascontiguousarray(each) for each in (limits.lower, limits.upper))
        self._per_speed = 1.0 / np.asarray(limits.velocity, dtype=np.float64)
        self._work = np.zeros(REACHED + 2 * robot.configuration_size)

    def __call__(self, samples: Array, q: Array, command: Array, skipped: int) -> Array:
        """Return all `NUMBERS` of a run of two samples or more; NaN where one does not exist.

        Parameters
        ----------
        samples
            Desired motion, shape (N, 21).
        q, command
            Configurations, (N, n), rad or m, and inputs, (N, m), rad/s or m/s.
        skipped
            How many samples the settled numbers leave out.
        """
        out = np.full(len(NUMBERS), math.nan)
        status = measure_kernel(
            self._forward,
            np.ascontiguousarray(samples[:, TIME]),
            samples,
            q,
            command,
            self._table,
            self._lower,
            self._upper,
            self._per_speed,
            min(skipped, len(q) - 1),
            0.0,
            self._work,
            out,
        )
        if status != OK:
            out[:] = math.nan
        return out
