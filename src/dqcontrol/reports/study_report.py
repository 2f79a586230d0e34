"""The report of a study: how its runs ended, their tables and figures together, and the pages of single runs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqcontrol.experiments.ranking import Ranking
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE
from dqcontrol.experiments.row_file import Row
from dqcontrol.experiments.run_comparison import MOST_CURVES, unit_of_way
from dqcontrol.experiments.study import Study, by_label
from dqcontrol.experiments.verdict import verdict_of
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop.record import Record, has_failed
from dqcontrol.reports.about import RERUN_FOLDER, about_study, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.tables.tables import Cell, Column, Table, VerdictCell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.experiments.run import Run


def surroundings_of(runs: Iterable[Run]) -> Constraints | None:
    """Return constraints with the obstacles and zones that all runs have that have any; None where these differ."""
    given = [run.surroundings for run in runs if run.surroundings is not None]
    alike = all(
        (each.world, each.clear_of, each.zones) == (given[0].world, given[0].clear_of, given[0].zones)
        for each in given
    )
    return given[0] if given and alike else None


def figures_of_several(
    records: Mapping[str, Record], unit: str, constraints: Constraints | None
) -> dict[str, Figure]:
    """Return the figures of records by label, of a dozen of them at most; none without records.

    ``unit`` is that of what the inputs move, see `experiments.run_comparison.unit_of_way`; ``constraints`` are
    drawn around paths, see `surroundings_of`.
    """
    from dqcontrol.figures import comparison_figures

    few = dict(list(records.items())[:MOST_CURVES])
    return {name: draw() for name, draw in comparison_figures(few, unit, constraints).items()} if few else {}


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


_MOST_PANELS = 5  # of the figure of repeats, which has one for each set where there are many


def write_study_report(
    study: Study,
    folder: Path,
    tables: Sequence[Table],
    records: Mapping[str, Record],
    pages: Mapping[str, str],
    *,
    figures: bool = True,
) -> None:
    """Write ``report.html`` of a study into an existing folder.

    Parameters
    ----------
    study
        What came of all its trials.
    folder
        Where its other files are.
    tables
        Beside that of its runs.
    records
        That are compared, by label.
    pages
        Of single runs, relative to the folder, by label.
    figures
        False: draw none.
    """
    from dqcontrol.figures import robot_picture
    from dqcontrol.reports import write_report

    first = next(iter(study.runs.values()), None)
    data: dict[str, Any] = parse_yaml("spec", study.spec)
    write_report(
        folder,
        study.name,
        facts=f"{len(study.rows)} runs" if len(study.rows) > 1 else "1 run",
        about=about_study(study, _outcome(study.rows)),
        picture=robot_picture(first.robot, first.record) if first and figures else None,
        notice="; ".join(study.failures()),
        command=command("run", SPEC_FILE, out=f"{PARENT}/{RERUN_FOLDER}"),
        verdicts=[study_verdicts(study.rows)],
        tables=[study.table(), *tables],
        figures=_figures(study, records) if figures else {},
        files=pages,
        spec=study.spec,
        origins=origins(data),
    )


def _outcome(rows: Sequence[Row]) -> VerdictCell:
    """Return how many runs did what was asked."""
    done = sum(not verdict_of(row).failure for row in rows)
    verdict = None if 0 < done < len(rows) else done > 0
    return VerdictCell(f"{done} of {len(rows)} did what was asked", verdict)


def _figures(study: Study, records: Mapping[str, Record]) -> dict[str, Figure]:
    """Return the figures of all runs together."""
    parts = study.runs.values() or study.setting().scenes.values()  # where only metrics were kept
    unit, around = unit_of_way(part.robot for part in parts), surroundings_of(study.runs.values())
    return figures_of_several(records, unit, around) | _repeats(study)


def _repeats(study: Study) -> dict[str, Figure]:
    """Return the figure of repeats; none where there are none, or too many for it."""
    sets = {row["set"] for row in study.rows}
    most = MOST_CURVES * min(len(sets), _MOST_PANELS)
    if not study.is_repeated or len(by_label(study.rows)) > most:
        return {}
    from dqcontrol.figures import repeats_figure

    return {"repeats": repeats_figure(study.rows)}


def study_verdicts(rows: Sequence[Row]) -> Table:
    """Return one row a combination of robot, law, set and plant: how its runs ended, and whether limits were kept."""
    lines: list[list[Cell]] = []
    for label, trials in by_label(rows).items():
        well = sum(not has_failed(str(row["stopped"])) for row in trials)
        end = VerdictCell("succeeded" if well == len(trials) else "failed", well == len(trials))
        verdicts = [verdict_of(row) for row in trials]
        short = [verdict.words for verdict in verdicts if verdict.failure]
        good = f"{len(trials) - len(short)} of {len(trials)}; " if len(trials) > 1 else ""
        verdict = VerdictCell(good + (short[0] if short else verdicts[0].words), not short)
        margins = [float(str(row["limit_margin"])) for row in trials if row["limit_margin"] is not None]
        least = min(margins, default=None)
        kept = (
            None if least is None else VerdictCell("kept" if least >= -1e-9 else "exceeded", least >= -1e-9)
        )
        lines.append([label, f"{well} of {len(trials)}", end, verdict, kept, least])
    columns = [
        Column("Run"),
        Column("Ended well"),
        Column("End"),
        Column("Verdict"),
        Column("Joint limits"),
        Column("Least margin", "rad or m", ".3g"),
    ]
    return Table(columns, lines)
