"""Compare saved runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table


def compare(
    *folders: Path,
    out: Out = None,
    force: Force = False,
    by: str | None = None,
    where: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    best_per: str | None = None,
) -> None:
    """Compare saved runs: one table; with --out plots and a report. Of studies with repeats, a table of means.

    Of parameter studies (sweeps), and of studies with --by, the table lists the best points.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    out
        New folder for table and plots.
    force
        Replace an earlier folder of results.
    by
        Number that says which points are best, as in runs.parquet; default for sweeps: error.integral.
    where
        Only points with this value of a parameter or label: plant.delay=0.032 or plant.delay=32ms; again for more.
    best_per
        List the best point for each value of this parameter or label, as plant.delay.
    """
    from dqcontrol.errors import Error
    from dqcontrol.experiments import load_rows, load_runs, rank, summary
    from dqcontrol.experiments.load_results import is_study, is_sweep
    from dqcontrol.experiments.ranking import BEST_BY
    from dqcontrol.experiments.results_folder import SPEC_FILE, new_folder
    from dqcontrol.experiments.run_comparison import MEANS, unit_of_way, write_table
    from dqcontrol.measures import means_table
    from dqcontrol.reports import write_report
    from dqcontrol.reports.about import RERUN_FOLDER, command, origins
    from dqcontrol.reports.study_reports import figures_of_several, surroundings_of

    if not folders:
        raise Error("compare: give at least one folder of a run")
    if by is not None or where or best_per or any(map(is_sweep, folders)):
        ranking = rank(folders, by or BEST_BY, dict(map(_condition, where)))
        runs, table = {}, (ranking.best_of_each(best_per) if best_per else ranking).table()
    elif any(map(is_study, folders)):
        runs, table = {}, means_table(load_rows(folders), MEANS, "comparison")
    else:
        runs = load_runs(folders)
        table = summary(runs, "comparison")
    if out is not None:
        with new_folder(out, force=force) as new:
            (new / SPEC_FILE).write_text("".join(f"# {folder}\n" for folder in folders), encoding="utf-8")
            write_table(table, new, "table")
            records = {label: run.record for label, run in runs.items()}
            unit = unit_of_way(run.robot for run in runs.values())
            figures = figures_of_several(records, unit, surroundings_of(runs.values()))
            places = [str(folder.resolve()) for folder in folders]
            write_report(
                new,
                "Comparison",
                facts=", ".join(map(str, folders)),
                command=command("compare", *places, by=by, where=where, best_per=best_per, out=RERUN_FOLDER),
                tables=[table],
                figures=figures,
                origins=origins({}),
            )
    if out is not None:
        print(f"results: {out}")
    print_table(table)


def _condition(text: str) -> tuple[str, float | str]:
    """Return the key and the value, in SI units, of what ``--where`` says."""
    from dqcontrol.errors import Error
    from dqcontrol.files.units import as_quantity

    key, equals, value = text.partition("=")
    if not (key and equals and value):
        raise Error(f"where: expected KEY=VALUE, as plant.delay=0.032, got '{text}'")
    if quantity := as_quantity(value):
        return key, quantity[0]
    try:
        return key, float(value)
    except ValueError:
        return key, value
