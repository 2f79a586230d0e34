"""[S17 5.2.2]: the feedback linearising law against the classic one, on one goal and on random ones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from dqcontrol.experiments.prepared_experiment import prepare
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.run_study import run_study
from dqcontrol.loop.signals import ACTUATORS
from dqcontrol.measures.tables import Cell, Column, Table
from dqcontrol.reproductions.catalogue import Conditions
from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.reproduced import Draw, Reproduced
from dqcontrol.reproductions.silva2017.race import RaceOutcome, matched_gain, outcome
from dqcontrol.reproductions.silva2017.random_races import BOXES, random_table
from dqcontrol.reproductions.silva2017.specs import GOOD_ENOUGH, printed, spec_data, verdicts

NONLINEAR, AS_PRINTED, CLASSIC, MATCHED = "nonlinear", "nonlinear as printed", "classic", "classic, matched"
_SIMILAR, _CLEARLY_LESS, _OVERSHOOT, _SPIKE = 0.2, 0.6, 0.01, 5.0


def reproduce(conditions: Conditions, count: int = 100) -> Reproduced:
    """Run both laws at the printed gains, the classic one also with the nonlinear law's settling time, and on goals."""
    data = spec_data("comparison")
    setting = prepare(data)
    scene, spec = setting.scene, setting.spec
    laws = spec.law_by_label

    def race(law: Any) -> RaceOutcome:
        return outcome(scene.robot, scene.start, scene.samples, law, spec.period)

    gain = matched_gain(
        lambda k: race(msgspec.structs.replace(laws["classic"], gain=k)).settling,
        race(laws[NONLINEAR]).settling,
    )
    if gain is not None:
        data["laws"][MATCHED] = data["laws"]["classic"] | {"gain": gain}
    study = run_study(data, jobs=conditions.jobs, progress=conditions.of("comparison"))
    runs = {tuple(label.split(" · ")): run for label, run in study.runs.items()}
    ideal = {law: run for (law, plant), run in _named(runs, data).items() if plant == "ideal"}
    camera = {law: run for (law, plant), run in _named(runs, data).items() if plant == "camera"}
    outcomes = {label: RaceOutcome.of(run.record, spec.period) for label, run in ideal.items()}
    progress = conditions.of("random goals")
    tables = [
        _table(outcomes, gain),
        *(random_table(box, laws, count, progress) for box in BOXES),
        verdicts("comparison", _judge(outcomes, ideal, camera)),
    ]
    return Reproduced("silva2017/comparison", tables, {"comparison": study}, _figures(ideal, camera))


def _named(runs: dict[tuple[str, ...], Run], data: dict[str, Any]) -> dict[tuple[str, str], Run]:
    return {
        (law, plant): run
        for label, run in runs.items()
        for law in data["laws"]
        for plant in data["plants"]
        if set(label) == {law, plant}
    }


def _table(outcomes: dict[str, RaceOutcome], gain: float | None) -> Table:
    shown = {NONLINEAR: ("nonlinear", ""), AS_PRINTED: ("nonlinear", ""), CLASSIC: ("classic", "")}
    rows: list[list[Cell]] = []
    for label, each in outcomes.items():
        law = shown.get(label, ("", ""))[0]
        rows.append(
            [
                label if label != MATCHED else f"{label}: K = {gain:.3g}",
                printed("comparison", law, "iterations") if law else None,
                each.settling,
                printed("comparison", law, "effort") if law else None,
                each.effort,
                each.effort / outcomes[CLASSIC].effort,
                each.first,
                each.largest_change,
                100 * each.overshoot,
            ]
        )
    columns = [
        Column("Law"),
        Column("Iterations, published", "", ".4g"),
        Column("Ours", "", ".4g"),
        Column("Effort, published", "rad/√s", ".3g"),
        Column("Ours", "rad/√s", ".3g"),
        Column("Over classic", "", ".3g"),
        Column("First command |u_f|", "rad/s", ".3g"),
        Column("Largest change of u_f", "rad/s", ".3g"),
        Column("Overshoot", "%", ".2g"),
    ]
    return Table(columns, rows, f"S17 Table 5.1; iterations until the error stays below {GOOD_ENOUGH}")


def _judge(
    outcomes: dict[str, RaceOutcome], ideal: dict[str, Run], camera: dict[str, Run]
) -> dict[str, Judgement]:
    ours, classic = outcomes[NONLINEAR], outcomes[CLASSIC]
    pace = ours.settling / classic.settling
    ratios = [ours.effort / classic.effort]
    text = f"{ratios[0]:.2f} at the printed gains"
    if MATCHED in outcomes:
        ratios.append(ours.effort / outcomes[MATCHED].effort)
        text += f", {ratios[1]:.2f} at matched settling"
    middle = int(ours.settling / 2) if math.isfinite(ours.settling) else len(ideal[NONLINEAR].record) // 2
    midway = [float(ideal[label].record.error[middle]) for label in (NONLINEAR, CLASSIC)]
    jumps = [float(np.abs(np.diff(_seen_error(runs[NONLINEAR]))).max()) for runs in (camera, ideal)]
    return {
        "similar-convergence": Judgement(
            abs(pace - 1) < _SIMILAR, f"{ours.settling:.0f} and {classic.settling:.0f} iterations: {pace:.2f}"
        ),
        "smoother-inputs": Judgement(
            ours.first < classic.first and ours.largest_change < classic.largest_change,
            f"first command {ours.first / classic.first:.3f}, largest change "
            f"{ours.largest_change / classic.largest_change:.3f} of the classic law's",
        ),
        "half-the-effort": Judgement(max(ratios) < _CLEARLY_LESS, text),
        "linear-overshoots": Judgement(
            classic.overshoot > max(_OVERSHOOT, ours.overshoot),
            f"classic {100 * classic.overshoot:.2g} %, nonlinear {100 * ours.overshoot:.2g} %, "
            f"as printed {100 * outcomes[AS_PRINTED].overshoot:.2g} %",
        ),
        "nonlinear-ahead-midway": Judgement(
            midway[0] < midway[1], f"error {midway[0]:.3f}, classic {midway[1]:.3f}"
        ),
        "spikes-from-measurement": Judgement(
            jumps[0] > _SPIKE * jumps[1], f"{jumps[0]:.3f} with the camera, {jumps[1]:.3f} without"
        ),
    }


def _seen_error(run: Run) -> np.ndarray:
    """Return the error norm that the measured configurations give."""
    return replace(run.record, pose=run.robot.fkm(run.record.measured)).error


def _figures(ideal: dict[str, Run], camera: dict[str, Run]) -> dict[str, Draw]:
    two = (NONLINEAR, CLASSIC)

    def records(runs: dict[str, Run], labels: tuple[str, ...]):
        return {label: runs[label].record for label in labels}

    def told(runs: dict[str, Run]):
        first = runs[NONLINEAR].record.readings[ACTUATORS]
        from dqcontrol.figures import compare_inputs

        inputs = {
            label: (runs[label].record.time, runs[label].record.readings[ACTUATORS].values) for label in two
        }
        return compare_inputs(inputs, [f"{name} [rad/s]" for name in first.parts])

    def view(name: str):
        import dqcontrol.figures

        return getattr(dqcontrol.figures, name)

    body = ideal[NONLINEAR].robot
    return {
        "figure-5.4": lambda: view("superimposed")(body, records(ideal, two)),
        "figure-5.5": lambda: view("compare_poses")(records(camera, two)),
        "figure-5.6": lambda: view("compare_errors")(records(camera, two)),
        "figure-5.7": lambda: told(ideal),
        "base-paths": lambda: view("base_path")(body, records(ideal, tuple(ideal))),
    }
