"""What a log says was commanded, as targets of the joints over time, in parts without a break."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError
from dqcontrol.logs.servos.joint_fit import MOST_DELAY, Segment
from dqcontrol.logs.servos.lag_response import held, joined

Mode = Literal["positions", "integrated", "measured"]

_FEW = 5.5  # periods: commands that are missing for less are joined linearly
_LEAST_SAMPLES = 40
_COPY = 1e-9  # rad or m


@dataclass(frozen=True, eq=False)
class CommandedLog:
    """A log with commands.

    Attributes
    ----------
    path
        The file.
    time
        Of the measured positions, shape (N,), s.
    q
        Measured positions, shape (N, n), rad or m.
    command_time
        Shape (K,), s on the same clock.
    command
        Commanded positions or velocities, shape (K, n).
    are_positions
        Which of the two.
    """

    path: Path
    time: Array
    q: Array
    command_time: Array
    command: Array
    are_positions: bool

    @property
    def period(self) -> float:
        """Median time between commands, s."""
        return float(np.median(np.diff(self.command_time)))

    @property
    def modes(self) -> tuple[Mode, ...]:
        """What its commands may be."""
        return ("positions",) if self.are_positions else ("integrated", "measured")

    def segments(self, joint: int, mode: Mode, torque: Array | None) -> list[Segment]:
        """Return the parts of one joint; ``torque`` (N, n) of gravity at the measured positions."""
        period, breaks = self.period, np.flatnonzero(np.diff(self.command_time) > _FEW * self.period)
        found = []
        for rows in np.split(np.arange(len(self.command_time)), breaks + 1):
            if len(rows) < 2:
                continue
            begin, end = self.command_time[rows[0]], self.command_time[rows[-1]] + period
            inside = np.flatnonzero((self.time >= begin + MOST_DELAY) & (self.time <= end))
            if len(inside) < _LEAST_SAMPLES:
                continue
            times, values = _completed(self.command_time[rows], self.command[rows, joint], period)
            if mode != "positions":
                moves = values * np.append(np.diff(times), period)
                seen = np.interp(times, self.time, self.q[:, joint])
                values = seen[0] + np.cumsum(moves) if mode == "integrated" else seen + moves
            near = np.flatnonzero((self.time >= begin) & (self.time <= end))
            load = None
            if torque is not None and np.ptp(torque[near, joint]) > 1e-6:
                load = joined(self.time[near], torque[near, joint])
            found.append(Segment(held(times, values), self.time[inside], self.q[inside, joint], load))
        if any(each.torque is None for each in found):
            found = [each._replace(torque=None) for each in found]
        return found

    def check(self) -> None:
        """Raise `FileFormatError` where what is called a command is none."""
        if self.are_positions and len(self.time) == len(self.command_time):
            moving = np.ptp(self.q, axis=0) > _COPY
            same = np.abs(self.q - self.command).max(axis=0) < _COPY
            if moving.any() and same[moving].all():
                raise FileFormatError(
                    f"{self.path}: the commanded positions are a copy of the measured ones; give those that were sent"
                )
        if (np.ptp(self.command, axis=0) < _COPY).all():
            raise FileFormatError(f"{self.path}: no command ever changes: nothing can be told of the servos")


def _completed(times: Array, values: Array, period: float) -> tuple[Array, Array]:
    """Return commands with those that are missing joined linearly."""
    steps = np.diff(times)
    wide = np.flatnonzero(steps > 1.5 * period)
    extra = [
        times[k] + np.arange(1, round(steps[k] / period)) * steps[k] / round(steps[k] / period) for k in wide
    ]
    if not extra:
        return times, values
    all_times = np.sort(np.concatenate([times, *extra]))
    return all_times, np.interp(all_times, times, values)
