"""Run an experiment."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import console, progress_bar


def run(spec: Path, /, *, out: Out = None, force: Force = False, jobs: int | None = None) -> None:
    """Run an experiment and write its table, recordings and plots; interrupted, the same command goes on.

    Parameters
    ----------
    spec
        YAML file; its keys are described in docs/experiments.md.
    out
        New folder for the results; default: results/NAME, NAME from the spec.
    force
        Replace an earlier folder of results, and discard an unfinished study of another spec or version.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    """
    from dqcontrol.experiments import read_spec, run_study_to
    from dqcontrol.experiments.conduct import working_folder

    folder = out or Path("results") / read_spec(spec)[0].name
    try:
        with progress_bar() as progress:
            study = run_study_to(spec, folder, force=force, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        kept = "; finished trials are kept, the same command goes on" * working_folder(folder).exists()
        raise KeyboardInterrupt(kept) from None
    console().print(study.table().rich())
    for line in study.failures():
        print(line)
    print(f"results: {folder}")
