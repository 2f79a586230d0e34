"""Write the signals of a run for other programs."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force


def export(run: Path, path: Path, /, *, force: Force = False) -> None:
    """Write all signals of a run for other programs.

    Parameters
    ----------
    run
        Folder of a run.
    path
        New file; its suffix chooses the format: .csv, .parquet or .mat.
    force
        Replace an existing file.
    """
    from dqcontrol.experiments import load_run

    print(f"results: {load_run(run).export(path, force=force)}")
