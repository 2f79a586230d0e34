"""[S17 chapter 6]: goals metres away, with the limits of joints and wheels, which S17 leaves to future work."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.experiments import PreparedExperiment, PreparedRobot
from dqcontrol.laws import FilteredInverse, GuidedProportional, Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import Record
from dqcontrol.measures import task_range
from dqcontrol.plants import Integrator, MobilePlant, Plant
from dqcontrol.robots import WholeBody
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.printed import PRINTED_INVERSE
from dqcontrol_theses.reproduced import Reproduced
from dqcontrol_theses.silva2017.goal_runs import (
    ALL_LIMITS,
    ARRIVED,
    COUNTED,
    JOINT_ACCELERATION,
    LIMITED,
    SECONDS,
    UNLIMITED,
    RaceOutcome,
    counted,
    has_arrived,
    median_final,
    run_along_plan,
    run_to_goal,
    with_acceleration_limits,
)
from dqcontrol_theses.silva2017.random_races import BOXES, GoalBox
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, OURS, S17, setting_of, verdicts

_REMEDY = "remedy: guided K along a planned way"
_IN_PHYSICS = (S17, OURS, "classic", _REMEDY)
_INSIDE = 0.05  # of the twist asked for: a smaller share outside the range of J is none


def reproduce(conditions: Conditions, count: int = 100, in_physics: int = 20) -> Reproduced:
    """Count which goals each law reaches: without limits, with them, and with them in physics."""
    setting = setting_of("comparison")
    trials = [
        GoalTrial(box, label, count, in_physics if label in _IN_PHYSICS else 0)
        for box in BOXES
        for label in _laws(setting)
    ]
    found = dict(zip(trials, conditions.each("goals", reached, Reached, trials, setting.text), strict=True))
    tables = [
        _table(box, {trial.law: each for trial, each in found.items() if trial.box == box}, count, in_physics)
        for box in BOXES
    ]
    far = {trial.law: each for trial, each in found.items() if trial.box == BOXES[-1]}
    claims = verdicts("far-goals", *(_judge(far[label], count) for label in (S17, OURS)))
    return Reproduced("silva2017/far-goals", [*tables, claims])


class GoalTrial(NamedTuple):
    """A law, the goals that it is sent to, and how many of them in physics, too."""

    box: GoalBox
    law: str
    drawn: int
    in_physics: int


@dataclass(frozen=True)
class Reached:
    """What came of a trial.

    Attributes
    ----------
    free, limited, everything, physics
        Runs to each goal without limits, with those of joints and wheels, with accelerations too, as constraints, and
        in physics with limits of joints and wheels, as `counted` tells them.
    limited_final, everything_final, physics_final
        Medians of the last errors.
    along_plan
        How many runs without limits along a plan to the goal end below `GOOD_ENOUGH`, of S17's law and ours.
    outside
        Of runs without limits that did not, of S17's law and ours: the share of the twist asked for that was outside
        the range of J.
    """

    free: str
    limited: str
    everything: str
    physics: str
    limited_final: float
    everything_final: float
    physics_final: float | None
    along_plan: int
    outside: list[float]


def _laws(setting: PreparedExperiment) -> dict[str, Law]:
    return setting.spec.law_by_label | {_REMEDY: GuidedProportional(gain=1.0, inverse=PRINTED_INVERSE)}


def reached(trial: GoalTrial) -> Reached:
    """Run a law to the goals of a box."""
    setting = setting_of("comparison")
    scene, period = setting.scene, setting.spec.period
    law = _laws(setting)[trial.law]
    goals = trial.box.goals(scene, trial.drawn)

    def runs(plant: Plant, limits: CommandLimits, some: Array) -> Iterator[Record]:
        return (run_to_goal(scene.robot, scene.start, goal, law, plant, period, limits) for goal in some)

    free, outside = [], []
    inverse = getattr(law, "inverse", FilteredInverse())
    for run in runs(Integrator(), UNLIMITED, goals):
        free.append(RaceOutcome.of(run, period))
        if trial.law in (S17, OURS) and not has_arrived(free[-1]):
            outside.append(float(task_range(scene.robot, run, inverse=inverse).share[-1]))
    along_plan = sum(
        float(run_along_plan(scene.robot, scene.start, goal, law, period).error[-1]) < GOOD_ENOUGH
        for goal in goals
        if trial.law in (S17, OURS)
    )
    limited = [RaceOutcome.of(run, period) for run in runs(Integrator(), LIMITED, goals)]
    everything = [RaceOutcome.of(run, period) for run in _with_all_limits(scene, law, goals, period)]
    physics = [RaceOutcome.of(run, period) for run in runs(MobilePlant(), LIMITED, goals[: trial.in_physics])]
    return Reached(
        counted(free),
        counted(limited),
        counted(everything),
        counted(physics) if physics else "",
        median_final(limited),
        median_final(everything),
        median_final(physics) if physics else None,
        along_plan,
        outside,
    )


def _with_all_limits(scene: PreparedRobot, law: Law, goals: Array, period: float) -> Iterator[Record]:
    """Run to each goal within the limits of joints, wheels and accelerations, as constraints of the law."""
    assert isinstance(scene.robot, WholeBody)
    robot = with_acceleration_limits(scene.robot)
    keeping = msgspec.structs.replace(law, constraints=ALL_LIMITS)
    for goal in goals:
        yield run_to_goal(
            robot, scene.start, goal, keeping, Integrator(), period, UNLIMITED, JOINT_ACCELERATION
        )


def _table(box: GoalBox, found: dict[str, Reached], count: int, in_physics: int) -> Table:
    median = Column("Last error, median", "", ".3g")
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Law"), law),
            (Column(f"Of {count}, no limits"), each.free),
            (Column(f"Of {count}, limits of joints and wheels"), each.limited),
            (median, each.limited_final),
            (Column(f"Of {count}, accelerations too, as constraints"), each.everything),
            (median, each.everything_final),
            (Column(f"Of the first {in_physics}, with limits, in physics"), each.physics),
            (median, each.physics_final),
        ]
        for law, each in found.items()
    ]
    title = (
        f"{box.name} goals of `comparison`, at most {SECONDS:g} s each: {COUNTED}. A run ends when it has been below "
        f"{ARRIVED:g} for 50 samples"
    )
    return Table.of(rows, title)


def _judge(found: Reached, count: int) -> dict[str, Judgement]:
    """Judge what S17 says of the range of J: by runs that did not arrive, and by those along a trajectory in it."""
    lost = found.outside
    inside = sum(share < _INSIDE for share in lost)
    number, why_not = f"all {count} arrive: nothing to tell", ""
    if lost:
        number = (
            f"{len(lost)} of {count} do not arrive, {inside} of them with the twist asked for inside the range; "
            f"median share outside {np.median(lost):.2f}"
        )
        why_not = "it says what is necessary, not what is enough"
    along = f"along a plan {found.along_plan} of {count} end below {GOOD_ENOUGH}"
    return {
        "range-of-jacobian": Judgement(None, number, why_not),
        "tracking-in-range": Judgement(found.along_plan == count, along),
    }
