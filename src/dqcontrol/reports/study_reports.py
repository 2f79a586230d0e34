"""The reports of studies, of parameter studies, and of searches: tuned laws, learnt motions, identified servos."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqcontrol.experiments.ranking import Ranking
from dqcontrol.experiments.results_folder import PARENT, SPEC_FILE, Row
from dqcontrol.experiments.run_comparison import MOST_CURVES, unit_of_way
from dqcontrol.experiments.study import Study, by_label
from dqcontrol.experiments.verdict import verdict_of
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.loop.record import Record, has_failed
from dqcontrol.measures.metric_tables import NUMBER_COLUMNS
from dqcontrol.reports.about import RERUN_FOLDER, about_study, command, origins
from dqcontrol.reports.report import write_report
from dqcontrol.reports.run_report import (  # with these this file is a `ResultPages`
    path_picture as path_picture,
    write_run_report as write_run_report,
)
from dqcontrol.tables.tables import Cell, Column, Table, VerdictCell

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dqcontrol.constraints.constraints import Constraints
    from dqcontrol.experiments.run import Run
    from dqcontrol.logs import Identification
    from dqcontrol.tuning import Learning, Tuning


def surroundings_of(runs: Iterable[Run]) -> Constraints | None:
    """Return constraints with the obstacles and zones that all runs have that have any; None where these differ."""
    given = [run.surroundings for run in runs if run.surroundings is not None]
    shown = [(each.world, each.clear_of, each.zones) for each in given]
    return given[0] if given and all(each == shown[0] for each in shown) else None


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


def figures_of_runs(runs: Mapping[str, Run]) -> dict[str, Figure]:
    """Return the same of runs by label."""
    unit = unit_of_way(run.robot for run in runs.values())
    return figures_of_several(
        {label: run.record for label, run in runs.items()}, unit, surroundings_of(runs.values())
    )


def _write(spec: str, folder: Path, name: str, *, by: str | None = None, **parts: Any) -> None:
    """Write the report of results that a command of this name gives again from a spec."""
    data = parse_yaml(SPEC_FILE, spec)
    again = command(name, SPEC_FILE, by=by, out=f"{PARENT}/{RERUN_FOLDER}")
    write_report(folder, str(data["name"]), command=again, spec=spec, origins=origins(data), **parts)


def write_sweep_report(ranking: Ranking, spec: str, folder: Path) -> None:
    """Write ``report.html`` of a parameter study into an existing folder."""
    from dqcontrol.figures import sweep_figure

    count = len(ranking.groups)
    well = VerdictCell.of(not ranking.failures, "succeeded", ranking.failures)
    _write(
        spec,
        folder,
        "sweep",
        by=ranking.by,
        facts=f"{count:,} points, ranked by {ranking.by}",
        verdicts=[
            Table(
                [Column("Points with a place"), Column("Runs")],
                [[f"{ranking.placed:,} of {count:,}", well]],
            )
        ],
        tables=[ranking.table()],
        figures={"sweep": sweep_figure(ranking)} if ranking.placed else {},
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
        end = VerdictCell.of(well == len(trials), "succeeded", "failed")
        verdicts = [verdict_of(row) for row in trials]
        short = [verdict.words for verdict in verdicts if verdict.failure]
        good = f"{len(trials) - len(short)} of {len(trials)}; " if len(trials) > 1 else ""
        verdict = VerdictCell(good + (short[0] if short else verdicts[0].words), not short)
        margins = [float(str(row["limit_margin"])) for row in trials if row["limit_margin"] is not None]
        least = min(margins, default=None)
        kept = least is None or least >= -1e-9
        limits = None if least is None else VerdictCell.of(kept, "kept", "exceeded")
        lines.append([label, f"{well} of {len(trials)}", end, verdict, limits, least])
    columns = [
        Column("Run"),
        Column("Ended well"),
        Column("End"),
        Column("Verdict"),
        Column("Joint limits"),
        Column("Least margin", "rad or m", ".3g"),
    ]
    return Table(columns, lines)


def write_tuning_report(tuning: Tuning, spec: str, folder: Path) -> None:
    """Write ``report.html`` of a search and its figures into an existing folder."""
    from dqcontrol.figures import save_figures
    from dqcontrol.figures.studies import front_figure, search_figure

    figures = {"search": search_figure(tuning)}
    if any(each.result.front for each in tuning.laws):
        figures["front"] = front_figure(tuning)
    save_figures(figures, folder, ("svg",))
    block = tuning.problem.block
    asked = " + ".join(f"{weight:g} × {name}" for name, weight in block.objectives.items())
    verdicts: list[list[Cell]] = [
        [each.label, _verdict(each.succeeded, each.result.held_out_violation == 0)] for each in tuning.laws
    ]
    _write(
        spec,
        folder,
        "tune",
        facts=f"{len(tuning.laws)} laws, {block.budget} parameter sets each; smallest {asked}",
        verdicts=[Table([Column("law"), Column("constraints")], verdicts)],
        tables=[tuning.table(), _numbers(tuning), *_remarks(tuning.remarks())],
        figures=figures,
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


def _remarks(lines: Sequence[str]) -> list[Table]:
    return [Table([Column("Remarks")], [[line] for line in lines])] if lines else []


def write_learning_report(learning: Learning, spec: str, folder: Path) -> None:
    """Write ``report.html`` of learning from repetition and its figure into an existing folder."""
    from dqcontrol.figures import save_figures
    from dqcontrol.figures.studies import repeats_of_learning

    figures = {"learning": repeats_of_learning(learning)}
    save_figures(figures, folder, ("svg",))
    first, best = learning.repeats[0], learning.repeats[learning.best]
    better = VerdictCell.of(learning.gain > 1, f"{learning.gain:.3g} × smaller", "no better")
    what, unit, errors = "position error RMS", "mm", [first.position, best.position]
    if first.force is not None:
        what, unit, errors = "force error RMS", "N", [first.force, best.force]
    columns = [Column(f"{what}, first", unit), Column("learnt", unit), Column("learning")]
    _write(
        spec,
        folder,
        "learn",
        facts=f"{len(learning.repeats) - 1} repeats; {learning.stopped}",
        verdicts=[Table(columns, [[*errors, better]])],
        tables=[learning.table(), *_remarks(learning.remarks())],
        figures=figures,
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
