"""Turn Ctrl-C, SIGTERM and SIGHUP into a stop request, so that the robot comes to rest before the program ends."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
_HANG_UP = getattr(signal, "SIGHUP", None)


class Interrupts:
    """How often SIGINT, SIGTERM or SIGHUP came; see `counted_interrupts`.

    Attributes
    ----------
    count
        0: nobody wants it to end.
    have_raised
        Whether one of them raised KeyboardInterrupt.
    """

    def __init__(self) -> None:
        self.count: int = 0
        self.have_raised: bool = False
        self._only_counted = False

    def only_count(self) -> None:
        """Raise nothing from now on: who moves a robot looks at ``count`` between two of its steps.

        The third one raises nevertheless: whatever it is that keeps the program from looking must have an end.
        """
        self._only_counted = True

    def note(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal."""
        self.count += 1
        if not self._only_counted or self.count > 2:
            self.have_raised = True
            raise KeyboardInterrupt


@contextmanager
def counted_interrupts() -> Iterator[Interrupts]:
    """Count SIGINT, SIGTERM and SIGHUP, also where they were to be ignored, as shells ask of background processes.

    Before `Interrupts.only_count` they raise KeyboardInterrupt too. Where that lands in a library that makes another
    exception of it, or swallows it, KeyboardInterrupt is what comes out of here all the same, or the count tells.
    Does nothing in threads other than the main one, which get no signals.

    Examples
    --------
    >>> import signal
    >>> with counted_interrupts() as interrupts:
    ...     interrupts.only_count()
    ...     signal.raise_signal(signal.SIGTERM)
    ...     print(interrupts.count)
    1
    """
    interrupts = Interrupts()
    with _handled_by(interrupts.note):
        try:
            yield interrupts
        except Exception:
            if interrupts.have_raised:
                raise KeyboardInterrupt from None
            raise


@contextmanager
def first_interrupt(stop: Callable[[], None]) -> Iterator[None]:
    """Call ``stop`` at the first SIGINT, SIGTERM or SIGHUP meanwhile, and raise KeyboardInterrupt at the next.

    Does nothing in threads other than the main one, which get no signals.
    """
    asked = False

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        stop()

    with _handled_by(interrupt):
        yield


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Let a function handle the signals meanwhile, the first SIGHUP only.

    That a terminal has gone is said by the kernel and again by its shell, that a launching process was killed once for
    each of its threads: one stop request all the same.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    hung_up = False

    def handle(number: int, frame: FrameType | None) -> None:
        nonlocal hung_up
        if number == _HANG_UP:
            if hung_up:
                return
            hung_up = True
        handler(number, frame)

    wanted = [number for number in _SIGNALS if not _outlives(number)]
    before = {number: signal.signal(number, handle) for number in wanted}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier if earlier is not None else signal.SIG_DFL)


def _outlives(number: signal.Signals) -> bool:
    """Return whether this is the end of a terminal, which a program started with ``nohup`` is to outlive."""
    return number == _HANG_UP and signal.getsignal(number) == signal.SIG_IGN
