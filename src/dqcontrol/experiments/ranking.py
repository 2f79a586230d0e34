"""The points of parameter studies in the order of a number, the best first."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import FileFormatError, ValueRangeError, unknown_name
from dqcontrol.experiments.parameter_units import parameter_unit
from dqcontrol.experiments.results_folder import import_pyarrow
from dqcontrol.experiments.study import ROWS
from dqcontrol.experiments.verdict import verdict_of
from dqcontrol.measures.metric_tables import LARGE_IS_GOOD, number_column
from dqcontrol.measures.repeats import LABELS
from dqcontrol.tables.tables import Cell, Column, PlusMinus, Table, Tabled

if TYPE_CHECKING:
    import pyarrow

BEST_BY = "error.integral"
TOP = 10
_BESIDE = ("position.settled_rms", "orientation.settled_rms", "effort")  # shown too
_PARAMETER = "parameter."
_VERDICT = ["verdict", "failure", "stopped"]


@dataclass(frozen=True)
class Ranking(Tabled):
    """Combinations of labels and parameters, the best first.

    Attributes
    ----------
    by
        Name of the number that says which is best, as in `Metrics.flat`.
    groups
        One row a combination: its labels, and mean, standard deviation and count of numbers over its repeats. Those
        with a run that failed in more than its task, or lacks the number, stand last, without a place.
    placed
        How many have a place.
    each
        The label or parameter for each value of which this is the best, in the order of its values; empty if all are
        there, the best first.
    failures
        How many runs failed, and of the commonest cause how many and the words of one; empty if none did.
    """

    by: str
    groups: pyarrow.Table
    placed: int
    each: str = ""
    failures: str = ""

    def __repr__(self) -> str:
        return f"Ranking(by {self.by}, {self.placed:,} of {len(self.groups):,} points have a place)"

    @property
    def varied(self) -> list[str]:
        """Names of the labels and parameters that differ."""
        names = [name for name in self.groups.column_names if name in LABELS or name.startswith(_PARAMETER)]
        return [name for name in names if len(self.groups[name].unique()) > 1]

    def column(self, name: str) -> NDArray[Any]:
        """Return a label, a parameter or the mean of a number of all combinations that have a place."""
        name = name if name in self.groups.column_names else f"{name}_mean"
        return self.groups[name].slice(0, self.placed).to_numpy()

    def values(self, name: str) -> list[Any]:
        """Return the different values of a label or parameter of all combinations, in their order."""
        return _in_order(self.groups[name].unique().to_pylist())

    def best_of_each(self, key: str) -> Ranking:
        """Return the best combination for each value of a label or parameter, as the best gain for each delay.

        Raises
        ------
        UnknownNameError
            If nothing of that name varies.
        """
        name = _column("key", key, self.groups.column_names)
        found = self.groups[name].slice(0, self.placed).to_pylist()
        firsts = [found.index(value) for value in self.values(name) if value in found]
        return Ranking(self.by, self.groups.take(firsts), len(firsts), name)

    def table(self, top: int = TOP) -> Table:
        """Return the best, one row each, with means and standard deviations where there are repeats."""
        best = self.groups.slice(0, self.placed if self.each else min(top, self.placed)).to_pylist()
        keys = list(dict.fromkeys([self.by, *_BESIDE]))
        parameters = [name for name in self.groups.column_names if self.each and name.startswith(_PARAMETER)]
        varied = [name for name in dict.fromkeys([*self.varied, *parameters]) if name != self.each]
        names = [*(["point"] if "point" in self.groups.column_names else []), *varied]
        names = [self.each, *names] if self.each else names
        places = [] if self.each else [Column("Place")]
        body: list[list[Cell]] = [
            [*([i + 1] if places else []), *(row[name] for name in names), *(_mean(row, key) for key in keys)]
            for i, row in enumerate(best)
        ]
        headings = [
            Column(key := name.removeprefix(_PARAMETER), parameter_unit(key))
            if name.startswith(_PARAMETER)
            else Column(name.capitalize())
            for name in names
        ]
        return Table([*places, *headings, *map(number_column, keys)], body, self._caption(len(best)))

    def _caption(self, shown: int) -> str:
        if self.each:
            return f"best by {self.by} for each {self.each.removeprefix(_PARAMETER)}"
        lost = len(self.groups) - self.placed
        left_out = (
            f"; {lost:,} left out, whose runs hit something, left their limits or ended early" if lost else ""
        )
        return f"best {shown} of {len(self.groups):,} by {self.by}{left_out}"


def _column(field: str, key: str, columns: Sequence[str]) -> str:
    named = [name for name in columns if name in LABELS or name.startswith(_PARAMETER)]
    known = {name.removeprefix(_PARAMETER): name for name in named}
    if key.removeprefix(_PARAMETER) not in known:
        raise unknown_name(field, key, known)
    return known[key.removeprefix(_PARAMETER)]


def _in_order(values: Iterable[Any]) -> list[Any]:
    """Return what values there are, numbers before texts."""
    known = {each for each in values if each is not None}
    return sorted(known, key=lambda value: (isinstance(value, str), value))


def rank(
    folders: Sequence[str | Path], by: str = BEST_BY, where: Mapping[str, float | str] | None = None
) -> Ranking:
    """Return the combinations of robot, law, set, plant and parameters of saved studies, the best first.

    Only the columns that this takes are read; a mean over repeats counts for a combination.

    Parameters
    ----------
    folders
        Of studies with ``runs.parquet``.
    by
        Name of a number as in `Metrics.flat`: smaller is better, but for the margin from the joint limits.
    where
        Only combinations with these values of parameters and labels, as ``{"plant.delay": 0.032, "law": "K"}``.

    Raises
    ------
    UnknownNameError
        If there is no such number, parameter or label.
    ValueRangeError
        If no combination has such a value.
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
    for key, value in (where or {}).items():
        rows = _chosen(arrow, rows, key, value)
    failures = _failures(arrow, rows)
    # How near a run came to its task is what most numbers say; one that hit something is no better for being near.
    fair = arrow.compute.is_in(rows["failure"], value_set=arrow.array(["", "task"]))
    rows = rows.drop_columns(_VERDICT).append_column("failed", arrow.compute.invert(fair))
    keys = [name for name in rows.column_names if name not in (*numbers, "failed")]
    spread = arrow.compute.VarianceOptions(ddof=1)
    sums = [(name, *kind) for name in numbers for kind in (("mean",), ("stddev", spread), ("count",))]
    groups = rows.group_by(keys, use_threads=False).aggregate([*sums, ("failed", "any"), ([], "count_all")])
    means = np.array(groups[f"{by}_mean"].to_pylist(), dtype=float)
    whole = np.array(groups[f"{by}_count"]) == np.array(groups["count_all"])
    placed = whole & ~np.array(groups["failed_any"], dtype=bool)
    order = np.argsort(np.where(placed, -means if by in LARGE_IS_GOOD else means, np.inf), kind="stable")
    return Ranking(by, groups.take(arrow.array(order)), int(placed.sum()), failures=failures)


def _failures(arrow: Any, rows: pyarrow.Table) -> str:
    """Return what `Ranking.failures` says of rows; causes are alike in what stands before their numbers."""
    failed = rows.filter(arrow.compute.fill_null(arrow.compute.not_equal(rows["failure"], ""), True))
    words = [verdict_of(row).words for row in failed.select(_VERDICT).to_pylist()]
    if not words:
        return ""
    causes = [re.split(":| at ", each)[0] for each in words]
    ((cause, count),) = Counter(causes).most_common(1)
    first = failed.slice(causes.index(cause), 1).to_pylist()[0]
    place = [f"point {first['point']}"] if "point" in first else []
    place += [first[label] for label in LABELS if first.get(label)]
    return (
        f"{len(words):,} of {len(rows):,} runs failed, {count:,} of them like {', '.join(place)}: "
        f"{words[causes.index(cause)]}"
    )


def _read(arrow: Any, folder: Path, numbers: Sequence[str], *, several: bool) -> pyarrow.Table:
    path = folder / ROWS
    if not path.is_file():
        raise FileFormatError(f"{folder}: is not the folder of a study with metrics ({ROWS} is missing)")
    try:
        names = arrow.parquet.read_schema(path).names
        labels = [n for n in names if n in LABELS or n == "point" or n.startswith(_PARAMETER)]
        rows = arrow.parquet.read_table(path, columns=[*labels, *_VERDICT, *numbers])
    except (OSError, arrow.ArrowException) as error:
        raise FileFormatError(f"{path}: cannot be read: {' '.join(str(error).split())[:200]}") from None
    return rows.add_column(0, "study", arrow.repeat(folder.name, len(rows))) if several else rows


def _chosen(arrow: Any, rows: pyarrow.Table, key: str, value: float | str) -> pyarrow.Table:
    """Return those rows in which a parameter or label has a value."""
    name = _column("where", key, rows.column_names)
    there = rows[name].to_pylist()
    if isinstance(value, str):
        mask = [each == value for each in there]
    else:
        mask = [isinstance(each, float) and math.isclose(each, value, rel_tol=1e-9) for each in there]
    if not any(mask):
        known = _in_order(there)
        some = ", ".join(f"{each:g}" if isinstance(each, float) else str(each) for each in known[:12])
        raise ValueRangeError(
            f"where: no run has {key} = {value} (there are: {some}{', …' * (len(known) > 12)})"
        )
    return rows.filter(arrow.array(mask))


def _mean(row: dict[str, Any], key: str) -> Cell:
    mean = row[f"{key}_mean"]
    return PlusMinus(mean, row[f"{key}_stddev"]) if row["count_all"] > 1 else mean
