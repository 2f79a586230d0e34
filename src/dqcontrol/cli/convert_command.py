"""Write the signals of a run for other programs."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force


def convert(run: Path, file: Path, /, *, force: Force = False) -> None:
    """Write all signals of a run for other programs.

    Parameters
    ----------
    run
        Folder of a run.
    file
        New file; its suffix chooses the format: .csv, .parquet or .mat.
    force
        Replace an existing file.
    """
    from dqcontrol.errors import ShapeError
    from dqcontrol.experiments import load_run

    if run.is_file():
        raise ShapeError(
            f"{run}: is a file; signals are those of a run, whose folder dqcontrol run writes; "
            f"a controller in C: dqcontrol export {run} --out FOLDER"
        )
    print(f"results: {load_run(run).export(file, force=force)}")
