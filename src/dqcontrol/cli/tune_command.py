"""Find the best parameters of laws."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table, progress_bar

if TYPE_CHECKING:
    from dqcontrol.tuning import Tuning


def tune(
    spec: Path,
    /,
    *,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Find the best parameters of every law, under the same budget; rerun it to resume after an interruption.

    Writes winners.json, and best.yaml, which dqcontrol run runs.

    Parameters
    ----------
    spec
        YAML file, perhaps with the key tune; see docs/tune.md.
    out
        New folder for the results; default: results/NAME-tuned, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished search of another spec or version.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    scheduler
        Address of a Dask scheduler, as tcp://127.0.0.1:8786, whose workers search.
    """
    from dqcontrol.cli.kernels_beside import compile_beside
    from dqcontrol.experiments.results_folder import working_folder
    from dqcontrol.tuning import tune_to
    from dqcontrol.tuning.tune_spec import read_tune

    folder = out or Path("results") / f"{read_tune(spec).spec.name}-tuned"
    compile_beside()
    try:
        with progress_bar() as progress:
            tune_to(
                spec,
                folder,
                force=force,
                jobs=jobs,
                scheduler=scheduler,
                progress=lambda done, total: progress(done, total, "laws"),
                computed=lambda found: _show(found, folder),
            )
    except KeyboardInterrupt:
        kept = "; what was evaluated is kept: rerun the same command to resume"
        raise KeyboardInterrupt(kept * working_folder(folder).exists()) from None


def _show(found: Tuning, folder: Path) -> None:
    """Print what was found, before its figures are drawn."""
    print(f"results: {folder}")
    print_table(found.table())
    for remark in found.remarks():
        print(remark)
    sys.stdout.flush()
