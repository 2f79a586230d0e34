"""Tables of metrics: one run in full, several runs side by side."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK
from dqcontrol.errors import unknown_name
from dqcontrol.measures.metrics import Metrics
from dqcontrol.measures.run_numbers import NUMBERS, REACHED, TaskNumbers, measure_kernel
from dqcontrol.references.sample import TIME
from dqcontrol.robots.chain_robot import ChainRobot
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot
from dqcontrol.tables.tables import Cell, Column, Table

_SIGNALS = {  # title, unit, unit of the integral; in [P16]: Err., control signal, Eff., L.Vel., L.Acc.
    "error": ("Pose error", "", "s"),
    "settled_error": ("Pose error, settled", "", "s"),
    "control": ("Control", "rad/s or m/s", "rad or m"),
    "joint_step": ("Joint step", "rad or m", "rad s or m s"),
    "hand_speed": ("Hand speed", "m/s", "m"),
    "hand_acceleration": ("Hand acceleration", "m/s²", "m/s"),
}
_DEVIATIONS = {"position": ("Position error", "mm"), "orientation": ("Orientation error", "°")}
_PARTS = {
    "mean": "mean",
    "rms": "RMS",
    "peak": "peak",
    "final": "final",
    "settled_mean": "mean, settled",
    "settled_rms": "RMS, settled",
    "settled_peak": "peak, settled",
}

METRIC_COLUMNS: dict[str, Column] = {
    "verdict": Column("Verdict"),
    "failure": Column("Failure"),
    "duration": Column("Duration", "s"),
    "samples": Column("Samples"),
    **{
        f"{key}.{part}": Column(f"{title} {part_title}", unit)
        for key, (title, unit) in _DEVIATIONS.items()
        for part, part_title in _PARTS.items()
    },
    "final_error": Column("Pose error final"),
    **{
        f"{key}.{part}": Column(f"{title} {part_title}", integral_unit if part == "integral" else unit)
        for key, (title, unit, integral_unit) in _SIGNALS.items()
        for part, part_title in (("integral", "integral"), ("mean", "mean"), ("rms", "RMS"), ("peak", "peak"))
    },
    "joint_path_length": Column("Joint path length", "rad or m"),
    "effort": Column("Effort √∫|u|²", "rad/√s or m/√s"),
    "settling_time": Column("Settling time", "s"),
    "settling_band": Column("Settling band"),
    "position_overshoot": Column("Position overshoot"),
    "orientation_overshoot": Column("Orientation overshoot"),
    "limit_margin": Column("Limit margin", "rad or m"),
    "limit_joint": Column("Nearest to limit"),
    "peak_contact": Column("Contact force peak", "N"),
    "recovery_time": Column("Recovery time", "s"),
    "peak_velocity_share": Column("Velocity peak of its limit"),
    "saturation": Column("Samples at velocity limits"),
    "outside_range": Column("Outside the range of J"),
}
"""Heading, unit and format of every number in `Metrics.flat`."""

TEXTS = ("verdict", "failure", "limit_joint")
"""Those that are words."""

LARGE_IS_GOOD = ("limit_margin",)
"""Those that are better the larger they are."""

PUBLISHED = tuple(f"{key}.integral" for key in _SIGNALS if key != "settled_error")
"""The five integrals that [P16 5.3] tabulates."""

SHORT = (
    "error.integral",
    "position.rms",
    "position.peak",
    "orientation.rms",
    "orientation.peak",
    "control.integral",
    "control.peak",
    "joint_path_length",
    "effort",
    "settling_time",
)
"""What a comparison shows unless told otherwise."""


def summary_table(metrics: Metrics, title: str = "") -> Table:
    """Return all numbers of one run, one a row; its verdict stands for itself, and takes more than a line.

    Examples
    --------
    >>> print(summary_table(run.metrics).markdown())  # doctest: +SKIP
    """
    flat = metrics.flat()
    rows: list[list[Cell]] = [
        [column.title, column.show(flat[key]), column.unit]
        for key, column in METRIC_COLUMNS.items()
        if key != "verdict" and flat[key] not in (None, "")
    ]
    for name, key, (title, unit) in _of_tasks(metrics):
        for part, part_title in _PARTS.items():
            shown = METRIC_COLUMNS[f"{key}.{part}"].show(flat[f"tasks.{name}.{key}.{part}"])
            rows.append([f"{title} {part_title}, {_plain(name)}", shown, unit])
    return Table([Column("Metric"), Column("Value"), Column("Unit")], rows, title)


def fitting_unit(text: str, unit: str) -> str:
    """Return of a unit with two forms, as ``rad/s or m/s``, the one of inputs that move ``"rad"`` or ``"m"``.

    Examples
    --------
    >>> fitting_unit("rad/s or m/s", "m"), fitting_unit("rad/s or m/s", "rad or m"), fitting_unit("mm", "m")
    ('m/s', 'rad/s or m/s', 'mm')
    """
    both = text.split(" or ")
    return text if " or " in unit or len(both) == 1 else both[unit == "m"]


def metrics_tables(metrics: Metrics, unit: str = "rad or m") -> list[Table]:
    """Return the numbers of one run as its report shows them: tables of deviations, of signals, and of all others.

    ``unit`` is that of what the inputs move: ``"rad"``, ``"m"``, or both.
    """
    flat, fitting = metrics.flat(), partial(fitting_unit, unit=unit)
    first = [Column("Signal"), Column("Unit")]
    deviations: list[list[Cell]] = [
        [title, shown, *(flat[f"{key}.{part}"] for part in _PARTS)]
        for key, (title, shown) in _DEVIATIONS.items()
    ]
    deviations += [
        [f"{title}, {_plain(name)}", shown, *(flat[f"tasks.{name}.{key}.{part}"] for part in _PARTS)]
        for name, key, (title, shown) in _of_tasks(metrics)
    ]
    parts = {**{part: _PARTS[part] for part in ("mean", "rms", "peak")}, "integral": "integral"}
    signals: list[list[Cell]] = [
        [title, fitting(shown), *(flat[f"{key}.{part}"] for part in parts), fitting(whole)]
        for key, (title, shown, whole) in _SIGNALS.items()
    ]
    others: list[list[Cell]] = [
        [column.title, column.show(flat[key]), fitting(column.unit)]
        for key, column in METRIC_COLUMNS.items()
        if "." not in key and flat[key] not in (None, "")
    ]
    columns, title = [*first, *map(Column, _PARTS.values())], "How far the hand was from its desired pose"
    return [
        Table(columns, deviations, title),
        Table([*first, *map(Column, parts.values()), Column("its unit")], signals, "Norms of signals"),
        Table([Column("Number"), Column("Value"), Column("Unit")], others, "Further numbers"),
    ]


def _of_tasks(metrics: Metrics) -> list[tuple[str, str, tuple[str, str]]]:
    """Return name, deviation, and its title and unit, of each further task."""
    return [(name, key, shown) for name in metrics.tasks for key, shown in _DEVIATIONS.items()]


def _plain(name: str) -> str:
    return name.replace("_", " ")


def comparison_table(runs: Mapping[str, Metrics], keys: Sequence[str] = SHORT, title: str = "") -> Table:
    """Return one row a run.

    Parameters
    ----------
    runs
        Metrics by the label of the run.
    keys
        Names as in `Metrics.flat`, as ``"error.integral"``.
    title
        Caption.

    Raises
    ------
    UnknownNameError
        If a key does not exist.

    Examples
    --------
    >>> print(comparison_table({"K": k.metrics, "LQR": lqr.metrics}).latex())  # doctest: +SKIP
    """
    columns = [metric_column(key) for key in keys]
    rows = [[label, *(metrics.flat()[key] for key in keys)] for label, metrics in runs.items()]
    return Table([Column("Run"), *columns], rows, title)


def metric_column(key: str) -> Column:
    """Return the column of a metric, or raise `UnknownNameError`."""
    if key not in METRIC_COLUMNS:
        raise unknown_name("keys", key, METRIC_COLUMNS)
    return METRIC_COLUMNS[key]


def number_column(key: str) -> Column:
    """Return the column of a metric that is a number, or raise `UnknownNameError`."""
    if key in TEXTS:
        raise unknown_name("keys", key, [name for name in METRIC_COLUMNS if name not in TEXTS])
    return metric_column(key)


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
    >>> from dqcontrol.measures.metric_tables import NUMBERS, of_all_runs
    >>> both = of_all_runs(np.array([[1.0] * len(NUMBERS), [2.0] * len(NUMBERS)]))
    >>> [float(both[NUMBERS.index(name)]) for name in ("position.rms", "position.peak", "limit_margin")]
    [1.5, 2.0, 1.0]
    """
    numbers = rows.mean(axis=0)
    numbers[_LARGEST] = rows[:, _LARGEST].max(axis=0)
    numbers[_LEAST] = rows[:, _LEAST].min()
    return numbers


class RunMeasure:
    """What `measure_kernel` needs to know of a robot and its runs, made ready once.

    Parameters
    ----------
    robot
        Any; of trees what their task is.
    limits
        Of its joints and inputs; commands that count from the measured joints have no limits of speed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.metric_tables import RunMeasure, NUMBERS
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
        out = np.full(len(NUMBERS) + len(TaskNumbers._fields), math.nan)
        time, skipped = np.ascontiguousarray(samples[:, TIME]), min(skipped, len(q) - 1)
        ends = self._table, self._lower, self._upper, self._per_speed
        status = measure_kernel(
            self._forward, time, samples, q, command, *ends, skipped, 0, 0.0, self._work, out
        )
        if status != OK:
            out[:] = math.nan
        return out[: len(NUMBERS)]
