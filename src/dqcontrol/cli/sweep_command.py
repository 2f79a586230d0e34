"""Run a parameter study."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table, progress_bar


def sweep(
    spec: Path,
    /,
    *,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    by: str = "error.integral",
) -> None:
    """Run a parameter study and list its best points; rerun it to resume after an interruption.

    Parameters
    ----------
    spec
        YAML file with the key sweep; see docs/sweeps.md.
    out
        New folder for the results; default: results/NAME, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished study of another spec or version.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    scheduler
        Address of a Dask scheduler, as tcp://127.0.0.1:8786, whose workers run the trials.
    by
        Number that says which points are best, as in runs.parquet.
    """
    from dqcontrol.cli.kernels_beside import compile_beside
    from dqcontrol.experiments import run_sweep_to
    from dqcontrol.experiments.results_folder import working_folder
    from dqcontrol.experiments.sweep import read_sweep

    folder = out or Path("results") / read_sweep(spec).name
    compile_beside()
    try:
        with progress_bar() as progress:
            ranking = run_sweep_to(
                spec, folder, force=force, jobs=jobs, scheduler=scheduler, by=by, progress=progress
            )
    except KeyboardInterrupt:
        kept = "; finished parts are kept: rerun the same command to resume" * working_folder(folder).exists()
        raise KeyboardInterrupt(kept) from None
    print(f"results: {folder}")
    print_table(ranking.table())
