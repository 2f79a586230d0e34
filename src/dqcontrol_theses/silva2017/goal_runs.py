"""Runs to many random goals, with and without the robot's limits, on ideal joints and in physics."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.laws import GuidedProportional, Law
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, Stop, simulate
from dqcontrol.plants import Integrator, Plant
from dqcontrol.references import POSE, DriveTo, Reference, SetPoint
from dqcontrol.robots import Robot, WholeBody
from dqcontrol_theses.silva2017.race import RaceOutcome

SECONDS = 120.0
ARRIVED = 1e-3  # last error norm of a run that has arrived
UNLIMITED = CommandLimits(velocity=False)
LIMITED = CommandLimits(position=ModifiedClamping(), velocity=True)  # of joints and wheels
COUNTED = "first below 0.04, below it for good, below 0.001 at the end"
JOINT_ACCELERATION, BASE_ACCELERATION, BASE_TURN_ACCELERATION = 2.0, 0.5, 2.0  # rad/s², m/s², rad/s²; assumed
ALL_LIMITS = Constraints(acceleration=JOINT_ACCELERATION, self_collision=False)
_AFTERWARDS = 60.0  # s; S17's law takes up to that to settle
_RIM_LEVER = 5  # column of `Robot.drives`: how much faster a rim is for each rad/s of turning, m
_SAMPLES = 50  # in a row below `ARRIVED` end a run


def with_acceleration_limits(body: WholeBody) -> WholeBody:
    """Return a body whose base, its first part, speeds up and turns no faster than we assume."""
    base, *others = body.parts
    limited = replace(  # every base has both fields
        base,  # pyright: ignore[reportArgumentType]
        acceleration=BASE_ACCELERATION,
        turn_acceleration=BASE_TURN_ACCELERATION,
    )
    return WholeBody([limited, *others], body.name, body.form)


def beyond_limits(robot: Robot, record: Record, period: float) -> float:
    """Return by which share positions, velocities, rims or accelerations go beyond all limits at most."""
    u, limits = record.command[:-1], robot.limits
    changes = np.abs(np.diff(u, axis=0, prepend=0.0)) / period
    shares = [
        np.abs(u) / limits.velocity,
        changes / robot.acceleration_limits("acceleration", JOINT_ACCELERATION),
    ]
    for k, drive in enumerate(robot.drives):
        v = int(drive[0]) - k
        shares.append((np.abs(u[:, v]) + drive[_RIM_LEVER] * np.abs(u[:, v + 1])) / limits.velocity[v])
    beyond = max(0.0, *(float(each.max()) - 1 for each in shares))
    return max(beyond, float(np.maximum(limits.lower - record.q, record.q - limits.upper).max()))


def run_to_goal(
    robot: Robot,
    start: Array,
    goal: Array,
    law: Law,
    plant: Plant,
    period: float,
    limits: CommandLimits,
    acceleration: float | None = None,
) -> Record:
    """Return a run to a hand pose, judged by its distance from that; `GuidedProportional` along a plan.

    An acceleration, rad/s², is that of the plan's joints.
    """
    reference: Reference = SetPoint(goal)
    stop, seconds = Stop(error=ARRIVED, samples=_SAMPLES), SECONDS
    if isinstance(law, GuidedProportional):
        reference = DriveTo.pose(robot, start, goal, acceleration=acceleration)
        stop, seconds = None, reference.duration + period * _SAMPLES
    record = simulate(robot, reference, law, plant, start, period, seconds, limits=limits, stop=stop)
    desired = record.desired.copy()
    desired[:, POSE] = goal
    return replace(record, desired=desired)


def run_along_plan(robot: Robot, start: Array, goal: Array, law: Law, period: float) -> Record:
    """Return a run that tracks a planned way to a hand pose on ideal joints, and stays there for a minute."""
    way = DriveTo.pose(robot, start, goal)
    return simulate(
        robot, way, law, Integrator(), start, period, way.duration + _AFTERWARDS, limits=UNLIMITED
    )


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
