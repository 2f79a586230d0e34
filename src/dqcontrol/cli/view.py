"""Look at runs in a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators

from dqcontrol.errors import Error

Port = Annotated[int, Parameter(validator=validators.Number(gte=1024, lte=65535))]


def view(*folders: Path, port: Port = 8080) -> None:
    """Look at saved runs in a browser: robots, paths, frames and errors over time; Ctrl+C ends it.

    Parameters
    ----------
    folders
        Folders of runs, or of studies for all their runs.
    port
        Of this machine, where only its own users reach it; the next free one if it is taken.
    """
    from dqcontrol.experiments import load_runs
    from dqcontrol.view.browser import Page, Track
    from dqcontrol.view.browser.page import import_viser

    if not folders:
        raise Error("view: give at least one folder of a run")
    import_viser()  # before the work: it may be missing
    tracks = [Track(label, run.robot, run.record) for label, run in load_runs(folders).items()]
    page = Page(tracks, port)
    print(f"view: {page.url} (Ctrl+C ends)", flush=True)
    page.serve()
