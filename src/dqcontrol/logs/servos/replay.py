"""A log beside its replay: the same commands, given to the identified servos in simulation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.experiments.run import Run, run
from dqcontrol.logs.evaluation import evaluate_log
from dqcontrol.logs.servos.commanded import CommandedLog
from dqcontrol.logs.servos.joint_motion_files import HAND, write_joint_motion
from dqcontrol.robots import Robot

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
    begin = phase + period * math.ceil(
        (max(logged.command_time[0], logged.time[0]) - phase) / period - _EARLY
    )
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
    table = np.column_stack([time, measured])
    header = ",".join(["time", *robot.joint_names])
    np.savetxt(folder / "log.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    simulated = run(folder / "replay.yaml")
    source, base_link, tip_link = robot.origin or (robot.name, None, None)
    own = evaluate_log(
        folder / "log.csv", source, folder / HAND, base_link=base_link, tip_link=tip_link, low_pass=0
    )
    simulated.save(folder / REPLAY, force=True, figures=False)
    own.save(folder / LOG, force=True, figures=False)
    late = slice(min(round(_SETTLING / period), count - 2), count)
    hands = [translation(robot.fkm(each)) for each in (measured, simulated.q[:count], targets)]
    return Replay(
        own, simulated, _rms(hands[0][late] - hands[1][late]), _rms(hands[0][late] - hands[2][late])
    )


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
