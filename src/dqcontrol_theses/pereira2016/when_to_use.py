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

    def row(law: str) -> list[tuple[Column, Cell]]:
        error, effort = published[law, "error"], published[law, "joint_step"]
        mean, (count, kind) = evidence.mean(law, _BEST), _tuning(evidence, law)
        ours = evidence.ours.deviation(law, _BEST)
        return [
            (Column("Law"), law),
            (Column("Err, P16"), error.mean),
            (Column("Err, ours"), mean),
            (Column("repeats to, P16", "%", ".2g"), 100 * (error.deviation or 0.0) / error.mean),
            (Column("repeats to, ours", "%", ".2g"), 100 * ours / mean),
            (Column("Eff, P16", "rad s", ".3g"), effort.mean),
            (Column("Eff, ours", "rad s", ".3g"), evidence.mean(law, _BEST, "joint_step")),
            (
                Column("first peak of the hand's speed, ours", "m/s", ".2g"),
                evidence.first_peak("hand_speed", law, _BEST),
            ),
            (Column("numbers to choose"), count),
            (Column("along the trajectory"), kind),
        ]

    return Table.of(map(row, LAWS), "P16 Table 5.17, when to use which law, from numbers: spiral, best gains")


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
    varies = any(isinstance(value, dict) for value in chosen.values())
    return _count(list(chosen.values())), "vary" if varies else "constant"


def _count(value: Any) -> int:
    if isinstance(value, dict | list):
        return sum(map(_count, value.values() if isinstance(value, dict) else value))
    return int(isinstance(value, int | float))
