"""Parts of an experiment: worked through in processes, and kept as they are finished."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec

from dqcontrol.compiled.kernel_cache import source_hash
from dqcontrol.experiments.prepared_experiment import program
from dqcontrol.experiments.processes import in_processes
from dqcontrol.experiments.results_folder import WorkingFolder
from dqcontrol.experiments.row_file import write_whole

P = TypeVar("P")
R = TypeVar("R")


def work_through(
    function: Callable[[P], R],
    kind: type[R],
    parts: Sequence[P],
    spec: str,
    jobs: int | None = None,
    progress: Callable[[float, int], None] | None = None,
    folder: Path | None = None,
) -> list[R]:
    """Return what a function gives for each part, in their order.

    Parameters
    ----------
    function
        Of a module, so that other processes find it.
    kind
        What it returns: a dataclass of plain numbers and words.
    parts
        Their ``repr`` tells them apart.
    spec
        Text of the experiment.
    jobs
        Processes that work in parallel; default: as many as there are processors.
    progress
        Called with the number of parts done, and of all of them.
    folder
        Working folder that keeps what is finished, so that the same call resumes after an interruption.

    Raises
    ------
    ExistsError
        If the folder holds results of another experiment or version.
    """
    if not parts:
        return []
    report, found = progress or (lambda done, total: None), {}
    kept = nullcontext() if folder is None else WorkingFolder(folder, spec, _fingerprint(function, parts))
    with kept as working:
        files = [working.part(i).with_suffix(".found") for i in range(len(parts))] if working else []
        for i, file in enumerate(files):
            if file.exists():
                found[i] = msgspec.msgpack.decode(file.read_bytes(), type=kind)
        report(len(found), len(parts))
        left = [(i, part) for i, part in enumerate(parts) if i not in found]
        for i, result in _results(function, left, jobs):
            found[i] = result
            if files:
                write_whole(files[i], msgspec.msgpack.encode(result))
            report(len(found), len(parts))
    return [found[i] for i in range(len(parts))]


def _fingerprint(function: Callable[[P], R], parts: Sequence[P]) -> str:
    return f"{program()} {source_hash(function.__module__, lazily=True)} {parts!r}"


def _results(
    function: Callable[[P], R], left: Sequence[tuple[int, P]], jobs: int | None
) -> Iterator[tuple[int, R]]:
    if jobs is None:
        import joblib

        jobs = joblib.cpu_count()
    if jobs == 1 or len(left) <= 1:
        yield from ((i, function(part)) for i, part in left)
        return
    yield from in_processes(partial(_numbered, function), left, min(jobs, len(left)))


def _numbered(function: Callable[[P], R], part: tuple[int, P]) -> tuple[int, R]:
    """Return a part's number beside its result, as other processes give it back."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the main process says what is to be said of the experiment
        return part[0], function(part[1])
