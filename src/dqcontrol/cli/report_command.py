"""Regenerate reports, with all figures."""

from __future__ import annotations

from pathlib import Path


def report(*folders: Path, jobs: int | None = None) -> None:
    """Regenerate the reports of saved runs, with all figures, which studies leave out, and replays that move.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    jobs
        Processes that draw in parallel; default: as many as there are processors, if there is enough to do.
    """
    from dqcontrol.cli.screen import progress_bar
    from dqcontrol.errors import Error
    from dqcontrol.reports import rewrite_reports

    if not folders:
        raise Error("report: give at least one folder of a run or a study")
    with progress_bar() as progress:
        written = rewrite_reports(
            folders, jobs=jobs, progress=lambda done, total: progress(done, total, "reports")
        )
    for path in written:
        print(path)
