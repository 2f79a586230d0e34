"""The closed loop, compiled and interpreted, and what it saw."""

from collections.abc import Callable
from typing import Any

from dqcontrol.loop.clock import Clock, Timing
from dqcontrol.loop.closed_loop import close_loop
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.simulate import simulate
from dqcontrol.loop.supervision import Supervision
from dqcontrol.loop.trace import Stop, Trace
from dqcontrol.moved import names_moved_from

__all__ = [
    "Clock",
    "Record",
    "Signal",
    "Stop",
    "Supervision",
    "Timing",
    "Trace",
    "close_loop",
    "simulate",
]

__getattr__: Callable[[str], Any] = names_moved_from(__name__)
