"""Messages of pages may be sent from any thread: what wakes viser's senders is set in the thread of their loop."""

from __future__ import annotations

import asyncio
import importlib
from typing import Any, Literal

from dqcontrol.errors import Error


class LoopEvent(asyncio.Event):
    """An event that other threads than that of its loop leave alone.

    Viser sets the event of a buffer of messages where a message comes from, and once more in the loop. The first is an
    error of threads: with two pages it raised now and then, "deque mutated during iteration", which ended the program.
    """

    def __init__(self) -> None:
        super().__init__()
        self._home: asyncio.AbstractEventLoop | None = None

    async def wait(self) -> Literal[True]:
        """Wait in a loop; from now on the event belongs to that."""
        self._home = asyncio.get_running_loop()
        return await super().wait()

    def set(self) -> None:
        """Wake who waits, if this is the thread of their loop."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:
            return
        if self._home in (None, here):
            super().set()


def use_loop_events() -> None:
    """Let all servers of viser that start from now on have such events.

    Raises
    ------
    Error
        If this viser keeps its messages in another way.
    """
    infra: Any = importlib.import_module("viser.infra._infra")
    buffer: Any = getattr(infra, "AsyncMessageBuffer", None)
    if "message_event" not in getattr(buffer, "__dataclass_fields__", ()):
        raise Error("view: this viser keeps its messages in another way; install viser 1.1")
    if issubclass(buffer, _Buffers):
        return

    class Buffer(_Buffers, buffer):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.message_event = LoopEvent()

    infra.AsyncMessageBuffer = Buffer


class _Buffers:
    """Marks buffers that have such events."""
