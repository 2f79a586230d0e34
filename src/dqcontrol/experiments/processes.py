"""Work in parallel processes, on this machine or on a cluster."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar, cast

from dqcontrol.errors import Error, ValueRangeError, from_extra

if TYPE_CHECKING:
    from distributed import Client  # pyright: ignore[reportMissingImports]


T = TypeVar("T")
R = TypeVar("R")


_WORTH_PROCESSES = 5.0  # s of work; starting processes for less takes longer than it saves


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


def sensible_jobs(seconds: float) -> int:
    """Return the number of available processors, or 1 if there is too little to do for them."""
    if seconds <= _WORTH_PROCESSES:
        return 1
    import joblib

    return joblib.cpu_count()


@contextmanager
def workers(
    run: Callable[[T], R],
    jobs: int | None,
    scheduler: str | None,
    seconds: float,
    count: int,
    prepare: Callable[[], object] = lambda: None,
) -> Iterator[Callable[[Iterable[T]], Iterator[R]]]:
    """Give what runs tasks: a cluster, processes, or this one.

    Parameters
    ----------
    run
        Does one.
    jobs
        How many processes; None: one for each core, if the work is worth it.
    scheduler
        The cluster's, in place of processes.
    seconds, count
        How long all tasks take together, and how many they are.
    prepare
        Called once before there are processes.
    """
    if scheduler is not None:
        with connect(scheduler) as client:
            yield lambda tasks: on_cluster(client, run, tasks)
        return
    if jobs is None:
        jobs = sensible_jobs(seconds)
    if jobs == 1 or count == 1:
        yield lambda tasks: map(run, tasks)
        return
    prepare()
    yield lambda tasks: in_processes(run, tasks, min(jobs, count))


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


_PATIENCE = 10.0  # s until there is no scheduler, or no worker
_AHEAD = 3  # tasks at a time for each thread of a worker


def connect(address: str) -> Client:
    """Return a client of a Dask scheduler that has workers.

    Parameters
    ----------
    address
        As ``tcp://127.0.0.1:8786``.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    Error
        If the address is malformed, nobody answers, or there are no workers.
    """
    distributed, addressing = (
        from_extra(name, "dask", "schedulers") for name in ("distributed", "distributed.comm.addressing")
    )
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # one line of ours is enough
    try:
        # a client that never began complains later
        addressing.parse_host_port(addressing.parse_address(address)[1])
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError):
        raise Error(f"scheduler: nobody answers at '{address}'; start one with: dask scheduler") from None
    except (ValueError, KeyError, TypeError) as error:
        raise Error(f"scheduler: expected an address as tcp://HOST:PORT, got '{address}' ({error})") from None
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        client.close()
        raise Error(
            f"scheduler: '{address}' has no workers; start some with: dask worker {address} --nthreads 1"
        ) from None
    return client


def on_cluster(client: Client, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Give the function's result of each item as soon as it is there, in any order; what a lost worker had is repeated.

    Only a few items more than there are threads are sent at once.

    Raises
    ------
    Error
        If a worker cannot do the work, or the scheduler goes away.
    """
    from distributed import (  # pyright: ignore[reportMissingImports]
        CancelledError,
        KilledWorker,
        as_completed,
    )

    rest, waiting = iter(items), as_completed(loop=client.loop)

    def send() -> None:
        threads: Any = client.nthreads()
        count = _AHEAD * max(sum(threads.values()), 1) - waiting.count()
        for item in islice(rest, max(count, 0)):
            waiting.add(client.submit(function, item, pure=False))

    try:
        send()
        for future in waiting:
            result: Any = future.result()
            del future
            send()
            yield result
    except KilledWorker:
        raise Error("several workers died at the same trials, possibly out of memory") from None
    except (CancelledError, OSError):
        raise Error("scheduler: the connection was lost") from None
    except ImportError as error:
        raise Error(f"a worker lacks what it needs, the same dqcontrol as here: {error}") from None
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(list(waiting.futures))
