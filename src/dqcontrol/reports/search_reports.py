"""The reports of searches: tuned laws, motions learnt from repetition, identified servos."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.measures.metric_tables import NUMBER_COLUMNS
from dqcontrol.reports.about import RERUN_FOLDER, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.tables.tables import Cell, Column, Table, VerdictCell

if TYPE_CHECKING:
    from dqcontrol.logs import Identification
    from dqcontrol.tuning import Learning, Tuning


def write_tuning_report(tuning: Tuning, spec: str, folder: Path) -> None:
    """Write ``report.html`` of a search and its figures into an existing folder."""
    from dqcontrol.figures import save_figures
    from dqcontrol.figures.studies import front_figure, search_figure

    figures = {"search": search_figure(tuning)}
    if any(each.result.front for each in tuning.laws):
        figures["front"] = front_figure(tuning)
    save_figures(figures, folder, ("svg",))
    data, block = parse_yaml(SPEC_FILE, spec), tuning.problem.block
    asked = " + ".join(f"{weight:g} × {name}" for name, weight in block.objectives.items())
    verdicts: list[list[Cell]] = [
        [each.label, _verdict(each.succeeded, each.result.held_out_violation == 0)] for each in tuning.laws
    ]
    write_report(
        folder,
        str(data["name"]),
        facts=f"{len(tuning.laws)} laws, {block.budget} parameter sets each; smallest {asked}",
        command=command("tune", SPEC_FILE, out=f"{PARENT}/{RERUN_FOLDER}"),
        verdicts=[Table([Column("law"), Column("constraints")], verdicts)],
        tables=[tuning.table(), _numbers(tuning), *_remarks(tuning)],
        figures=figures,
        spec=spec,
        origins=origins(data),
    )


def _verdict(searched: bool, held_out: bool) -> VerdictCell:
    if searched and held_out:
        return VerdictCell("kept, also on what the search did not see", True)
    return VerdictCell("broken on what the search did not see" if searched else "broken", False)


def _numbers(tuning: Tuning) -> Table:
    """Return all numbers of each law on what was searched and on what was not."""
    columns = [Column("number"), Column("unit")]
    for each in tuning.laws:
        columns += [Column(each.label), Column(f"{each.label}, held out")]
    rows: list[list[Cell]] = []
    for name, column in NUMBER_COLUMNS.items():
        values = [
            value if math.isfinite(value := source[name]) else None
            for each in tuning.laws
            for source in (each.result.searched, each.result.held_out)
        ]
        if any(value is not None for value in values):
            rows.append([column.title, column.unit, *values])
    return Table(columns, rows, "All numbers")


def _remarks(tuning: Tuning) -> list[Table]:
    lines = tuning.remarks()
    return [Table([Column("Remarks")], [[line] for line in lines])] if lines else []


def write_learning_report(learning: Learning, spec: str, folder: Path) -> None:
    """Write ``report.html`` of learning from repetition and its figure into an existing folder."""
    from dqcontrol.figures import save_figures
    from dqcontrol.figures.studies import repeats_of_learning

    figures = {"learning": repeats_of_learning(learning)}
    save_figures(figures, folder, ("svg",))
    data = parse_yaml(SPEC_FILE, spec)
    first, best = learning.repeats[0], learning.repeats[learning.best]
    better = VerdictCell(
        f"{learning.gain:.3g} × smaller" if learning.gain > 1 else "no better", learning.gain > 1
    )
    what, unit, errors = "position error RMS", "mm", [first.position, best.position]
    if first.force is not None:
        what, unit, errors = "force error RMS", "N", [first.force, best.force]
    write_report(
        folder,
        str(data["name"]),
        facts=f"{len(learning.repeats) - 1} repeats; {learning.stopped}",
        command=command("learn", SPEC_FILE, out=f"{PARENT}/{RERUN_FOLDER}"),
        verdicts=[
            Table(
                [
                    Column(f"{what}, first", unit),
                    Column("learnt", unit),
                    Column("learning"),
                ],
                [[*errors, better]],
            )
        ],
        tables=[learning.table(), Table([Column("Remarks")], [[line] for line in learning.remarks()])],
        figures=figures,
        spec=spec,
        origins=origins(data),
    )


def write_identification_report(found: Identification, folder: str | Path) -> Path:
    """Write ``report.html`` beside the files of an identification, in place of an earlier one.

    Examples
    --------
    >>> write_identification_report(dqc.identify("log.csv", "iiwa7"), "results/servos")  # doctest: +SKIP
    """
    from dqcontrol.figures.studies import servo_fits

    (Path(folder) / "report.html").unlink(missing_ok=True)
    tables = [found.table]
    if found.remarks:
        tables.append(Table([Column("what else should be known")], [[line] for line in found.remarks]))
    traces = {each.name: (each.trace, each.floor) for each in found.fitted if each.trace is not None}
    logs = [str(path.resolve()) for path in found.logs]
    return write_report(
        folder,
        f"Servos of {found.robot}",
        facts=f"{len(found.fitted)} of {len(found.joints)} joints · {', '.join(path.name for path in found.logs)}",
        command=command("identify", *logs, robot=found.robot, out=RERUN_FOLDER),
        tables=tables,
        figures={"servos": servo_fits(traces)} if traces else {},
        origins=origins({}),
    )
