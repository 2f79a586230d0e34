"""[S17 chapter 6]: goals metres away, with the limits of joints and wheels, which S17 leaves to future work."""

from __future__ import annotations

import msgspec
import numpy as np

from dqcontrol.laws import FilteredInverse, GuidedProportional, Law
from dqcontrol.loop import Record
from dqcontrol.measures import task_range
from dqcontrol.measures.tables import Cell, Column, Table
from dqcontrol.plants import Integrator, MobilePlant
from dqcontrol.references import random_goals
from dqcontrol.reproductions.catalogue import Conditions
from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.reproduced import Reproduced
from dqcontrol.reproductions.silva2017.goal_runs import (
    ALL_LIMITS,
    ARRIVED,
    COUNTED,
    JOINT_ACCELERATION,
    LIMITED,
    SECONDS,
    UNLIMITED,
    counted,
    median_final,
    run_to_goal,
    with_acceleration_limits,
)
from dqcontrol.reproductions.silva2017.random_races import BOXES, SEED, GoalBox
from dqcontrol.reproductions.silva2017.specs import OURS, S17, setting_of, verdicts
from dqcontrol.robots import WholeBody

_REMEDY = "remedy: guided K along a planned way"
_IN_PHYSICS = (S17, OURS, "classic", _REMEDY)
_INSIDE = 0.05  # of the twist asked for: a smaller share outside the range of J is none


def reproduce(conditions: Conditions, count: int = 100, in_physics: int = 20) -> Reproduced:
    """Count which goals each law reaches: without limits, with them, and with them in physics."""
    setting = setting_of("comparison")
    laws = setting.spec.law_by_label | {_REMEDY: GuidedProportional(gain=1.0)}
    tables, judged, planned = [], {}, {}
    for box in BOXES:
        rows: list[list[Cell]] = []
        progress = conditions.of(f"{box.name} goals")
        for done, (label, law) in enumerate(laws.items()):
            if progress:
                progress(done, len(laws))
            free, limited, everything, physics = _runs(box, label, law, count, in_physics)
            rows.append(_row(label, free, limited, everything, physics, setting.spec.period))
            if box.name == "far" and label in (S17, OURS):
                judged[label] = _judge(free, law)
            if box.name == "far" and label == _REMEDY:
                planned = _judge_plan(free, limited)
        if progress:
            progress(len(laws), len(laws))
        tables.append(_table(box, rows, count, in_physics))
    claims = verdicts("far-goals", judged[S17] | planned, judged[OURS])
    return Reproduced("silva2017/far-goals", [*tables, claims])


def _runs(
    box: GoalBox, label: str, law: Law, count: int, in_physics: int
) -> tuple[list[Record], list[Record], list[Record], list[Record]]:
    setting = setting_of("comparison")
    scene, period = setting.scene, setting.spec.period
    goals = scene.robot.fkm(
        random_goals(scene.robot, scene.start, count, reach=box.reach, heading=box.heading, seed=SEED)
    )
    free, limited = (
        [run_to_goal(scene.robot, scene.start, goal, law, Integrator(), period, limits) for goal in goals]
        for limits in (UNLIMITED, LIMITED)
    )
    assert isinstance(scene.robot, WholeBody)
    slow, keeping = (
        with_acceleration_limits(scene.robot),
        msgspec.structs.replace(law, constraints=ALL_LIMITS),
    )
    everything = [
        run_to_goal(slow, scene.start, goal, keeping, Integrator(), period, UNLIMITED, JOINT_ACCELERATION)
        for goal in goals
    ]
    some = goals[:in_physics] if label in _IN_PHYSICS else goals[:0]
    plant = MobilePlant()
    physics = [run_to_goal(scene.robot, scene.start, goal, law, plant, period, LIMITED) for goal in some]
    return free, limited, everything, physics


def _row(
    label: str,
    free: list[Record],
    limited: list[Record],
    everything: list[Record],
    physics: list[Record],
    period: float,
) -> list[Cell]:
    return [
        label,
        counted(free, period),
        counted(limited, period),
        median_final(limited),
        counted(everything, period),
        median_final(everything),
        counted(physics, period) if physics else "",
        median_final(physics) if physics else None,
    ]


def _table(box: GoalBox, rows: list[list[Cell]], count: int, in_physics: int) -> Table:
    columns = [
        Column("Law"),
        Column(f"Of {count}, no limits"),
        Column(f"Of {count}, limits of joints and wheels"),
        Column("Last error, median", "", ".3g"),
        Column(f"Of {count}, accelerations too, as constraints"),
        Column("Last error, median", "", ".3g"),
        Column(f"Of the first {in_physics}, with limits, in physics"),
        Column("Last error, median", "", ".3g"),
    ]
    title = (
        f"{box.name} goals of `comparison`, at most {SECONDS:g} s each: {COUNTED}. A run ends when it has been below "
        f"{ARRIVED:g} for 50 samples"
    )
    return Table(columns, rows, title)


def _judge(free: list[Record], law: Law) -> dict[str, Judgement]:
    """Judge what S17 says of the range of J, by the runs that did not arrive."""
    robot = setting_of("comparison").scene.robot
    inverse = getattr(law, "inverse", FilteredInverse())
    lost = [task_range(robot, run, inverse=inverse).share[-1] for run in free if run.error[-1] > ARRIVED]
    if not lost:
        return {"range-of-jacobian": Judgement(None, f"all {len(free)} arrive: nothing to tell")}
    inside = sum(share < _INSIDE for share in lost)
    return {
        "range-of-jacobian": Judgement(
            inside == 0,
            f"{len(lost)} of {len(free)} do not arrive, {inside} of them with the twist asked for inside the range; "
            f"median share outside {np.median(lost):.2f}",
        )
    }


def _judge_plan(free: list[Record], limited: list[Record]) -> dict[str, Judgement]:
    """Judge what S17 says of trajectories in the range of J, by the remedy, which follows one."""
    arrived = [sum(bool(run.error[-1] < ARRIVED) for run in runs) for runs in (free, limited)]
    return {
        "tracking-in-range": Judgement(
            arrived == [len(free), len(limited)],
            f"along a plan {arrived[0]} of {len(free)} arrive without limits, {arrived[1]} with them",
        )
    }
