"""Keys of a terminal, one by one."""

from __future__ import annotations

import os
import re
import select
import shutil
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import suppress
from types import TracebackType

from dqcontrol.devices.jog import END
from dqcontrol.errors import Error

_ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[ -/]*[@-~]|O.|)")  # what arrows and the like send


class Keyboard:
    """The terminal's keys, unseen and without return, and its lines; at the end the terminal is as it was before.

    Ctrl-C stays an interrupt; Ctrl-Z and Ctrl-S, which would leave a robot alone, do nothing.

    Raises
    ------
    Error
        If input and output are no terminal.
    """

    def __init__(self) -> None:
        if not (sys.stdin and sys.stdin.isatty() and sys.stdout.isatty()):
            raise Error("keyboard: needs a terminal; input and output may not be files or pipes")
        try:
            import termios
        except ImportError:
            raise Error("keyboard: needs a terminal of Linux or macOS") from None
        self._termios, self._input, self._shown = termios, sys.stdin.fileno(), ""

    def __enter__(self) -> Keyboard:
        termios = self._termios
        self._before = termios.tcgetattr(self._input)
        raw = termios.tcgetattr(self._input)
        raw[0] &= ~termios.IXON
        raw[3] &= ~(termios.ICANON | termios.ECHO)
        raw[6][termios.VMIN], raw[6][termios.VTIME], raw[6][termios.VSUSP] = 1, 0, b"\0"
        termios.tcsetattr(self._input, termios.TCSAFLUSH, raw)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._write("\r\x1b[J")
        with suppress(self._termios.error):  # the terminal is gone
            self._termios.tcsetattr(self._input, self._termios.TCSAFLUSH, self._before)

    def until(self, deadline: float) -> Iterator[str]:
        """Give keys as they come until a time (s, of ``time.monotonic``); ``END`` if the terminal is gone."""
        while select.select([self._input], [], [], max(deadline - time.monotonic(), 0.0))[0]:
            try:
                typed = os.read(self._input, 1024)
            except OSError:
                typed = b""
            yield from _ESCAPES.sub("", typed.decode("utf-8", "ignore")).lower() if typed else END
            if time.monotonic() >= deadline:
                return

    def show(self, text: str) -> None:
        """Replace the text that changes, on as many lines as it takes, unless the terminal is too slow just now."""
        if text != self._shown and select.select([], [sys.stdout], [], 0.0)[1]:
            self._shown = text
            lines = textwrap.wrap(text, max(shutil.get_terminal_size().columns - 1, 1))
            # the next text begins where this one did
            up = f"\x1b[{len(lines) - 1}A" if len(lines) > 1 else ""
            self._write("\r\x1b[J" + "\n".join(lines) + up)

    def tell(self, line: str) -> None:
        """Print a line that stays."""
        self._shown = ""
        self._write(f"\r\x1b[J{line}\n")

    def _write(self, text: str) -> None:
        with suppress(OSError):  # the terminal is gone: the robot is to be stopped nevertheless
            sys.stdout.write(text)
            sys.stdout.flush()
