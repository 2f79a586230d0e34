"""Published | ours | ratio, for every cell of the published tables."""

from __future__ import annotations

from collections.abc import Sequence

from dqcontrol.experiments.published.published_numbers import PublishedCell
from dqcontrol.experiments.published.results import Results
from dqcontrol.experiments.tables import Cell, Column, Table

NAMES = {
    "error": "Err",
    "control": "θ̇ [rad]",
    "joint_step": "Eff [rad s]",
    "hand_speed": "L.Vel [m]",
    "hand_acceleration": "L.Acc [m/s]",
}
_COLUMNS = (
    Column("Law"),
    Column("Set"),
    Column("Metric"),
    Column("Published"),
    Column("±", "", ".2g"),
    Column("Ours"),
    Column("±", "", ".2g"),
    Column("Ratio", "", ".3g"),
)


def comparison_tables(
    cells: Sequence[PublishedCell], results: Results, *, suffix: str = "", title: str = ""
) -> list[Table]:
    """Return one table for each published table and experiment.

    Parameters
    ----------
    cells
        The published ones.
    results
        Ours.
    suffix
        Appended to the law's label to find it in ours: a law that stands in for the published one. Only those
        laws are listed then.
    title
        Appended to the captions.
    """
    tables = []
    for (name, experiment), group in _grouped(cells).items():
        rows = [
            row
            for cell in group
            if (results.group(cell.law + suffix, cell.set, experiment))
            and (row := _row(cell, results, suffix))
        ]
        if rows:
            caption = " · ".join(part for part in (f"P16 {name}", experiment, title) if part)
            tables.append(Table(_COLUMNS, rows, caption))
    return tables


def _grouped(cells: Sequence[PublishedCell]) -> dict[tuple[str, str], list[PublishedCell]]:
    groups: dict[tuple[str, str], list[PublishedCell]] = {}
    for cell in cells:
        groups.setdefault((cell.table, cell.experiment), []).append(cell)
    return groups


def _row(cell: PublishedCell, results: Results, suffix: str) -> list[Cell]:
    where = (cell.law + suffix, cell.set, cell.metric, cell.experiment)
    ours = results.mean(*where)
    return [
        cell.law + suffix,
        cell.set,
        NAMES.get(cell.metric, cell.metric),
        cell.mean,
        cell.deviation,
        ours,
        results.deviation(*where),
        ours / cell.mean,
    ]
