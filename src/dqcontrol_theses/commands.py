"""The commands that this package adds to `dqcontrol`: `reproduce`, `ros2 pereira2016` and `ros2 silva2017`."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from dqcontrol.cli import Force, Jobs, Out, ReplaceResults, print_table, progress_bar


def reproduce(
    name: str | None = None,
    /,
    *,
    plant: str | None = None,
    out: Out = None,
    force: Force = False,
    jobs: Jobs = None,
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
    samples
        Of each run in real time; default: 500.
    repeats
        At most so many of each run; default: as many as were printed.
    """
    from shutil import rmtree

    import dqcontrol_theses as published
    from dqcontrol.errors import TaskWarning
    from dqcontrol.experiments import check_new, working_folder

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
        except KeyboardInterrupt as interrupt:
            if unfinished.exists() or len(names) > 1:
                interrupt.add_note("what was finished is kept: rerun the same command to resume")
            raise
        rmtree(unfinished, ignore_errors=True)
        print(f"results: {folder}")


def pereira2016(
    robot: Annotated[Literal["meka", "kuka"], Parameter(show_default=True)] = "meka",
    *,
    law: str = "K",
    plant: Literal["servo", "meka-physics"] = "meka-physics",
    out: Out = None,
    force: ReplaceResults = False,
) -> None:
    """Launch the ROS graph of Pereira 2016: its nodes and topics, controller and robot in processes of their own.

    Parameters
    ----------
    robot
        The Meka draws the spiral; the Kuka in the simulator, a circle.
    law
        As the published experiment calls it.
    plant
        What the Meka is; in physics it has its force sensor.
    out
        New folder for recordings of the motions, which `dqcontrol view` shows while they run.
    """
    from dqcontrol.ros2 import check_installed
    from dqcontrol_theses.pereira2016.nodes import launch

    check_installed()
    code = launch(robot, law, plant, _recording(out, force=force))
    if code:
        sys.exit(code)


def silva2017(
    *,
    law: str = "ours",
    plant: Literal["camera", "ideal"] = "camera",
    out: Out = None,
    force: ReplaceResults = False,
) -> None:
    """Launch a ROS graph of Silva 2017: mobile manipulator and whole-body controller in processes of their own.

    Parameters
    ----------
    law
        As the comparison of the published experiments calls it.
    plant
        Whether a camera tells where the base is, or that is known exactly.
    out
        New folder for recordings of the motions, which `dqcontrol view` shows while they run.
    """
    from dqcontrol.ros2 import check_installed
    from dqcontrol_theses.silva2017.whole_body_graph import launch

    check_installed()
    code = launch(law, plant, _recording(out, force=force))
    if code:
        sys.exit(code)


def _recording(out: Path | None, *, force: bool) -> list[str]:
    """Return the options of a controller that is to record its motions."""
    return [*(["--out", str(out)] if out else []), *(["--force"] if force else [])]
