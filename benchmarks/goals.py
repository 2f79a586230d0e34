"""How many of 100 random goals the laws of mobile manipulators reach, with and without joint and wheel limits.

A goal is the hand's pose at a configuration drawn by `dqcontrol.references.random_goals` (seed 1): the base within a
box and a range of headings around its start, the arm around its start or anywhere within its limits, the hand at least
5 cm above the floor. Reached: |1 − x*x_d| < 1e-3 for the last 50 samples, 100 s at most.
"""

from __future__ import annotations

import math
import time

import numpy as np

import dqcontrol as dqc
from dqcontrol import laws
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, Stop
from dqcontrol.measures import task_range
from dqcontrol.plants import Integrator
from dqcontrol.references import DriveTo, Reference, SetPoint, random_goals
from dqcontrol.tables import Column, Table
from dqcontrol_theses import variants

ROBOT, PERIOD, SEED, COUNT = "little-john", 0.05, 1, 100
HOME = np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
REACHED, SAMPLES = 1e-3, 50
LIMITS = CommandLimits(position=ModifiedClamping(), velocity=True)
LAWS = {
    "published: feedback linearisation, F": variants.PublishedLinearization(stiffness=1.0, damping=1.0),
    "the same, constrained Jacobian": laws.FeedbackLinearization(stiffness=1.0, damping=1.0, null_space=None),
    "the same, best heading (default)": laws.FeedbackLinearization(stiffness=1.0, damping=1.0),
    "cascade": variants.Cascade(stiffness=1.0, damping=1.0),
    "classic": variants.ClassicWholeBody(gain=0.5),
    "K": laws.Proportional(gain=0.5),
    "K, best heading": laws.Proportional(gain=0.5, null_space=laws.BestHeading()),
    "guided K along a planned way": laws.GuidedProportional(gain=1.0),
}
GOALS = {
    "near": {"reach": 0.5, "heading": math.pi / 4, "arm": 0.5},
    "near, any arm": {"reach": 0.5, "heading": math.pi / 4},
    "far": {"reach": 1.5, "arm": 0.5},
    "far, any arm": {"reach": 1.5},
}


def follow(robot: dqc.WholeBody, law: laws.Law, goal: np.ndarray, limits: CommandLimits | None) -> Record:
    """Return a run to a goal, which ends when it is reached."""
    reference: Reference = SetPoint(goal)
    stop, seconds = Stop(error=REACHED, samples=SAMPLES), 100.0
    if isinstance(law, laws.GuidedProportional):
        reference = DriveTo.pose(robot, HOME, goal)
        stop, seconds = None, reference.duration + PERIOD * SAMPLES
    return dqc.simulate(robot, reference, law, Integrator(), HOME, PERIOD, seconds, limits=limits, stop=stop)


def row(robot: dqc.WholeBody, law: laws.Law, goals: np.ndarray) -> list[float | None]:
    """Return rates, median time, and how much of the error that is left lies outside what the robot can do."""
    cells: list[float | None] = []
    for limits in (None, LIMITS):
        runs = [follow(robot, law, goal, limits) for goal in goals]
        reached = [bool((run.error[-SAMPLES:] < REACHED).all()) for run in runs]
        times = [run.duration - PERIOD * SAMPLES for run, done in zip(runs, reached, strict=True) if done]
        ranges = [
            task_range(robot, run, inverse=getattr(law, "inverse", laws.FilteredInverse())) for run in runs
        ]
        lost = [found.share[-1] for found, done in zip(ranges, reached, strict=True) if not done]
        cells += [sum(reached), *(float(np.median(each)) if each else None for each in (times, lost))]
    return cells


def table(robot: dqc.WholeBody, goals: np.ndarray) -> Table:
    """Return a row for each law."""
    columns = [Column("Law")]
    for title in ("no limits", "joint and wheel limits"):
        columns += [
            Column(f"Reached, {title}", "of 100", ".0f"),
            Column("Median time", "s", ".1f"),
            Column("Failed: error outside the range of J", "median share", ".2f"),
        ]
    return Table(columns, [[name, *row(robot, law, goals)] for name, law in LAWS.items()])


def main() -> None:
    """Print all tables."""
    robot, begin = dqc.load_robot(ROBOT), time.perf_counter()
    assert isinstance(robot, dqc.WholeBody)
    for name, ranges in GOALS.items():
        goals = robot.fkm(random_goals(robot, HOME, COUNT, **ranges, seed=SEED))
        print(f"{name}: {ranges}\n\n{table(robot, goals).markdown()}")
    print(f"{ROBOT}, T = {PERIOD:g} s, seed {SEED}, {time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()
