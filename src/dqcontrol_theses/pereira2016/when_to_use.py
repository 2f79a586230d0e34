"""[P16]'s Table 5.17, "when to use which law", from our numbers of the spiral."""

from __future__ import annotations

from typing import Any

import msgspec

from dqcontrol.laws import Law
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.pereira2016.published_numbers import published_cells
from dqcontrol_theses.pereira2016.verdicts import Evidence
from dqcontrol_theses.pereira2016.verdicts.evidence import LAWS

_BEST = "best"
_NOT_TUNED = {"kind", "null_space", "inverse", "hysteresis"}


def when_to_use(evidence: Evidence) -> Table:
    """Return one row a law: error, repeatability, effort and speed with the best gains, and what has to be tuned."""
    published = {(cell.law, cell.metric): cell for cell in published_cells("spiral") if cell.set == _BEST}
    rows: list[list[Cell]] = []
    for law in LAWS:
        error, effort = published[law, "error"], published[law, "joint_step"]
        mean = evidence.mean(law, _BEST)
        rows.append(
            [
                law,
                error.mean,
                mean,
                100 * (error.deviation or 0.0) / error.mean,
                100 * evidence.ours.deviation(law, _BEST) / mean,
                effort.mean,
                evidence.mean(law, _BEST, "joint_step"),
                evidence.first_peak("hand_speed", law, _BEST),
                *_tuning(evidence, law),
            ]
        )
    columns = [
        Column("Law"),
        Column("Err, P16"),
        Column("Err, ours"),
        Column("repeats to, P16", "%", ".2g"),
        Column("repeats to, ours", "%", ".2g"),
        Column("Eff, P16", "rad s", ".3g"),
        Column("Eff, ours", "rad s", ".3g"),
        Column("first peak of the hand's speed, ours", "m/s", ".2g"),
        Column("numbers to choose"),
        Column("along the trajectory"),
    ]
    return Table(columns, rows, "P16 Table 5.17, when to use which law, from numbers: spiral, best gains")


def _tuning(evidence: Evidence, label: str) -> tuple[int, str]:
    """Return how many numbers a law's parameters are, and whether they change along the trajectory."""
    law: Law = next(
        case.variant.law
        for case in evidence.settings[""].cases
        if (case.names.law, case.names.set) == (label, _BEST)
    )
    default = {field.name: field.default for field in msgspec.structs.fields(law)}
    chosen = {
        key: value
        for key, value in msgspec.to_builtins(law).items()
        if key not in _NOT_TUNED and value is not None and value != default.get(key)
    }
    return sum(map(_count, chosen.values())), "vary" if any(
        isinstance(value, dict) for value in chosen.values()
    ) else "constant"


def _count(value: Any) -> int:
    if isinstance(value, dict):
        return sum(map(_count, value.values()))
    if isinstance(value, list):
        return sum(map(_count, value))
    return int(isinstance(value, int | float))
