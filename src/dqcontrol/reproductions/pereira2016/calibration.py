"""The fit of one number of the plant on one published cell, and on servos the second fit of the robust laws' gains."""

from __future__ import annotations

import math
from collections.abc import Callable

from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import execute, measure
from dqcontrol.measures.tables import Column, Table
from dqcontrol.reproductions.pereira2016 import second_fit
from dqcontrol.reproductions.pereira2016.pereira2016_catalogue import PLANTS, SERVO
from dqcontrol.reproductions.pereira2016.published_numbers import published_cells
from dqcontrol.reproductions.pereira2016.published_specs import FITTED, published_spec

_SPEC, _SET = "spiral", "best"
_TOLERANCE = 1e-4  # relative
_NAMES = {
    "sag": "α, factor on the gravity sag",
    "gravity_factor": "f, share of gravity that the controllers know",
}
_BRACKETS = {"sag": (0.2, 2.0), "gravity_factor": (0.4, 1.1)}


def calibrate(plant: str = PLANTS[0]) -> Table:
    """Fit a plant's one number to the error of K, spiral, best gain; on servos also the robust laws' factor to HIR's.

    In physics the robust laws' loops shake before any factor brings their errors down to the printed ones.

    One run stands for its fifty repeats, whose errors differ by less than the fit's tolerance.
    """
    own = published_spec(_SPEC, plant)["plant"]
    key = FITTED[plant]
    target = _published("K")
    number = _solve(lambda value: _error("K", plant, value, 1.0), target, *_BRACKETS[key])
    rows = [[_NAMES[key], "K", target, number, own[key]]]
    if plant == SERVO:
        target = _published("HIR")
        factor = _solve(lambda value: _error("HIR", plant, number, value), target, 10.0, 300.0)
        rows.append(["second fit: factor on the gains", "HIR", target, factor, second_fit.FACTOR])
    columns = [
        Column("Number"),
        Column("fitted on Err of"),
        Column("published"),
        Column("fitted"),
        Column("in use"),
    ]
    return Table(columns, rows, f"Fits on the spiral, best gains (P16 Table 5.15), plant {plant}")


def _published(law: str) -> float:
    return next(
        cell.mean
        for cell in published_cells(_SPEC)
        if (cell.law, cell.set, cell.metric) == (law, _SET, "error")
    )


def _error(law: str, plant: str, number: float, factor: float) -> float:
    label, data = law, published_spec(_SPEC, plant)
    if law in second_fit.LAWS:
        label, data = law + second_fit.SUFFIX, second_fit.scaled_spec(_SPEC, plant, factor=factor)
    data["plant"] |= {FITTED[plant]: number}
    data |= {"repeats": 1, "laws": {label: data["laws"][label]}, "parameter_sets": {_SET: {label: {}}}}
    setting = prepare(data)
    record = execute(setting, setting.cases[0])
    return measure(
        record, setting.scene.robot, setting.spec.skip_initial, setting.spec.metrics_from
    ).error.integral


def _solve(error: Callable[[float], float], target: float, low: float, high: float) -> float:
    """Return where a monotonic error has the target value."""
    from scipy.optimize import root_scalar

    found = root_scalar(
        lambda value: math.log(error(value) / target), bracket=(low, high), method="brentq", rtol=_TOLERANCE
    )
    return float(found.root)
