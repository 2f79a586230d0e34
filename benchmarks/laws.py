"""What a step of every law costs beside one of law K, compiled and from Python, and what its preparation costs.

The last lines are those of bodies with a drive, for which a step from Python shall cost less than three times as much.
"""

from __future__ import annotations

import os
import platform
from functools import partial

import numba
import numpy as np
from measure import medians
from msgspec.structs import replace

import dqcontrol as dqc
from dqcontrol import controller, laws
from dqcontrol.loop import close_loop
from dqcontrol.plants import Integrator
from dqcontrol.tables import Column, Table
from dqcontrol_theses import variants

STEPS, PERIOD = 3000, 0.008
START = np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
GAIN = 25.0  # with these weights and gains all laws decay at 25 1/s
H_INFINITY = laws.HInfinity(orientation_gain=2 * GAIN, translation_gain=GAIN)
TRACKING = laws.HInfinityTracking(orientation_gain=2 * GAIN, translation_gain=GAIN)
DUAL_QUATERNION = laws.LinearQuadraticDQ(error_weight=GAIN**2, control_weight=1.0)

LAWS = {
    "K": laws.Proportional(gain=GAIN),
    "K, gain over time": laws.Proportional(gain=laws.Schedule([0, STEPS * PERIOD], [5.0, GAIN])),
    "K+FF": laws.ProportionalFeedforward(gain=GAIN),
    "open loop": laws.OpenLoop(),
    "classic": variants.ClassicProportional(gain=GAIN),
    "decoupled": laws.DecoupledProportional(gain=GAIN),
    "position only": laws.PartialProportional(part="position", gain=GAIN),
    "HIR, right": H_INFINITY,
    "HIR, left": replace(H_INFINITY, form="left"),
    "HIRT, right": TRACKING,
    "HIRT, left": replace(TRACKING, form="left"),
    "LQR-R8": laws.LinearQuadraticR8(error_weight=GAIN**2, control_weight=1.0),
    "LQR-DQ, log": DUAL_QUATERNION,
    "LQR-DQ, sin": replace(DUAL_QUATERNION, form="sin"),
}

LINEARIZATION = laws.FeedbackLinearization(stiffness=GAIN**2, damping=GAIN)
DRIVING = {"K": LAWS["K"], "feedback linearisation, best heading": LINEARIZATION}


class Task:
    """A law that drives a robot along a circle."""

    def __init__(self, robot: dqc.robots.Robot, start: np.ndarray, law: laws.Law) -> None:
        self.robot, self.start, self.law = robot, start, law
        self.circle = dqc.references.Circle(robot.fkm(start), radius=0.07, duration=STEPS * PERIOD)
        self.samples = self.circle.samples(PERIOD * np.arange(STEPS))
        self.ready = self.prepare()
        sample, state = self.circle.at(STEPS * PERIOD / 2), self.ready.initial_state(start)
        self.call = partial(self.ready.command, start, sample, state, np.empty(robot.input_size))

    def prepare(self) -> controller.Controller:
        """Make the law ready."""
        return self.law.prepare(self.robot, self.circle, PERIOD)

    def rollout(self) -> None:
        """Run the compiled loop."""
        close_loop(self.ready, Integrator().start(self.robot, self.start, PERIOD, STEPS, 0), self.samples)


def tasks() -> dict[str, Task]:
    """Return all by their names."""
    arm, john = dqc.load_robot("iiwa7"), dqc.load_robot("little-john")
    assert isinstance(arm, dqc.SerialArm)
    drive = dqc.DifferentialDrive(wheel_radius=0.065, half_track=0.13)
    car = dqc.CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.6)
    bodies = {
        "little-john": (john, np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])),
        "iiwa7 on a drive": (dqc.WholeBody([drive, arm]), np.hstack([np.zeros(3), START])),
        "iiwa7 on a car": (dqc.WholeBody([car, arm]), np.hstack([np.zeros(3), START])),
    }
    found = {name: Task(arm, START, law) for name, law in LAWS.items()}
    for body, (robot, start) in bodies.items():
        found |= {f"{body}: {name}": Task(robot, start, law) for name, law in DRIVING.items()}
    return found


def table() -> Table:
    found = tasks()
    steps = medians({name: task.rollout for name, task in found.items()}, 1)
    calls = medians({name: task.call for name, task in found.items()}, 500)
    preparations = medians({name: task.prepare for name, task in found.items()}, 1)
    columns = [
        Column("Law"),
        Column("Compiled step", "ns", ".0f"),
        Column("÷ K", "", ".2f"),
        Column("Command from Python", "µs", ".2f"),
        Column("÷ K", "", ".2f"),
        Column("Preparation", "ms", ".2f"),
    ]
    rows = [
        [
            name,
            1e3 / STEPS * steps[name],
            steps[name] / steps["K"],
            calls[name],
            calls[name] / calls["K"],
            1e-3 * preparations[name],
        ]
        for name in found
    ]
    return Table(columns, rows)


def sampling() -> str:
    """Say what a sample of a reference takes beside the step that it is for."""
    arm = dqc.load_robot("iiwa7")
    assert isinstance(arm, dqc.SerialArm)
    task, count, rounds = Task(arm, START, LAWS["K"]), 100_000, 1000
    circle, times = task.circle, np.linspace(0, STEPS * PERIOD, count)
    many = dqc.references.Repeat(circle, rounds)
    found = medians(
        {
            "K": task.rollout,
            "circle": partial(circle.samples, times),
            f"{rounds} repeats of it": partial(many.samples, rounds * times),
        },
        1,
    )
    step = found.pop("K") / STEPS
    return ", ".join(
        f"{name} {1e3 * us / count:.0f} ns, {us / count / step:.2f} K" for name, us in found.items()
    )


if __name__ == "__main__":
    print(table().markdown(), end="")
    print(f"A sample of a reference: {sampling()} (≤ 1 wanted)")
    print(
        f"7 joints, {STEPS} samples of {PERIOD:g} s, medians of times in turns, ≤ 1.3 K wanted, < 3 with a drive; "
        f"dqcontrol {dqc.__version__}, Numba {numba.__version__}, NumPy {np.__version__}, "
        f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} cores"
    )
