"""Running a parameter study part by part: in processes here, or on a cluster."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from dqcontrol.errors import Error
from dqcontrol.experiments.prepared_experiment import program
from dqcontrol.experiments.processes import checked_jobs, in_processes
from dqcontrol.experiments.ranking import BEST_BY, Ranking, rank
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.results_folder import (
    SPEC_FILE,
    WorkingFolder,
    check_new,
    new_folder,
    working_folder,
)
from dqcontrol.experiments.row_file import join_files, parquet, write_whole
from dqcontrol.experiments.run_comparison import write_table
from dqcontrol.experiments.spec.reference_spec import ObjectSpec
from dqcontrol.experiments.spec.spec_files import copy_inputs
from dqcontrol.experiments.study import ROWS
from dqcontrol.experiments.sweep import Sweep, read_sweep, sweep_of_text
from dqcontrol.experiments.trials import WORTH_PROCESSES, Batch, precompile
from dqcontrol.files.yaml_file import parse_yaml
from dqcontrol.measures.metric_tables import number_column

SweepProgress = Callable[[int, int], None]  # trials done; trials in all
_ONE_AT_A_TIME = (
    threading.Lock()
)  # a worker of a cluster may have several threads, but trials change warning filters


@dataclass(frozen=True)
class Task:
    """A part of a parameter study, to be run anywhere.

    Attributes
    ----------
    text, folder
        Of the study.
    program
        Versions that it must run with.
    part
        Its number.
    runs
        What it consists of; see `Sweep.runs_of`.
    """

    text: str
    folder: Path
    program: str
    part: int
    runs: range

    def run(self) -> tuple[int, int, bytes]:
        """Return the part's number, its number of trials, and its rows in a Parquet file.

        Raises
        ------
        Error
            If another version of dqcontrol, or of the libraries that trials depend on, is installed here.
        """
        if program() != self.program:
            raise Error("a worker has another version of dqcontrol, NumPy or MuJoCo; give all the same")
        with _ONE_AT_A_TIME:
            rows = list(_known(self.text, self.folder).rows(self.runs))
        return self.part, len(rows), parquet(rows, {})


@lru_cache(maxsize=1)
def _known(text: str, folder: Path) -> Sweep:
    return sweep_of_text(text, folder)


def run_sweep_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    by: str = BEST_BY,
    progress: SweepProgress | None = None,
) -> Ranking:
    """Run a parameter study, and write ``spec.yaml``, ``runs.parquet``, a table and a figure of its best points.

    The same spec gives the same rows to the last bit, whatever the number of jobs or workers. Finished parts are kept
    in ``.NAME.part`` beside the folder NAME until all are there: after an interruption the same call resumes it.

    Parameters
    ----------
    source
        Path of a YAML file with the key ``sweep``, or the same as a dictionary.
    folder
        A new folder.
    force
        Replace the folder, if it holds earlier results, and discard finished parts of another spec or version.
    jobs
        Processes on this machine; default: as many as there are processors, or one if there is little to do.
    scheduler
        Address of a Dask scheduler, whose workers run the trials in place of processes here.
    by
        Number, as in `Metrics.flat`, that says which points are best.
    progress
        Called with trials done, and in all.

    Returns
    -------
    The points, the best first.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach, at the first point or with any end of a
        range or value of a list in it; or if the folder must not be written, or nobody answers at the address.
    """
    sweep, target, jobs = read_sweep(source), Path(folder), checked_jobs(jobs)
    if scheduler is not None and jobs is not None:
        raise Error("jobs: is for processes on this machine; leave it out with a scheduler")
    if isinstance(sweep.first.spec.reference, ObjectSpec):
        if scheduler is not None or jobs not in (None, 1):
            raise Error(
                "reference: is an object of this program, which other processes do not have; leave out jobs"
            )
        jobs = 1
    check_new(target, force=force)
    number_column(by)
    fingerprint = sweep.fingerprint()
    with (
        WorkingFolder(working_folder(target), sweep.text, fingerprint, force=force) as parts,
        _workers(sweep, jobs, scheduler) as carry_out,
    ):
        _run(sweep, parts, carry_out, progress or (lambda done, total: None))
        with new_folder(target, force=force) as new:
            (new / SPEC_FILE).write_text(sweep.text, encoding="utf-8")
            copy_inputs(parse_yaml("spec", sweep.text), new)
            join_files(list(parts.parts().values()), new / ROWS, {"spec": sweep.text})
            ranking = rank([new], by)
            write_table(ranking.table(), new, "best")
            result_pages().write_sweep(ranking, sweep.text, new)
        parts.discard()
    return ranking


CarryOut = Callable[[Iterable[Task]], Iterator[tuple[int, int, bytes]]]


@contextmanager
def _workers(sweep: Sweep, jobs: int | None, scheduler: str | None) -> Iterator[CarryOut]:
    """Give what runs tasks: a cluster, processes, or this one."""
    if scheduler is not None:
        from dqcontrol.experiments.processes import connect, on_cluster

        with connect(scheduler) as client:
            yield lambda tasks: on_cluster(client, Task.run, tasks)
        return
    import joblib

    if jobs is None:
        jobs = joblib.cpu_count() if sweep.seconds > WORTH_PROCESSES else 1
    if jobs == 1 or sweep.parts == 1:
        yield lambda tasks: map(Task.run, tasks)
        return
    precompile([Batch(setting, case, (0,), None) for setting in sweep.ends() for case in setting.cases])
    yield lambda tasks: in_processes(Task.run, tasks, jobs)


def _run(sweep: Sweep, parts: WorkingFolder, carry_out: CarryOut, report: SweepProgress) -> None:
    """Run the parts that are not finished, and write each when it is there."""
    finished = parts.parts()
    done = sum(sweep.trials_in(part) for part in finished)
    report(done, sweep.trials)
    text, version = sweep.text, program()
    left = (part for part in range(sweep.parts) if part not in finished)
    tasks = (Task(text, sweep.folder, version, part, sweep.runs_of(part)) for part in left)
    for part, count, content in carry_out(tasks):
        write_whole(parts.part(part), content)
        done += count
        report(done, sweep.trials)
