"""Results of a reproduction, by the names of the published tables, and beside their cells: published | ours | ratio."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.loop import has_failed
from dqcontrol.tables import Cell, Column, Ratio, Table
from dqcontrol_theses.printed import PublishedCell

METRICS = {  # of the published tables: Err., θ̇, Eff., L.Vel., L.Acc. [P16 5.2]
    "error": "error.integral",
    "control": "control.integral",
    "joint_step": "joint_step.integral",
    "hand_speed": "hand_speed.integral",
    "hand_acceleration": "hand_acceleration.integral",
}
NAMES = {
    "error": "Err",
    "control": "θ̇ [rad]",
    "joint_step": "Eff [rad s]",
    "hand_speed": "L.Vel [m]",
    "hand_acceleration": "L.Acc [m/s]",
}

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Results:
    """The rows of one reproduction's studies.

    Attributes
    ----------
    rows
        By the experiment's name in the published tables.
    error
        The metric that stands for the published error norm.
    control_unit
        What the published control signal counts in: 1, or a period in s where the source printed T u for u.
    """

    rows: Mapping[str, Sequence[Row]]
    error: str = "error.integral"
    control_unit: float = 1.0
    _groups: dict[tuple[str, str, str], list[Row]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        for experiment, rows in self.rows.items():
            for row in rows:
                self._groups.setdefault((experiment, row["law"], row["set"]), []).append(row)

    def sets(self, law: str, experiment: str = "") -> list[str]:
        """Return the parameter sets that a law ran with."""
        return [group[2] for group in self._groups if group[:2] == (experiment, law)]

    def group(self, law: str, parameters: str = "", experiment: str = "") -> list[Row]:
        """Return the repeats of a law with one set; the empty name stands for its only set."""
        names = self.sets(law, experiment)
        if not parameters and len(names) == 1:
            parameters = names[0]
        return self._groups.get((experiment, law, parameters), [])

    def values(
        self, law: str, parameters: str = "", metric: str = "error", experiment: str = ""
    ) -> NDArray[np.float64]:
        """Return a metric of all repeats that did not fail; published names or those of `Metrics.flat`."""
        key = self.error if metric == "error" else METRICS.get(metric, metric)
        rows = self.group(law, parameters, experiment)
        kept = [row[key] for row in rows if not has_failed(str(row["stopped"]))]
        unit = self.control_unit if metric == "control" else 1.0
        return unit * np.array([value for value in kept if value is not None], dtype=np.float64)

    def mean(self, law: str, parameters: str = "", metric: str = "error", experiment: str = "") -> float:
        """Return the mean over the repeats; NaN if there are none."""
        values = self.values(law, parameters, metric, experiment)
        return float(values.mean()) if len(values) else math.nan

    def deviation(self, law: str, parameters: str = "", metric: str = "error", experiment: str = "") -> float:
        """Return the sample standard deviation; NaN for fewer than two repeats."""
        values = self.values(law, parameters, metric, experiment)
        return float(values.std(ddof=1)) if len(values) > 1 else math.nan


def comparison_tables(
    cells: Sequence[PublishedCell],
    results: Results,
    source: str,
    *,
    suffixes: Sequence[str] = ("",),
    title: str = "",
) -> list[Table]:
    """Return one table for each published table and experiment.

    Parameters
    ----------
    cells
        The published ones.
    results
        Ours.
    source
        Its short name, as ``"P16"``; the captions begin with it.
    suffixes
        Appended to the law's label to find it in ours: the law as printed, and those that stand beside it.
    title
        Appended to the captions.
    """
    tables = []
    groups: dict[tuple[str, str], list[PublishedCell]] = {}
    for cell in cells:
        groups.setdefault((cell.table, cell.experiment), []).append(cell)
    for (name, experiment), group in groups.items():
        rows = [
            _row(cell, results, suffix)
            for cell in group
            for suffix in suffixes
            if results.group(cell.law + suffix, cell.set, experiment)
        ]
        if rows:
            caption = " · ".join(part for part in (f"{source} Table {name}", experiment, title) if part)
            tables.append(Table.of(rows, caption))
    return tables


def command_table(
    cells: Sequence[PublishedCell],
    results: Results,
    settings: Mapping[str, PreparedExperiment],
    title: str = "",
    *,
    suffixes: Sequence[str] = ("",),
) -> Table:
    """Return the mean of T |u|, one row a law and set: on an arm that gives way at each sample, by how much it does.

    Parameters
    ----------
    cells
        The published ones; those of the control signal count.
    results
        Ours.
    settings
        The specs made ready, by the experiment's name in the published tables.
    title
        Appended to the caption.
    suffixes
        As for `comparison_tables`.
    """
    rows: list[list[tuple[Column, Cell]]] = []
    for cell in cells:
        if cell.metric == "control":
            setting = settings[cell.experiment]
            unit = setting.spec.period / (results.control_unit * setting.scene.samples[-1, -1])
            for law in (cell.law + suffix for suffix in suffixes):
                if results.group(law, cell.set, cell.experiment):
                    ours = results.mean(law, cell.set, cell.metric, cell.experiment)
                    rows.append(
                        [
                            (Column("Experiment"), cell.experiment),
                            (Column("Law"), law),
                            (Column("Set"), cell.set),
                            (Column("Published", "rad", ".3f"), unit * cell.mean),
                            (Column("Ours", "rad", ".3f"), unit * ours),
                        ]
                    )
    return Table.of(rows, " · ".join(filter(None, ("Mean of T |u|", title))))


def _row(cell: PublishedCell, results: Results, suffix: str) -> list[tuple[Column, Cell]]:
    where = (cell.law + suffix, cell.set, cell.metric, cell.experiment)
    ours = results.mean(*where)
    return [
        (Column("Law"), cell.law + suffix),
        (Column("Set"), cell.set),
        (Column("Metric"), NAMES.get(cell.metric, cell.metric)),
        (Column("Published"), cell.mean),
        (Column("±", "", ".2g"), cell.deviation),
        (Column("Ours"), ours),
        (Column("±", "", ".2g"), results.deviation(*where)),
        (Column("Ratio", "", ".3g"), Ratio(ours / cell.mean)),
    ]
