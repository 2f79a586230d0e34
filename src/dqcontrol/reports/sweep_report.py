"""The report of a parameter study: its best points, and how many of its runs ended well."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.experiments.ranking import Ranking
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.reports.provenance import RERUN_FOLDER, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.tables.table_cells import Cell, VerdictCell
from dqcontrol.tables.tables import Column, Table


def write_sweep_report(ranking: Ranking, spec: str, folder: Path) -> None:
    """Write ``report.html`` of a parameter study into an existing folder."""
    from dqcontrol.figures import sweep_figure

    table, count = ranking.table(), len(ranking.groups)
    figures = {"sweep": sweep_figure(ranking)} if ranking.placed else {}
    data = parse_yaml(SPEC_FILE, spec)
    whole = ranking.placed == count
    end: list[Cell] = [
        f"{ranking.placed:,} of {count:,}",
        VerdictCell("succeeded" if whole else "failed", whole),
    ]
    write_report(
        folder,
        str(data["name"]),
        facts=f"{count:,} points, ranked by {ranking.by}",
        command=command("sweep", SPEC_FILE, by=ranking.by, out=f"{PARENT}/{RERUN_FOLDER}"),
        verdicts=[Table([Column("Points whose runs ended well"), Column("End")], [end])],
        tables=[table],
        figures=figures,
        spec=spec,
        origins=origins(data),
    )
