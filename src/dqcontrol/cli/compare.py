"""Compare saved runs."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import console
from dqcontrol.errors import Error


def compare(*folders: Path, out: Out = None, force: Force = False) -> None:
    """Compare saved runs: one table, and plots if --out is given; of studies with repeats, a table of means.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    out
        New folder for table and plots.
    force
        Replace an earlier folder of results.
    """
    from dqcontrol.experiments import load_rows, load_runs, means_table, summary
    from dqcontrol.experiments.comparison import MEANS, write_comparison
    from dqcontrol.experiments.output import MARK, new_folder
    from dqcontrol.experiments.saved import is_study

    if not folders:
        raise Error("compare: give at least one folder of a run")
    if any(map(is_study, folders)):
        runs, table = {}, means_table(load_rows(folders), MEANS, "comparison")
    else:
        runs = load_runs(folders)
        table = summary(runs, "comparison")
    if out is not None:
        with new_folder(out, force=force) as new:
            (new / MARK).write_text("".join(f"# {folder}\n" for folder in folders), encoding="utf-8")
            write_comparison(table, {label: run.record for label, run in runs.items()}, new)
    console().print(table.rich())
    if out is not None:
        print(f"results: {out}")
