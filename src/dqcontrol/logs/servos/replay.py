"""A log beside its replay: the same commands, given to the identified servos in simulation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError
from dqcontrol.experiments.run import Run, run
from dqcontrol.logs.evaluation import evaluate_log
from dqcontrol.logs.servos.excitation import HAND, write_joint_motion, write_table
from dqcontrol.logs.servos.joint_fit import Segment
from dqcontrol.logs.servos.servo_orders import MOST_DELAY, held, joined
from dqcontrol.robots import Robot

Mode = Literal["positions", "integrated", "measured"]

_FEW = 5.5  # periods: commands that are missing for less are joined linearly
_LEAST_SAMPLES = 40  # fewer tell nothing of a servo
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
            as_many = len(self.time) == len(self.command_time)
            if as_many and moved > _COPY and np.abs(self.q[:, i] - self.command[:, i]).max() < _COPY:
                raise FileFormatError(
                    f"{self.path}: {name}: the commanded positions are a copy of the measured ones, in all "
                    f"{len(self.time)} samples; give those that were sent"
                )
            ratio = asked / moved if moved > _MOVED else 0.0
            is_degrees = abs(ratio / _DEGREES - 1) < _NEAR
            if is_degrees or abs(ratio * _DEGREES - 1) < _NEAR:
                k = int(np.argmax(np.abs(self.command[:, i])))
                units = "degrees beside radians" if is_degrees else "radians beside degrees"
                raise FileFormatError(
                    f"{self.path}: {name}: its commands move {ratio:.3g} times as far as it does, as "
                    f"{self.command[k, i]:.4g} at {self.command_time[k]:.4g} s: {units}? name the units behind "
                    "the columns, as r1 [deg]"
                )


def _completed(times: Array, values: Array, period: float) -> tuple[Array, Array]:
    """Return commands with those that are missing joined linearly."""
    steps, extra = np.diff(times), []
    for k in np.flatnonzero(steps > 1.5 * period):
        count = round(steps[k] / period)
        extra.append(times[k] + np.arange(1, count) * steps[k] / count)
    if not extra:
        return times, values
    all_times = np.sort(np.concatenate([times, *extra]))
    return all_times, np.interp(all_times, times, values)


LOG, REPLAY = "log", "replay"

_SETTLING = 0.5  # s that are not compared: what was commanded before is unknown
_MOST = 200_000  # periods
_EARLY = 0.5  # of a period, by which a stamp may jitter


@dataclass(frozen=True, eq=False)
class Replay:
    """The same commands on the robot and on its identified servos.

    Attributes
    ----------
    log, simulated
        Runs: of the log, against where its commands put the end effector, and of the replay.
    hand_rms
        Distance of the two end effectors, m.
    motion_rms
        How far the robot's end effector was from where its commands put it, m.
    """

    log: Run
    simulated: Run
    hand_rms: float
    motion_rms: float

    def __str__(self) -> str:
        return (
            f"replay: its end effector is {1e3 * self.hand_rms:.3g} mm RMS from the log's, which is "
            f"{1e3 * self.motion_rms:.3g} mm from where the commands put it"
        )


def save_replay(logged: CommandedLog, robot: Robot, mode: str, folder: Path) -> Replay:
    """Run the commands of a log on the servos of ``plant.yaml`` in a folder, and save both as runs there.

    Parameters
    ----------
    logged
        The log.
    robot
        As it was identified.
    mode
        What was commanded, see `Identification`.
    folder
        With ``plant.yaml``; takes ``log`` and ``replay``, folders of runs, and the files that make them.
    """
    period, phase = _clock(logged.command_time)
    first = max(logged.command_time[0], logged.time[0])
    begin = phase + period * math.ceil((first - phase) / period - _EARLY)
    count = min(int((min(logged.command_time[-1], logged.time[-1]) - begin) / period), _MOST)
    time = period * np.arange(count, dtype=np.float64)
    measured = np.column_stack([np.interp(begin + time, logged.time, each) for each in logged.q.T])
    if mode != "positions":
        moves = logged.command[:-1] * np.diff(logged.command_time)[:, None]
        reached = np.vstack([np.zeros(moves.shape[1]), np.cumsum(moves, axis=0)])
        targets = np.column_stack([np.interp(begin + time, logged.command_time, each) for each in reached.T])
        targets += measured[0] - targets[0]
    else:  # a sample's command is in force at once; that of the law leads to what the next sample wants
        row = np.searchsorted(logged.command_time, begin + time + _EARLY * period, side="right") - 1
        targets = logged.command[np.maximum(row - 1, 0)]
    plant = {"kind": "servo", "file": "plant.yaml", "rate_limit": False, "position_limit": False}
    note = "The commands of a log on the servos identified from it."
    write_joint_motion(folder / "replay.yaml", robot, time, targets, measured[0], plant, note)
    write_table(folder / "log.csv", ["time", *robot.joint_names], np.column_stack([time, measured]))
    simulated = run(folder / "replay.yaml")
    source, base_link, tip_link = robot.origin or (robot.name, None, None)
    own = evaluate_log(
        folder / "log.csv", source, folder / HAND, base_link=base_link, tip_link=tip_link, low_pass=0
    )
    simulated.save(folder / REPLAY, force=True, figures=False)
    own.save(folder / LOG, force=True, figures=False)
    late = slice(min(round(_SETTLING / period), count - 2), count)
    hands = [translation(robot.fkm(each)) for each in (measured, simulated.q[:count], targets)]
    own_hand, *others = (hand[late] for hand in hands)
    return Replay(own, simulated, *(_rms(own_hand - other) for other in others))


def _clock(stamps: Array) -> tuple[float, float]:
    """Return period and phase, s, of the clock behind stamps that jitter and may lack some.

    From the first stamp to the last one, so that no row is dropped or doubled where the median of the steps is a
    little off.
    """
    steps = np.diff(stamps)
    numbers = np.r_[0.0, np.cumsum(np.maximum(np.rint(steps / np.median(steps)), 1.0))]
    period, phase = np.polyfit(numbers, stamps, 1)
    return round(float(period), 9), float(phase)


def _rms(away: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(away**2, axis=1))))
