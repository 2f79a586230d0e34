"""The fit of the sag on one published cell, and the second fit of the robust laws' gains on another."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from dqcontrol.experiments.metrics import evaluate
from dqcontrol.experiments.published import second_fit
from dqcontrol.experiments.published.catalogue import spec_path
from dqcontrol.experiments.published.published_numbers import published_cells
from dqcontrol.experiments.run import execute
from dqcontrol.experiments.setting import prepare
from dqcontrol.experiments.tables import Column, Table
from dqcontrol.yaml_file import parse_yaml, read_text

_SPEC, _SET = "spiral", "best"
_TOLERANCE = 1e-4  # relative


def calibrate() -> Table:
    """Fit the sag to the error of K, and the factor of the robust laws to that of HIR, spiral, best gains.

    One run stands for its fifty repeats, whose errors differ by less than the fit's tolerance.
    """
    path = spec_path(_SPEC)
    in_file = parse_yaml(str(path), read_text(path))["plant"]["sag"]
    sag_target, factor_target = _published("K"), _published("HIR")
    sag = _solve(lambda value: _error("K", value, 1.0), sag_target, 0.2, 2.0)
    factor = _solve(lambda value: _error("HIR", sag, value), factor_target, 10.0, 300.0)
    rows = [
        ["α, factor on the gravity sag", "K", sag_target, sag, in_file],
        ["second fit: factor on the gains", "HIR", factor_target, factor, second_fit.FACTOR],
    ]
    columns = [
        Column("Number"),
        Column("fitted on Err of"),
        Column("published"),
        Column("fitted"),
        Column("in the specs"),
    ]
    return Table(columns, rows, "Fits on the spiral, best gains (P16 Table 5.15)")


def _published(law: str) -> float:
    return next(
        cell.mean
        for cell in published_cells(_SPEC)
        if (cell.law, cell.set, cell.metric) == (law, _SET, "error")
    )


def _error(law: str, sag: float, factor: float) -> float:
    data: dict[str, Any] = second_fit.scaled_spec(_SPEC, factor) if law in second_fit.LAWS else _with(law)
    label = law + second_fit.SUFFIX if law in second_fit.LAWS else law
    data["plant"] = data["plant"] | {"sag": sag}
    data |= {"repeats": 1, "sets": {_SET: {label: {}}}}
    setting = prepare(data)
    return evaluate(execute(setting, setting.cases[0])).error.integral


def _with(law: str) -> dict[str, Any]:
    path = spec_path(_SPEC)
    data = parse_yaml(str(path), read_text(path))
    return data | {"laws": {law: data["laws"][law]}}


def _solve(error: Callable[[float], float], target: float, low: float, high: float) -> float:
    """Return where a monotonic error has the target value."""
    from scipy.optimize import root_scalar

    found = root_scalar(
        lambda value: math.log(error(value) / target), bracket=(low, high), method="brentq", rtol=_TOLERANCE
    )
    return float(found.root)
