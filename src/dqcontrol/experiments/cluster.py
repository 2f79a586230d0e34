"""Work on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeVar

from dqcontrol.errors import Error, MissingExtraError

if TYPE_CHECKING:
    from distributed import Client  # pyright: ignore[reportMissingImports]

T = TypeVar("T")
R = TypeVar("R")

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
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports]
        from distributed.comm.addressing import parse_address, parse_host_port  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise MissingExtraError(
            "distributed: is not installed, and --scheduler needs it; install it with: pip install 'dqcontrol[dask]'"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # one line of ours is enough
    try:
        parse_host_port(parse_address(address)[1])  # a client that never began complains later
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
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
