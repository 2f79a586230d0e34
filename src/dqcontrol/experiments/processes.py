"""Work in parallel processes, on this machine or on a cluster, and parts of it kept as they are finished."""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import msgspec

from dqcontrol.compiled.kernel_cache import source_hash
from dqcontrol.errors import Error, ValueRangeError, from_extra
from dqcontrol.experiments.prepared_experiment import program
from dqcontrol.experiments.results_folder import WorkingFolder
from dqcontrol.experiments.row_file import write_whole

if TYPE_CHECKING:
    from distributed import Client  # pyright: ignore[reportMissingImports]


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


def work_through(
    function: Callable[[T], R],
    kind: type[R],
    parts: Sequence[T],
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


def _fingerprint(function: Callable[[T], R], parts: Sequence[T]) -> str:
    return f"{program()} {source_hash(function.__module__, lazily=True)} {parts!r}"


def _results(
    function: Callable[[T], R], left: Sequence[tuple[int, T]], jobs: int | None
) -> Iterator[tuple[int, R]]:
    if jobs is None:
        import joblib

        jobs = joblib.cpu_count()
    if jobs == 1 or len(left) <= 1:
        yield from ((i, function(part)) for i, part in left)
        return
    yield from in_processes(partial(_numbered, function), left, min(jobs, len(left)))


def _numbered(function: Callable[[T], R], part: tuple[int, T]) -> tuple[int, R]:
    """Return a part's number beside its result, as other processes give it back."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the main process says what is to be said of the experiment
        return part[0], function(part[1])
