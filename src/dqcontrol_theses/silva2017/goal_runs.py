"""Runs to goals as [S17] judges them, with and without the robot's limits, on ideal joints and in physics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.laws import GuidedProportional, Law
from dqcontrol.limits import CommandLimits, ModifiedClamping
from dqcontrol.loop import Record, Stop, part_of, simulate, simulate_prepared
from dqcontrol.measures import evaluate
from dqcontrol.plants import Integrator, Plant
from dqcontrol.references import POSE, DriveTo, Reference, SetPoint
from dqcontrol.robots import Robot, WholeBody
from dqcontrol_theses.printed import PRINTED_INVERSE
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH

SECONDS = 120.0
ARRIVED = 1e-3  # last error norm of a run that has arrived
UNLIMITED = CommandLimits(velocity=False)
LIMITED = CommandLimits(position=ModifiedClamping(), velocity=True)  # of joints and wheels
COUNTED = "first below 0.04, below it for good, below 0.001 at the end"
JOINT_ACCELERATION, BASE_ACCELERATION, BASE_TURN_ACCELERATION = 2.0, 0.5, 2.0  # rad/s², m/s², rad/s²; assumed
ALL_LIMITS = Constraints(acceleration=JOINT_ACCELERATION, self_collision=False)
_SLOWEST, _FASTEST, _HALVINGS = 0.02, 10.0, 14
_MATCHED = 0.05  # settling times that differ by less are matched [S17 5.2.2]
_AFTERWARDS = 60.0  # s; S17's law takes up to that to settle
_RIM_LEVER = 5  # column of `Robot.drives`: how much faster a rim is for each rad/s of turning, m
_SAMPLES = 50  # in a row below `ARRIVED` end a run


@dataclass(frozen=True)
class RaceOutcome:
    """What came of one run.

    Attributes
    ----------
    settling
        Iterations until the error norm stays below `GOOD_ENOUGH`; NaN if it does not. Of a run that ended when it first
        was: until then.
    first_below
        Iterations until it is first below `GOOD_ENOUGH`; NaN if it never is.
    effort
        √∫|u_f|² dt, rad/√s. [S17 Table 5.1]
    first, largest_change
        |u_f| of the first sample, and of its largest change from one sample to the next or from rest, rad/s.
    overshoot
        Of the position, as a share of the first error.
    final
        Last error norm.
    """

    settling: float
    first_below: float
    effort: float
    first: float
    largest_change: float
    overshoot: float
    final: float

    @classmethod
    def of(cls, record: Record, period: float) -> RaceOutcome:
        """Measure a whole run of a body with drives."""
        metrics = evaluate(record, tolerance=GOOD_ENOUGH)
        told = record.readings["actuator_command"].values
        changes = np.linalg.norm(np.diff(told, axis=0, prepend=np.zeros((1, told.shape[1]))), axis=1)
        below = np.flatnonzero(record.error < GOOD_ENOUGH)
        return cls(
            metrics.settling_time / period,
            float(below[0]) if len(below) else math.nan,
            metrics.effort,
            float(changes[0]),
            float(changes.max()),
            metrics.position_overshoot,
            metrics.final_error,
        )


def until_good_enough(record: Record) -> Record:
    """Return a record up to where S17 ends its runs on the robot: its first error norm below `GOOD_ENOUGH`."""
    below = np.flatnonzero(record.error < GOOD_ENOUGH)
    return part_of(record, 0, int(below[0]) + 1) if len(below) else record


def outcome(
    robot: Robot, start: Array, samples: Array, law: Law, period: float, *, as_s17: bool = False
) -> RaceOutcome:
    """Run a law on ideal joints, with S17's stop or to the end."""
    record = simulate_prepared(law.prepare(robot, None, period), Integrator(), start, samples)
    return RaceOutcome.of(until_good_enough(record) if as_s17 else record, period)


def guided_outcome(robot: Robot, start: Array, samples: Array, period: float) -> RaceOutcome:
    """Run the remedy on ideal joints: a planned way to the goal of some samples, judged by its distance from that."""
    way = DriveTo.pose(robot, start, samples[-1, POSE])
    law = GuidedProportional(gain=1.0, inverse=PRINTED_INVERSE).prepare(robot, way, period)
    record = simulate_prepared(law, Integrator(), start, way.samples(samples[:, -1]))
    return RaceOutcome.of(replace(record, desired=samples), period)


def matched_gain(settling: Callable[[float], float], target: float) -> float | None:
    """Return a gain with which a law settles within 5 % of a number of iterations; None if there is none.

    Parameters
    ----------
    settling
        Iterations that a gain takes, fewer the higher it is; NaN for those that do not end in time.
    target
        Iterations.
    """
    if not math.isfinite(target):
        return None
    low, high = math.log(_SLOWEST), math.log(_FASTEST)
    for _ in range(_HALVINGS):
        gain = math.exp((low + high) / 2)
        took = settling(gain)
        if abs(took - target) <= _MATCHED * target:
            return gain
        if took < target:
            high = math.log(gain)
        else:
            low = math.log(gain)
    return None


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
