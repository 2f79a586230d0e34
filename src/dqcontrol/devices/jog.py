"""Driving a robot by the keys of a terminal, and keeping the poses that it is brought to."""

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

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import Error
from dqcontrol.loop.live import Live
from dqcontrol.references.points import PointsWriter

# Axis of the twist (linear, then angular) and direction: forward, left, up; turns by the right hand.
MOVES = {
    "w": (0, 1),
    "s": (0, -1),
    "a": (1, 1),
    "d": (1, -1),
    "r": (2, 1),
    "f": (2, -1),
    "l": (3, 1),
    "j": (3, -1),
    "i": (4, 1),
    "k": (4, -1),
    "u": (5, 1),
    "o": (5, -1),
}
END = "q"
HELP = (
    "hold to move   w s  x   a d  y   r f  z     to turn   l j  x   i k  y   u o  z",
    "+ - faster, slower    h axes of end effector or base    p keep this pose",
    "space stop    g resume after a stop    q quit, also by c or Ctrl-C",
)
_ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[ -/]*[@-~]|O.|)")  # what arrows and the like send


class Jog:
    """What keys do to a robot: one moves the end effector while it repeats.

    Parameters
    ----------
    live
        The robot; its speeds are the fastest.
    poses
        What keeps poses; none are kept if omitted.

    Attributes
    ----------
    share
        Of the fastest speeds, that keys ask for.
    of_hand
        Whether they mean the axes of the end effector, or those of the base.
    """

    live: Live
    share: float
    of_hand: bool

    def __init__(self, live: Live, poses: PointsWriter | None = None) -> None:
        self.live, self._poses = live, poses
        self.share, self.of_hand = 0.5, False

    @property
    def status(self) -> str:
        """Where the end effector is, what keys mean, and what the robot does."""
        live = self.live
        x, y, z = translation(live.robot.fkm(live.plant.measured))
        keys = f"{self.share * live.speeds.linear:.2g} m/s {self.share * live.speeds.angular:.2g} rad/s"
        axes = "hand" if self.of_hand else "base"
        return f"x {x:+.3f} y {y:+.3f} z {z:+.3f} m  {keys}  {axes} axes  {live.condition}"

    def press(self, key: str) -> str:
        """Do what a key says; return what there is to tell, if anything. Keys without a meaning do nothing."""
        if key in MOVES:
            self._move(*MOVES[key])
        elif key in ("+", "-"):
            self.share = min(1.0, max(1 / 64, self.share * (2.0 if key == "+" else 0.5)))
        elif key == "h":
            self.of_hand = not self.of_hand
        elif key == " ":
            self.live.stop()
        elif key in (END, "c"):
            self.live.end()
        elif key in ("g", "p"):
            try:
                return self._keep() if key == "p" else self._go_on()
            except Error as error:
                return str(error)
        return ""

    def _move(self, axis: int, sign: int) -> None:
        asked = np.zeros((2, 3))
        speed = (self.live.speeds.linear, self.live.speeds.angular)[axis // 3]
        asked[axis // 3, axis % 3] = sign * self.share * speed
        self.live.move(asked[0], asked[1], of_hand=self.of_hand)

    def _keep(self) -> str:
        if self._poses is None:
            return "no file for poses"
        measured = self.live.plant.measured
        joints = ", ".join(f"{angle:.6g}" for angle in measured)
        count = self._poses.add(self.live.robot.fkm(measured), f"start: [{joints}]")
        return f"pose {count} kept in {self._poses.path}"

    def _go_on(self) -> str:
        self.live.resume()
        return "resumed"


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

    def __exit__(self, *_: object) -> None:
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
