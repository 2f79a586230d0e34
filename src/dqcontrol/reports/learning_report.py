"""The report of learning from repetition: how errors shrank, on what condition, and the motion that is left."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.reports.provenance import RERUN_FOLDER, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.tables.table_cells import Column, VerdictCell
from dqcontrol.tables.tables import Table

if TYPE_CHECKING:
    from dqcontrol.tuning import Learning


def write_learning_report(learning: Learning, spec: str, folder: Path) -> None:
    """Write ``report.html`` of learning from repetition and its figure into an existing folder."""
    from dqcontrol.figures import save_figures
    from dqcontrol.figures.learning_plots import repeats_of_learning

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
