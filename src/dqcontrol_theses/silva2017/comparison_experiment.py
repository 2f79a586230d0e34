"""[S17 5.2.2]: the feedback linearising law against the classic one, on one goal and on random ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from dqcontrol import algebra, figures
from dqcontrol.experiments import PreparedExperiment, Run, prepare
from dqcontrol.loop import Record, simulate, simulate_prepared
from dqcontrol.plants import Camera, Integrator, MobilePlant
from dqcontrol.references import POSE
from dqcontrol.robots import WholeBody
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import ABOUT_THE_ROBOT, Judgement
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.goal_runs import (
    ALL_LIMITS,
    BASE_ACCELERATION,
    BASE_TURN_ACCELERATION,
    JOINT_ACCELERATION,
    UNLIMITED,
    RaceOutcome,
    beyond_limits,
    until_good_enough,
    with_acceleration_limits,
)
from dqcontrol_theses.silva2017.inverses import (
    FILTERED,
    Compared,
    compared,
    inverse_table,
    judge_inverses,
    with_each_inverse,
)
from dqcontrol_theses.silva2017.pictures import ghosted_strip, if_drawable, told_inputs
from dqcontrol_theses.silva2017.random_races import Races, overshooting, race_on_random_goals, random_tables
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, OURS, S17, printed, spec_data, verdicts

CLASSIC, MATCHED = "classic", "classic, matched to S17's"
CAMERA = Camera(
    rate=20, position_noise=0.005, angle_noise=0.01, outlier_probability=0.01, outlier_position=0.1
)  # as in the spec
_SIMILAR, _CLEARLY_LESS, _OVERSHOOT = 0.2, 0.6, 0.01
_LAST = 100  # samples, 5 s
_PRINTED_AS = {S17: "nonlinear", CLASSIC: CLASSIC}


def reproduce(conditions: Conditions, count: int = 100, in_physics: bool = True) -> Reproduced:
    """Run all laws at the printed gains, the classic one also as fast as S17's, in physics, and on random goals."""
    data = spec_data("comparison")
    setting = prepare(data)
    scene, spec = setting.scene, setting.spec
    laws = spec.law_by_label

    by_inverse = with_each_inverse(setting, laws[S17], laws[CLASSIC])
    first, gain = by_inverse[0].nonlinear, by_inverse[0].gain
    by_default = compared(setting, FILTERED, laws[OURS], laws[CLASSIC], as_s17=False)
    if gain is not None:
        data["laws"][MATCHED] = data["laws"][CLASSIC] | {"gain": gain}
    study = conditions.run_study("comparison", data)
    runs = {tuple(label.split(" · ")): run for label, run in study.runs.items()}
    named = _named(runs, data)
    ideal, camera = (
        {law: run for (law, where), run in named.items() if where == plant} for plant in ("ideal", "camera")
    )
    races = race_on_random_goals(count, conditions)
    tables = [
        _table(ideal, spec.period, gain),
        inverse_table(by_inverse),
        _limited_table(setting, {law: run.record for law, run in ideal.items()}),
        *([_physics_table(setting)] if in_physics else []),
        *random_tables(count, races),
        verdicts(
            "comparison",
            _judge(by_inverse, f"first below {GOOD_ENOUGH}", _of(ideal, S17), camera, races),
            _judge([by_default], f"below {GOOD_ENOUGH} for good", _of(ideal, OURS), camera, races),
        ),
    ]
    seen = {label: camera[label].record for label in (S17, CLASSIC)}
    middle = 0.5 * spec.period * first.settling
    times = [0.0, middle, spec.duration or 0.0]
    return Reproduced(
        "silva2017/comparison",
        tables,
        {"comparison": study},
        _figures(ideal, camera),
        files=if_drawable({"figure-5.4.png": ghosted_strip(scene.robot, seen, times)}),
    )


def _of(ideal: dict[str, Run], label: str) -> dict[str, Run]:
    return {each: ideal[each] for each in (label, CLASSIC)}


def _named(runs: dict[tuple[str, ...], Run], data: dict[str, Any]) -> dict[tuple[str, str], Run]:
    return {
        (law, plant): run
        for label, run in runs.items()
        for law in data["laws"]
        for plant in data["plants"]
        if set(label) == {law, plant}
    }


def _beside_print(
    label: str, first: RaceOutcome, iterations: float, classic: RaceOutcome
) -> list[tuple[Column, Cell]]:
    """Return cells of a run to its first good sample, beside the printed ones, and over the classic law's effort."""
    law, arrived = _PRINTED_AS.get(label), math.isfinite(first.settling)
    return [
        (
            Column("Iterations, published", "", ".4g"),
            printed("comparison", law, "iterations") if law else None,
        ),
        (Column("Ours", "", ".4g"), iterations),
        (Column("Effort, published", "rad/√s", ".3g"), printed("comparison", law, "effort") if law else None),
        (Column("Ours", "rad/√s", ".3g"), first.effort if arrived else None),
        (Column("Over classic", "", ".3g"), first.effort / classic.effort if arrived else None),
    ]


def _table(ideal: dict[str, Run], period: float, gain: float | None) -> Table:
    def row(label: str, record: Record) -> list[tuple[Column, Cell]]:
        first, whole = (RaceOutcome.of(each, period) for each in (until_good_enough(record), record))
        return [
            (Column("Law"), label if label != MATCHED else f"{label}: K = {gain:.3g}"),
            *_beside_print(label, first, first.settling, first_classic),
            (Column("Iterations until it stays below", "", ".4g"), whole.settling),
            (Column("Effort of 60 s", "rad/√s", ".3g"), whole.effort),
            (Column("First command |u_f|", "rad/s", ".3g"), whole.first),
            (Column("Largest change of u_f", "rad/s", ".3g"), whole.largest_change),
            (Column("Overshoot", "%", ".2g"), 100 * whole.overshoot),
        ]

    first_classic = RaceOutcome.of(until_good_enough(ideal[CLASSIC].record), period)
    title = f"S17 Table 5.1; iterations and effort until the error is first below {GOOD_ENOUGH}, as S17 stops"
    return Table.of((row(label, run.record) for label, run in ideal.items()), title)


def _limited_table(setting: PreparedExperiment, free: dict[str, Record]) -> Table:
    """Return the printed numbers beside ours with all limits on, as constraints around each law."""
    scene, period = setting.scene, setting.spec.period
    assert isinstance(scene.robot, WholeBody)
    robot = with_acceleration_limits(scene.robot)
    runs: dict[str, Record] = {}
    for label, law in setting.spec.law_by_label.items():
        limited = msgspec.structs.replace(law, constraints=ALL_LIMITS).prepare(robot, None, period)
        runs[label] = simulate_prepared(limited, Integrator(), scene.start, scene.samples)
    firsts = {label: RaceOutcome.of(until_good_enough(run), period) for label, run in runs.items()}

    def row(label: str, run: Record) -> list[tuple[Column, Cell]]:
        first, whole = firsts[label], RaceOutcome.of(run, period)
        return [
            (Column("Law"), label),
            *_beside_print(label, first, first.first_below, firsts[CLASSIC]),
            (Column("Iterations until it stays below", "", ".4g"), whole.settling),
            (Column("First command |u_f|", "rad/s", ".3g"), whole.first),
            (Column("Largest change of u_f", "rad/s", ".3g"), whole.largest_change),
            (Column("Last error", "", ".2g"), whole.final),
            (Column("Beyond a limit", "%", ".2g"), 100 * beyond_limits(robot, run, period)),
            (Column("Beyond one without them", "%", ".3g"), 100 * beyond_limits(robot, free[label], period)),
        ]

    title = (
        "The same with all limits on, as constraints around each law: joints, wheels, rims, and accelerations of "
        f"{BASE_ACCELERATION:g} m/s² and {BASE_TURN_ACCELERATION:g} rad/s² of the base and {JOINT_ACCELERATION:g} "
        "rad/s² of the joints, which are our assumption"
    )
    return Table.of((row(*each) for each in runs.items()), title)


def _physics_table(setting: PreparedExperiment) -> Table:
    """Return S17's law and the classic one on wheels and servos in MuJoCo, the base seen by the camera."""
    scene, spec = setting.scene, setting.spec
    runs: dict[str, tuple[RaceOutcome, RaceOutcome]] = {}
    for label in (S17, CLASSIC, f"{S17} with (4.19)", OURS):
        record = simulate(
            scene.robot,
            scene.reference,
            spec.law_by_label[label],
            MobilePlant(location="camera", camera=CAMERA),
            scene.start,
            spec.period,
            spec.duration,
            limits=UNLIMITED,
        )
        first = RaceOutcome.of(until_good_enough(record), spec.period)
        runs[label] = first, RaceOutcome.of(record, spec.period)
    classic, _ = runs[CLASSIC]
    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("Law"), label),
            (Column("Iterations to first below 0.04", "", ".4g"), first.first_below),
            (Column("Until it stays below", "", ".4g"), whole.settling),
            (Column("Effort until first below", "rad/√s", ".3g"), first.effort),
            (Column("Last error", "", ".2g"), whole.final),
            (Column("Effort over classic", "", ".3g"), first.effort / classic.effort),
        ]
        for label, (first, whole) in runs.items()
    ]
    title = f"In MuJoCo, the base seen by a camera ({CAMERA.rate:g} Hz, 5 mm, 0.01 rad, 1 % outliers of 10 cm), seed 0"
    return Table.of(rows, title)


def _ahead(nonlinear: Run, linear: Run, until: float) -> int:
    """Return at how many samples of that many the nonlinear law's error is the smaller one by more than rounding."""
    count = min(int(until), len(nonlinear.record), len(linear.record))
    return int((nonlinear.record.error[:count] < (1 - 1e-6) * linear.record.error[:count]).sum())


def _judge(
    pairs: list[Compared], stop: str, ideal: dict[str, Run], camera: dict[str, Run], races: Races
) -> dict[str, Judgement]:
    """Judge a nonlinear law, the first of the ideal runs, beside the classic one; the first pair is of these runs."""
    ours, classic = pairs[0].nonlinear, pairs[0].classic
    (label, nonlinear), (_, linear) = ideal.items()
    middle = int(ours.settling / 2) if math.isfinite(ours.settling) else len(nonlinear.record) // 2
    midway = [float(run.record.error[middle]) for run in (nonlinear, linear)]
    overshoots = [run.metrics.position_overshoot for run in (nonlinear, linear)]
    jumps = [float(np.abs(np.diff(_seen_error(run))).max()) for run in (camera[label], nonlinear)]
    last = [float(np.median(_seen_error(camera[each])[-_LAST:])) for each in (label, CLASSIC)]
    passed, goals = overshooting(label, races, _OVERSHOOT)
    end = classic.settling if math.isfinite(classic.settling) else len(linear.record)
    return {
        "similar-convergence": judge_inverses(
            pairs,
            lambda each: abs(each.pace - 1) < _SIMILAR,
            lambda each: (
                f"{stop}: {each.nonlinear.settling:.0f} and {each.classic.settling:.0f} iterations, {each.pace:.2f}"
            ),
        ),
        "smoother-inputs": judge_inverses(
            pairs,
            lambda each: (
                each.nonlinear.first < each.classic.first
                and each.nonlinear.largest_change < each.classic.largest_change
            ),
            lambda each: (
                f"first command {each.nonlinear.first / each.classic.first:.3f}, largest change "
                f"{each.nonlinear.largest_change / each.classic.largest_change:.3f} of the classic law's"
            ),
        ),
        "half-the-effort": judge_inverses(
            pairs, lambda each: max(each.efforts) < _CLEARLY_LESS, lambda each: each.efforts_in_words
        ),
        "linear-overshoots": Judgement(
            None if passed else overshoots[1] > max(_OVERSHOOT, overshoots[0]),
            f"classic {100 * overshoots[1]:.2g} %, {label} {100 * overshoots[0]:.2g} %, in 60 s; on {passed} of "
            f"{goals} random goals the classic law's is above 1 % and the larger one",
            depends_on="the goal" if passed else "",
        ),
        "nonlinear-ahead-midway": Judgement(
            midway[0] < midway[1],
            f"error {midway[0]:.3f}, classic {midway[1]:.3f}; it is the smaller one at "
            f"{_ahead(nonlinear, linear, end)} of the {end:.0f} samples until the classic law arrives",
        ),
        "coefficients-converge": Judgement(
            max(last) < GOOD_ENOUGH, f"{label} {last[0]:.3f}, classic {last[1]:.3f}, with the camera"
        ),
        "smaller-effort": judge_inverses(
            pairs, lambda each: max(each.efforts) < 1, lambda each: each.efforts_in_words
        ),
        "harder-to-tune": Judgement(None, "two gains against one", "it is about who tunes"),
        "spikes-from-measurement": Judgement(
            None,
            f"{jumps[0]:.3f} with the outliers that we assume of the camera, {jumps[1]:.3f} without it",
            ABOUT_THE_ROBOT,
        ),
    }


def _as_seen(run: Run) -> Record:
    """Return a run with the hand where the measured configurations say that it is."""
    return replace(run.record, pose=run.robot.fkm(run.record.measured))


def _seen_error(run: Run) -> np.ndarray:
    return _as_seen(run).error


def _as_error(run: Run) -> Record:
    """Return a run whose hand is at x̃ = x_d* x as measured, which S17 draws, and whose desired pose is 1."""
    seen = _as_seen(run)
    errors = algebra.multiply(algebra.conjugate(seen.desired_pose), seen.pose)
    desired = seen.desired.copy()
    desired[:, POSE] = [1.0, 0, 0, 0, 0, 0, 0, 0]
    return replace(seen, pose=algebra.short(errors), desired=desired)


def _figures(ideal: dict[str, Run], camera: dict[str, Run]) -> dict[str, Draw]:
    two, body = (S17, CLASSIC), ideal[S17].robot
    records = {label: run.record for label, run in ideal.items()}
    return {
        "figure-5.4-lines": lambda: figures.superimposed(body, {label: records[label] for label in two}),
        "figure-5.5": lambda: figures.compare_poses({label: _as_error(camera[label]) for label in two}),
        "figure-5.6": lambda: figures.compare_errors({label: _as_seen(camera[label]) for label in two}),
        "figure-5.7": lambda: told_inputs({label: records[label] for label in two}),
        "base-paths": lambda: figures.base_path(body, records),
    }
