"""[S17 chapter 2]: the laws that S17 cites, on the goal of its comparison and on random ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dqcontrol import figures
from dqcontrol.experiments import prepare
from dqcontrol.laws import Law
from dqcontrol.loop import Record, simulate
from dqcontrol.plants import Integrator
from dqcontrol.references import Sample, SetPoint
from dqcontrol.robots import Robot
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.goal_runs import (
    COUNTED,
    LIMITED,
    UNLIMITED,
    RaceOutcome,
    counted,
    run_to_goal,
    until_good_enough,
)
from dqcontrol_theses.silva2017.parsimonious import parsimonious_law
from dqcontrol_theses.silva2017.pictures import told_inputs
from dqcontrol_theses.silva2017.random_races import BOXES, GoalBox
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, S17, setting_of, spec_data, verdicts

PARSIMONIOUS = "parsimonious, Gonçalves et al. 2016"
_SILVA, _SALAZAR = "cascade, Silva and Adorno 2016", "cascade, Salazar-Sangucho and Adorno 2014"
_PROJECTED, _REDUCED, _LEAST = "projected gradient", "reduced gradient", "least inputs"
_GAIN = 0.5  # 1/s
_RESTING, _ASIDE = 5.0, 0.8  # s, rad
_LIMITS = {False: "no limits", True: "limits of joints and wheels"}
_MOVES = 1e-3  # of the largest input of a sample: an input that is smaller rests


def reproduce(conditions: Conditions, count: int = 100, programs: int = 10) -> Reproduced:
    """Run the cited laws; of `count` random goals the linear program, which is slow, is run to the first few."""
    data = spec_data("baselines")
    setting = prepare(data)
    scene, spec = setting.scene, setting.spec
    study = conditions.run_study("baselines", data)
    records = {label.partition(" · ")[0]: run.record for label, run in study.runs.items()}
    records[PARSIMONIOUS] = simulate(
        scene.robot,
        scene.reference,
        parsimonious_law(scene.robot, _GAIN),
        Integrator(),
        scene.start,
        spec.period,
        spec.duration,
    )
    numbers = dict.fromkeys(spec.law_by_label, count) | {PARSIMONIOUS: min(count, programs)}
    tables = [
        _table(scene.robot, records, spec.period),
        _goals_table(numbers, count, conditions),
        verdicts("baselines", _judge(scene.robot, records, spec.period)),
    ]
    return Reproduced("silva2017/baselines", tables, {"baselines": study}, _figures(records))


def inputs_that_move(record: Record) -> float:
    """Return how many inputs move at a time, the mean over the samples before the error is first below 0.04."""
    command = np.abs(until_good_enough(record).command)
    return float((command > _MOVES * command.max(axis=1, keepdims=True)).sum(axis=1).mean())


def off_middle(robot: Robot, record: Record) -> np.ndarray:
    """Return H over time: the mean squared distance of joints from the middle of their range, 1 at their limits."""
    bounded = np.isfinite(robot.limits.lower)
    lower, upper = robot.limits.lower[bounded], robot.limits.upper[bounded]
    return (((2 * record.q[:, bounded] - lower - upper) / (upper - lower)) ** 2).mean(axis=1)


def _table(robot: Robot, records: dict[str, Record], period: float) -> Table:
    def row(label: str, record: Record) -> list[tuple[Column, Cell]]:
        first, whole = (RaceOutcome.of(each, period) for each in (until_good_enough(record), record))
        arrived = math.isfinite(first.settling)
        return [
            (Column("Law"), label),
            (Column(f"Iterations to first below {GOOD_ENOUGH}", "", ".4g"), first.settling),
            (Column("Until it stays below", "", ".4g"), whole.settling),
            (Column("Effort until first below", "rad/√s", ".3g"), first.effort if arrived else None),
            (Column("First command |u_f|", "rad/s", ".3g"), whole.first),
            (Column("Largest change of u_f", "rad/s", ".3g"), whole.largest_change),
            (Column("Inputs that move at a time, of 7", "", ".2f"), inputs_that_move(record)),
            (Column("Overshoot", "%", ".2g"), 100 * whole.overshoot),
            (
                Column("Joints off their middles at the end, H", "", ".3g"),
                float(off_middle(robot, record)[-1]),
            ),
            (Column("Last error", "", ".2g"), whole.final),
        ]

    title = "Laws that S17 cites, on the goal of its comparison; ideal joints, no limits"
    return Table.of((row(*each) for each in records.items()), title)


class BaselineTrial(NamedTuple):
    """A law, and how many of the drawn goals it is sent to, with or without limits."""

    law: str
    box: GoalBox
    is_limited: bool
    number: int
    drawn: int


@dataclass(frozen=True)
class Counted:
    """How many goals were reached, as `counted` tells it."""

    words: str


def count_reached(trial: BaselineTrial) -> Counted:
    """Run a law to goals; parsimonious control keeps limits by itself."""
    setting = setting_of("baselines")
    scene, period = setting.scene, setting.spec.period
    if trial.law == PARSIMONIOUS:
        law: Law = parsimonious_law(scene.robot, _GAIN, limits_period=period if trial.is_limited else None)
        limits = UNLIMITED
    else:
        law, limits = setting.spec.law_by_label[trial.law], LIMITED if trial.is_limited else UNLIMITED
    goals = trial.box.goals(scene, trial.drawn)
    runs = [
        RaceOutcome.of(run_to_goal(scene.robot, scene.start, goal, law, Integrator(), period, limits), period)
        for goal in goals[: trial.number]
    ]
    return Counted(counted(runs))


def _goals_table(numbers: Mapping[str, int], count: int, conditions: Conditions) -> Table:
    """Return one row a law, which is run to so many of the goals that are drawn."""
    trials = [
        BaselineTrial(law, box, is_limited, number, count)
        for law, number in numbers.items()
        for box in BOXES
        for is_limited in (False, True)
    ]
    text = setting_of("baselines").text
    found = conditions.each("random goals", count_reached, Counted, trials, text)
    words = dict(zip(trials, (each.words for each in found), strict=True))
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Law"), law),
            (Column("Goals of each kind"), number),
            *(
                (Column(f"{trial.box.name}, {_LIMITS[trial.is_limited]}"), text)
                for trial, text in words.items()
                if trial.law == law
            ),
        ]
        for law, number in numbers.items()
    ]
    return Table.of(rows, f"Goals of `comparison`: {COUNTED}")


def _judge(robot: Robot, records: dict[str, Record], period: float) -> dict[str, Judgement]:
    first = {label: RaceOutcome.of(records[label], period).first for label in (_SILVA, _SALAZAR)}
    moving = {label: inputs_that_move(records[label]) for label in (PARSIMONIOUS, _LEAST)}
    resting = {label: _self_motion(label) for label in (_PROJECTED, _REDUCED)}
    faster = _speed_ratio()
    return {
        "no-abrupt-start": Judgement(
            first[_SILVA] < 0.1 * first[_SALAZAR],
            f"first command {first[_SILVA]:.3g} and {first[_SALAZAR]:.3g} rad/s",
        ),
        "fewer-joints": Judgement(
            moving[PARSIMONIOUS] < moving[_LEAST] - 0.5,
            f"{moving[PARSIMONIOUS]:.2f} inputs of {robot.input_size} move at a time, {moving[_LEAST]:.2f} with the "
            "pseudoinverse",
        ),
        "reduced-gradient-optimises-better": Judgement(
            resting[_REDUCED][-1] < resting[_PROJECTED][-1],
            f"hand at rest, H falls in {_RESTING:g} s from {resting[_REDUCED][0]:.4f} to {resting[_REDUCED][-1]:.4f}, "
            f"projected {resting[_PROJECTED][-1]:.4f}; along one line, at the start {faster:.2f} times as fast",
        ),
    }


def _self_motion(label: str) -> np.ndarray:
    """Return H over time where the hand shall rest, from a start with the arm turned aside."""
    setting, start = setting_of("baselines"), _turned_aside()
    robot = setting.scene.robot
    law = setting.spec.law_by_label[label]
    run = simulate(robot, SetPoint(robot.fkm(start)), law, Integrator(), start, setting.spec.period, _RESTING)
    return off_middle(robot, run)


def _speed_ratio() -> float:
    """Return how many times as fast the reduced gradient moves as the projected one, where `_self_motion` starts."""
    setting, start = setting_of("baselines"), _turned_aside()
    sample = Sample(setting.scene.robot.fkm(start))
    reduced, projected = (
        setting.spec.law_by_label[label].command(setting.scene.robot, start, sample, setting.spec.period)
        for label in (_REDUCED, _PROJECTED)
    )
    return float(np.linalg.norm(reduced) / np.linalg.norm(projected))


def _turned_aside() -> np.ndarray:
    """Return the start with the first joint turned: before the base, as in the spec, J has lost rank."""
    start = setting_of("baselines").scene.start.copy()
    start[3] = _ASIDE
    return start


def _figures(records: dict[str, Record]) -> dict[str, Draw]:
    chosen = {label: records[label] for label in (S17, _SALAZAR, PARSIMONIOUS)}
    return {"inputs": lambda: told_inputs(chosen), "errors": lambda: figures.compare_errors(records)}
