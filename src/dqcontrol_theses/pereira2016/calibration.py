"""The fits of the plants' numbers, each on one published cell."""

from __future__ import annotations

import math
from typing import NamedTuple

from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016.pereira2016_catalogue import (
    PHYSICS,
    PLANTS,
    SERVO,
    published_spec,
    run_once,
)
from dqcontrol_theses.pereira2016.published_numbers import FIXED, published_mean
from dqcontrol_theses.results import NAMES

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


_ALPHA = "α, factor on the gravity sag"
_SHARE, _SHAKING = "f, share of gravity that the controllers know", "shaking of the base, m/s²/√Hz"
_STIFFNESS, _CIRCLE = "stiffness in appendix C", "meka circle"
FITS: dict[str, tuple[FittedNumber, ...]] = {
    SERVO: (FittedNumber("sag", _ALPHA, "spiral", "spiral", "", "best", "error", (0.2, 2.0)),),
    PHYSICS: (
        FittedNumber("gravity_factor", _SHARE, "spiral", "spiral", "", "best", "error", (0.4, 1.1)),
        FittedNumber("base_shaking", _SHAKING, "circle", "circle", "", FIXED, "hand_speed", (0.01, 0.06)),
        FittedNumber(
            "stiffness", _STIFFNESS, "circle-and-square", "meka-circle", _CIRCLE, FIXED, "error", (0.5, 1.0)
        ),
    ),
}


def calibrate(plant: str = PLANTS[0]) -> Table:
    """Fit each number of a plant, the others as they are in use; one run stands for all repeats of its cell."""
    from scipy.optimize import root_scalar

    def row(fit: FittedNumber) -> list[tuple[Column, Cell]]:
        target = published_mean(fit.reproduction, _LAW, fit.set, fit.metric, fit.experiment)

        def distance(value: float) -> float:  # monotonic
            data = published_spec(fit.spec, plant)
            data["plant"] |= {fit.key: value}
            found = run_once(data, _LAW, fit.set).metrics
            return math.log(getattr(found, fit.metric).integral / target)

        solution = root_scalar(distance, bracket=fit.bracket, method="brentq", rtol=_TOLERANCE)
        where = fit.experiment or fit.spec + ("" if fit.set == FIXED else f", {fit.set}")
        return [
            (Column("Number"), fit.about),
            (Column("fitted on"), f"{NAMES[fit.metric]} of {_LAW}, {where}"),
            (Column("published"), target),
            (Column("fitted", "", ".3g"), float(solution.root)),
            (Column("in use", "", ".3g"), published_spec(fit.spec, plant)["plant"][fit.key]),
        ]

    return Table.of(map(row, FITS[plant]), f"Fits on single published cells, plant {plant}")
