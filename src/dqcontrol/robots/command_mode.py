"""Modes of commands, and the lag with which joints follow."""

from __future__ import annotations

from operator import add
from typing import Literal, NamedTuple, TypeAlias

CommandMode: TypeAlias = Literal["integrated", "measured"]


class Lag(NamedTuple):
    """How late joints follow targets that commands move.

    Attributes
    ----------
    times
        Time constant of each coordinate, s; empty: none.
    delays
        From command to joint, of each coordinate, s.
    """

    times: tuple[float, ...] = ()
    delays: tuple[float, ...] = ()

    @property
    def late(self) -> float:
        """The longest of time constant and delay together, s."""
        return max(map(add, self.times, self.delays), default=0.0)

    @property
    def mean(self) -> tuple[float, float]:
        """The means of time constants and delays, s."""
        n = max(len(self.times), 1)
        return sum(self.times) / n, sum(self.delays) / n


AT_ONCE = Lag()
