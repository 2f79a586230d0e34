"""Work in parallel processes on this machine."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TypeVar, cast

from dqcontrol.errors import Error, ValueRangeError

T = TypeVar("T")
R = TypeVar("R")


def checked_jobs(jobs: int | None) -> int | None:
    """Return a number of processes, or None to leave it open.

    Raises
    ------
    ValueRangeError
        If it is no integer ≥ 1.
    """
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1):
        raise ValueRangeError(f"jobs: expected an integer ≥ 1, got {jobs!r:.80}")
    return jobs


def in_processes(function: Callable[[T], R], items: Iterable[T], jobs: int) -> Iterator[R]:
    """Give the function's result of each item as soon as it is there, in any order.

    Only a few items more than there are processes are taken at once. Processes are used again by later calls, and work
    in the folder that this one is in then.

    Raises
    ------
    Error
        If a process dies.
    """
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    pool = Parallel(
        n_jobs=jobs,
        return_as="generator_unordered",
        max_nbytes=None,  # arrays travel with the tasks, not through files
        initializer=_depend_on,
        initargs=(os.getpid(),),
    )
    work = function if jobs == 1 else partial(_in_folder, os.getcwd(), function)
    try:
        yield from cast(Iterator[R], pool(delayed(work)(item) for item in items))
    except TerminatedWorkerError:
        raise Error(
            "a process of the study was killed, possibly out of memory; try fewer jobs (--jobs)"
        ) from None


def _in_folder(folder: str, function: Callable[[T], R], item: T) -> R:
    os.chdir(folder)
    return function(item)


def _depend_on(parent: int) -> None:
    """Leave Ctrl-C to the main process, and end with it even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
