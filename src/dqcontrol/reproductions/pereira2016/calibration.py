"""The fit of one number of the plant on one published cell."""

from __future__ import annotations

import math
from collections.abc import Callable

from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import execute, measure
from dqcontrol.measures.tables import Cell, Column, Table
from dqcontrol.reproductions.pereira2016.pereira2016_catalogue import PLANTS
from dqcontrol.reproductions.pereira2016.published_numbers import published_cells
from dqcontrol.reproductions.pereira2016.published_specs import FITTED, published_spec

_SPEC, _LAW, _SET = "spiral", "K", "best"
_TOLERANCE = 1e-4  # relative
_NAMES = {
    "sag": "α, factor on the gravity sag",
    "gravity_factor": "f, share of gravity that the controllers know",
}
_BRACKETS = {"sag": (0.2, 2.0), "gravity_factor": (0.4, 1.1)}


def calibrate(plant: str = PLANTS[0]) -> Table:
    """Fit a plant's one number; one run stands for its fifty repeats, which differ by less than the tolerance."""
    own = published_spec(_SPEC, plant)["plant"]
    key, target = FITTED[plant], _published(_LAW)
    number = _solve(lambda value: _error(plant, value), target, *_BRACKETS[key])
    rows: list[list[Cell]] = [[_NAMES[key], _LAW, target, number, own[key]]]
    columns = [
        Column("Number"),
        Column("fitted on Err of"),
        Column("published"),
        Column("fitted"),
        Column("in use"),
    ]
    return Table(columns, rows, f"Fit on the spiral, best gains (P16 Table 5.15), plant {plant}")


def _published(law: str) -> float:
    return next(
        cell.mean
        for cell in published_cells(_SPEC)
        if (cell.law, cell.set, cell.metric) == (law, _SET, "error")
    )


def _error(plant: str, number: float) -> float:
    data = published_spec(_SPEC, plant)
    data["plant"] |= {FITTED[plant]: number}
    data |= {"repeats": 1, "laws": {_LAW: data["laws"][_LAW]}, "parameter_sets": {_SET: {_LAW: {}}}}
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
