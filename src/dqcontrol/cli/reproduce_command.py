"""Run published experiments again."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import print_table, progress_bar


def reproduce(
    name: str | None = None,
    /,
    *,
    plant: str | None = None,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    samples: int | None = None,
    repeats: int | None = None,
) -> None:
    """Run published experiments again: tables beside the printed ones, and verdicts on what was claimed.

    Rerun the same command to resume after an interruption: experiments that are in the folder from before are left as
    they are, and of the one that was interrupted the runs, searches and repeats that had ended are kept.

    Parameters
    ----------
    name
        As pereira2016/spiral, or pereira2016 for all; without it the experiments are listed.
    plant
        What stands for the source's robot, one of those listed; default: the first.
    out
        New folder for the results; default: results/NAME, or results/NAME-PLANT with a plant.
    force
        Replace earlier folders of results, and discard what an interrupted command left.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    samples
        Of each run in real time; default: 500.
    repeats
        At most so many of each run; default: as many as were printed.
    """
    from shutil import rmtree

    from dqcontrol import reproductions as published
    from dqcontrol.errors import TaskWarning
    from dqcontrol.experiments.results_folder import check_new
    from dqcontrol.experiments.working_folder import working_folder

    warnings.simplefilter("ignore", TaskWarning)  # its verdicts say what was reached, as it was published
    if name is None:
        print_table(published.catalogue_table())
        return
    names = published.names(name)
    for each in names:
        published.chosen_plant(each, plant)  # says at once if there is none
    top = out or Path("results") / (f"{name}-{plant}" if plant else name)
    folders = {each: top / each.rpartition("/")[2] if len(names) > 1 else top for each in names}
    count = published.SAMPLES if samples is None else samples
    finished = {
        each: len(names) > 1
        and not force
        and published.is_finished(folder, each, plant=plant, samples=count, repeats=repeats)
        for each, folder in folders.items()
    }
    for each, folder in folders.items():
        if not finished[each]:
            check_new(folder, force=force)
    if any(finished.values()):
        print(f"resuming: {sum(finished.values())} of {len(names)} already done")
    for number, (each, folder) in enumerate(folders.items(), 1):
        if finished[each]:
            continue
        if len(names) > 1:
            print(f"{each}: {number} of {len(names)}")
        unfinished = working_folder(folder)
        if force:
            rmtree(unfinished, ignore_errors=True)
        try:
            with progress_bar() as progress:
                done = published.reproduce(
                    each,
                    plant=plant,
                    jobs=jobs,
                    samples=count,
                    repeats=repeats,
                    progress=lambda label, count, total, show=progress: show(count, total, label),
                    unfinished=unfinished,
                )
            for table in done.tables:
                print_table(table)
            sys.stdout.flush()
            done.save(folder, force=force)  # draws, which takes longer
        except KeyboardInterrupt:
            is_kept = unfinished.exists() or len(names) > 1
            raise KeyboardInterrupt(
                "; what was finished is kept: rerun the same command to resume" * is_kept
            ) from None
        rmtree(unfinished, ignore_errors=True)
        print(f"results: {folder}")
