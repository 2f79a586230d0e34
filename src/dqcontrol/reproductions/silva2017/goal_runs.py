"""Runs to many random goals, with and without the robot's limits, on ideal joints and in physics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.laws import GuidedProportional, Law
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, Stop
from dqcontrol.loop.simulate import simulate
from dqcontrol.plants import Plant
from dqcontrol.references import DriveTo, Reference, SetPoint
from dqcontrol.references.sample import POSE
from dqcontrol.reproductions.silva2017.race import RaceOutcome
from dqcontrol.robots import Robot

SECONDS = 120.0
ARRIVED = 1e-3  # last error norm of a run that has arrived
UNLIMITED = CommandLimits(velocity=False)
LIMITED = CommandLimits(position=ModifiedClamping(), velocity=True)  # of joints and wheels
COUNTED = "first below 0.04, below it for good, below 0.001 at the end"
_SAMPLES = 50  # in a row below `ARRIVED` end a run


def run_to_goal(
    robot: Robot, start: Array, goal: Array, law: Law, plant: Plant, period: float, limits: CommandLimits
) -> Record:
    """Return a run to a hand pose, judged by its distance from that; `GuidedProportional` along a plan."""
    reference: Reference = SetPoint(goal)
    stop, seconds = Stop(error=ARRIVED, samples=_SAMPLES), SECONDS
    if isinstance(law, GuidedProportional):
        reference = DriveTo.pose(robot, start, goal)
        stop, seconds = None, reference.duration + period * _SAMPLES
    record = simulate(robot, reference, law, plant, start, period, seconds, limits=limits, stop=stop)
    desired = record.desired.copy()
    desired[:, POSE] = goal
    return replace(record, desired=desired)


def counted(outcomes: Sequence[RaceOutcome]) -> str:
    """Return of how many runs the error was first below 0.04, below it for good, and below 0.001 at the end."""
    first = sum(math.isfinite(each.first_below) for each in outcomes)
    settled = sum(math.isfinite(each.settling) for each in outcomes)
    return f"{first}, {settled}, {sum(has_arrived(each) for each in outcomes)}"


def has_arrived(outcome: RaceOutcome) -> bool:
    """Tell whether the last error of a run is small enough."""
    return outcome.final < ARRIVED


def median_final(outcomes: Sequence[RaceOutcome]) -> float:
    """Return the median of the last errors."""
    return float(np.median([each.final for each in outcomes]))
