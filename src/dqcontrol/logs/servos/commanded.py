"""What a log says was commanded, as targets of the joints over time, in parts without a break."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError
from dqcontrol.logs.servos.joint_fit import Segment
from dqcontrol.logs.servos.lag_response import held, joined
from dqcontrol.logs.servos.servo_orders import MOST_DELAY

Mode = Literal["positions", "integrated", "measured"]

_FEW = 5.5  # periods: commands that are missing for less are joined linearly
_LEAST_SAMPLES = 40
_COPY = 1e-9  # rad or m
_MOVED = 1e-3  # rad or m, a joint that moves
_DEGREES, _NEAR = 180 / np.pi, 0.25  # a factor between columns, and how near to it


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

    def check(self, names: Sequence[str]) -> None:
        """Raise `FileFormatError` where what is called a command of a joint is none, or its unit is another one."""
        if (np.ptp(self.command, axis=0) < _COPY).all():
            raise FileFormatError(f"{self.path}: no command ever changes: nothing can be told of the servos")
        if not self.are_positions:
            return
        for i, name in enumerate(names):
            moved, asked = float(np.ptp(self.q[:, i])), float(np.ptp(self.command[:, i]))
            if len(self.time) == len(self.command_time) and moved > _COPY:
                away = np.abs(self.q[:, i] - self.command[:, i]).max()
                if away < _COPY:
                    raise FileFormatError(
                        f"{self.path}: {name}: the commanded positions are a copy of the measured ones, in all "
                        f"{len(self.time)} samples; give those that were sent"
                    )
            ratio = asked / moved if moved > _MOVED else 0.0
            for factor, units in (
                (_DEGREES, "degrees beside radians"),
                (1 / _DEGREES, "radians beside degrees"),
            ):
                if abs(ratio / factor - 1) < _NEAR:
                    k = int(np.argmax(np.abs(self.command[:, i])))
                    raise FileFormatError(
                        f"{self.path}: {name}: its commands move {ratio:.3g} times as far as it does, as "
                        f"{self.command[k, i]:.4g} at {self.command_time[k]:.4g} s: {units}? name the units behind "
                        "the columns, as r1 [deg]"
                    )


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
