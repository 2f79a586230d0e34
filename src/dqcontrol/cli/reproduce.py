"""Run published experiments again."""

from __future__ import annotations

from pathlib import Path

from dqcontrol.cli.options import Force, Out
from dqcontrol.cli.screen import console, progress_bar


def reproduce(
    name: str | None = None,
    /,
    *,
    plant: str | None = None,
    out: Out = None,
    force: Force = False,
    jobs: int | None = None,
    samples: int | None = None,
) -> None:
    """Run published experiments again: tables beside the printed ones, and verdicts on what was claimed.

    Parameters
    ----------
    name
        As pereira2016/spiral, or pereira2016 for all; without it the experiments are listed.
    plant
        What the Meka is: servo, or meka-physics, its compliant joints in MuJoCo; default: servo.
    out
        New folder for the results; default: results/NAME, or results/NAME-PLANT for another plant than the default.
    force
        Replace earlier folders of results.
    jobs
        Processes that work in parallel; default: as many as there are processors, if there is enough to do.
    samples
        Of each real-time run of sampling-time; default: 500.
    """
    from dqcontrol.experiments import published
    from dqcontrol.experiments.output import check_new

    if name is None:
        console().print(published.catalogue_table().rich())
        return
    names, plant = published.names(name), plant or published.PLANT
    top = out or Path("results") / (name if plant == published.PLANT else f"{name}-{plant}")
    folders = {each: top / each if len(names) > 1 else top for each in names}
    for folder in folders.values():
        check_new(folder, force=force)
    for each, folder in folders.items():
        with progress_bar() as progress:
            done = published.reproduce(
                each,
                plant=plant,
                jobs=jobs,
                samples=published.SAMPLES if samples is None else samples,
                progress=lambda label, count, total, show=progress: show(count, total, label),
            )
        done.save(folder, force=force)
        for table in done.tables:
            console().print(table.rich())
        print(f"results: {folder}")
