"""The fits of the plants' numbers, each on one published cell."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from dqcontrol.experiments import execute, measure, prepare
from dqcontrol.measures import Metrics
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS, PLANTS, SERVO
from dqcontrol_theses.pereira2016.published_numbers import published_cells
from dqcontrol_theses.pereira2016.published_specs import published_spec
from dqcontrol_theses.printed_comparison import NAMES

_LAW = "K"
_TOLERANCE = 1e-4  # relative


class FittedNumber(NamedTuple):
    """A number of a plant and the published cell of law K that it is fitted on.

    Attributes
    ----------
    key
        Of the plant's spec.
    about
        What it is.
    reproduction, spec, experiment, set, metric
        The cell, and the spec that it is run by.
    bracket
        Between which values the number lies.
    """

    key: str
    about: str
    reproduction: str
    spec: str
    experiment: str
    set: str
    metric: str
    bracket: tuple[float, float]


FITS: dict[str, tuple[FittedNumber, ...]] = {
    SERVO: (
        FittedNumber(
            "sag", "α, factor on the gravity sag", "spiral", "spiral", "", "best", "error", (0.2, 2.0)
        ),
    ),
    PHYSICS: (
        FittedNumber(
            "gravity_factor",
            "f, share of gravity that the controllers know",
            "spiral",
            "spiral",
            "",
            "best",
            "error",
            (0.4, 1.1),
        ),
        FittedNumber(
            "base_shaking",
            "shaking of the base, m/s²/√Hz",
            "circle",
            "circle",
            "",
            "fixed",
            "hand_speed",
            (0.01, 0.06),
        ),
        FittedNumber(
            "stiffness",
            "stiffness in appendix C",
            "circle-and-square",
            "meka-circle",
            "meka circle",
            "fixed",
            "error",
            (0.5, 1.0),
        ),
    ),
}


def calibrate(plant: str = PLANTS[0]) -> Table:
    """Fit each number of a plant, the others as they are in use; one run stands for all repeats of its cell."""
    rows: list[list[Cell]] = []
    for fit in FITS[plant]:
        target = _published(fit)
        number = _solve(lambda value, fit=fit: _found(plant, fit, value), target, *fit.bracket)
        where = fit.experiment or fit.spec + ("" if fit.set == "fixed" else f", {fit.set}")
        cell = f"{NAMES[fit.metric]} of {_LAW}, {where}"
        rows.append([fit.about, cell, target, number, published_spec(fit.spec, plant)["plant"][fit.key]])
    columns = [
        Column("Number"),
        Column("fitted on"),
        Column("published"),
        Column("fitted", "", ".3g"),
        Column("in use", "", ".3g"),
    ]
    return Table(columns, rows, f"Fits on single published cells, plant {plant}")


def _published(fit: FittedNumber) -> float:
    wanted = (_LAW, "" if fit.set == "fixed" else fit.set, fit.metric, fit.experiment)
    return next(
        cell.mean
        for cell in published_cells(fit.reproduction)
        if (cell.law, cell.set, cell.metric, cell.experiment) == wanted
    )


def _found(plant: str, fit: FittedNumber, number: float) -> float:
    data: dict[str, Any] = published_spec(fit.spec, plant)
    data["plant"] |= {fit.key: number}
    law = data["laws"][_LAW] | data.pop("parameter_sets")[fit.set][_LAW]
    setting = prepare(data | {"repeats": 1, "laws": {_LAW: law}})
    record = execute(setting, setting.cases[0])
    found: Metrics = measure(
        record, setting.scene.robot, setting.spec.skip_initial, setting.spec.metrics_from
    )
    return float(getattr(found, fit.metric).integral)


def _solve(found: Callable[[float], float], target: float, low: float, high: float) -> float:
    """Return where something monotonic has the target value."""
    from scipy.optimize import root_scalar

    solution = root_scalar(
        lambda value: math.log(found(value) / target), bracket=(low, high), method="brentq", rtol=_TOLERANCE
    )
    return float(solution.root)
