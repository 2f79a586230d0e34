"""The points of parameter studies in the order of a number, the best first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import FileFormatError
from dqcontrol.experiments.parameter_units import parameter_unit
from dqcontrol.experiments.row_file import import_pyarrow
from dqcontrol.experiments.study import ROWS
from dqcontrol.loop.record import FAILURES
from dqcontrol.measures.metric_tables import number_column
from dqcontrol.measures.repeats import LABELS
from dqcontrol.measures.table_cells import Cell, Column, PlusMinus
from dqcontrol.measures.tables import Table

if TYPE_CHECKING:
    import pyarrow

BEST_BY = "error.integral"
TOP = 10
_BESIDE = ("position.settled_rms", "orientation.settled_rms", "effort")  # shown too
_LARGE_IS_GOOD = {"limit_margin"}
_PARAMETER = "parameter."


@dataclass(frozen=True)
class Ranking:
    """Combinations of labels and parameters, the best first.

    Attributes
    ----------
    by
        Name of the number that says which is best, as in `Metrics.flat`.
    groups
        One row a combination: its labels, and mean, standard deviation and count of numbers over its repeats. Those
        with a run that failed, or lacks the number, stand last, without a place.
    placed
        How many have a place.
    """

    by: str
    groups: pyarrow.Table
    placed: int

    @property
    def varied(self) -> list[str]:
        """Names of the labels and parameters that differ."""
        names = [name for name in self.groups.column_names if name in LABELS or name.startswith(_PARAMETER)]
        return [name for name in names if len(self.groups[name].unique()) > 1]

    def column(self, name: str) -> NDArray[Any]:
        """Return a label, a parameter or the mean of a number of all combinations that have a place."""
        name = name if name in self.groups.column_names else f"{name}_mean"
        return self.groups[name].slice(0, self.placed).to_numpy()

    def table(self, top: int = TOP) -> Table:
        """Return the best, one row each, with means and standard deviations where there are repeats."""
        best = self.groups.slice(0, min(top, self.placed)).to_pylist()
        keys = list(dict.fromkeys([self.by, *_BESIDE]))
        names = [*(["point"] if "point" in self.groups.column_names else []), *self.varied]
        body: list[list[Cell]] = [
            [i + 1, *(row[name] for name in names), *(_mean(row, key) for key in keys)]
            for i, row in enumerate(best)
        ]
        headings = [
            Column(key := name.removeprefix(_PARAMETER), parameter_unit(key))
            if name.startswith(_PARAMETER)
            else Column(name.capitalize())
            for name in names
        ]
        lost = len(self.groups) - self.placed
        left_out = f"; {lost:,} with failed runs left out" if lost else ""
        caption = f"best {len(best)} of {len(self.groups):,} by {self.by}{left_out}"
        return Table([Column("Place"), *headings, *map(number_column, keys)], body, caption)


def rank(folders: Sequence[str | Path], by: str = BEST_BY) -> Ranking:
    """Return the combinations of robot, law, set, plant and parameters of saved studies, the best first.

    Only the columns that this takes are read; a mean over repeats counts for a combination.

    Parameters
    ----------
    folders
        Of studies with ``runs.parquet``.
    by
        Name of a number as in `Metrics.flat`: smaller is better, but for the margin from the joint limits.

    Raises
    ------
    UnknownNameError
        If there is no such number.
    FileFormatError
        If a folder holds no such study.
    MissingExtraError
        If pyarrow is not installed.
    """
    number_column(by)
    arrow = import_pyarrow()
    numbers = list(dict.fromkeys([by, *_BESIDE]))
    parts = [_read(arrow, Path(folder), numbers, several=len(folders) > 1) for folder in folders]
    rows = arrow.concat_tables(parts, promote_options="permissive")
    keys = [name for name in rows.column_names if name not in (*numbers, "failed")]
    spread = arrow.compute.VarianceOptions(ddof=1)
    sums = [(name, *kind) for name in numbers for kind in (("mean",), ("stddev", spread), ("count",))]
    groups = rows.group_by(keys, use_threads=False).aggregate([*sums, ("failed", "any"), ([], "count_all")])
    means = np.array(groups[f"{by}_mean"].to_pylist(), dtype=float)
    whole = np.array(groups[f"{by}_count"]) == np.array(groups["count_all"])
    placed = whole & ~np.array(groups["failed_any"], dtype=bool)
    order = np.argsort(np.where(placed, -means if by in _LARGE_IS_GOOD else means, np.inf), kind="stable")
    return Ranking(by, groups.take(arrow.array(order)), int(placed.sum()))


def _read(arrow: Any, folder: Path, numbers: Sequence[str], *, several: bool) -> pyarrow.Table:
    path = folder / ROWS
    if not path.is_file():
        raise FileFormatError(f"{folder}: is not the folder of a study with metrics ({ROWS} is missing)")
    try:
        names = arrow.parquet.read_schema(path).names
        labels = [n for n in names if n in LABELS or n == "point" or n.startswith(_PARAMETER)]
        rows = arrow.parquet.read_table(path, columns=[*labels, "stopped", *numbers])
    except (OSError, arrow.ArrowException) as error:
        raise FileFormatError(f"{path}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    starts = [arrow.compute.starts_with(rows["stopped"], pattern=pattern) for pattern in FAILURES]
    rows = rows.drop_columns(["stopped"]).append_column("failed", reduce(arrow.compute.or_, starts))
    return rows.add_column(0, "study", arrow.repeat(folder.name, len(rows))) if several else rows


def _mean(row: dict[str, Any], key: str) -> Cell:
    mean = row[f"{key}_mean"]
    return PlusMinus(mean, row[f"{key}_stddev"]) if row["count_all"] > 1 else mean
