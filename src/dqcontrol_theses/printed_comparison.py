"""Published | ours | ratio, for every cell of the published tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.tables import Cell, Column, Ratio, Table
from dqcontrol_theses.printed import PublishedCell
from dqcontrol_theses.results import Results

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
    for (name, experiment), group in _grouped(cells).items():
        rows = [
            _row(cell, results, suffix)
            for cell in group
            for suffix in suffixes
            if results.group(cell.law + suffix, cell.set, experiment)
        ]
        if rows:
            caption = " · ".join(part for part in (f"{source} Table {name}", experiment, title) if part)
            tables.append(Table(_COLUMNS, rows, caption))
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
    rows: list[list[Cell]] = []
    for cell in cells:
        if cell.metric == "control":
            setting = settings[cell.experiment]
            unit = setting.spec.period / (results.control_unit * setting.scene.samples[-1, -1])
            for law in (cell.law + suffix for suffix in suffixes):
                if results.group(law, cell.set, cell.experiment):
                    ours = results.mean(law, cell.set, cell.metric, cell.experiment)
                    rows.append([cell.experiment, law, cell.set, unit * cell.mean, unit * ours])
    columns = [
        Column("Experiment"),
        Column("Law"),
        Column("Set"),
        Column("Published", "rad", ".3f"),
        Column("Ours", "rad", ".3f"),
    ]
    return Table(columns, rows, " · ".join(filter(None, ("Mean of T |u|", title))))


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
        Ratio(ours / cell.mean),
    ]
