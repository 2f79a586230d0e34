"""[S17 5.2.1]: what the two gains of the feedback linearising law do."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol import figures
from dqcontrol.experiments import Run
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement, listed
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.silva2017.specs import OURS, S17, spec_data, verdicts

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DAMPED: dict[str, tuple[float, float]] = {
    "k̄ = 0.6, k_v = 1": (0.6, 1),
    "k̄ = 0.6, k_v = 2": (0.6, 2),
    "k̄ = 0.6, k_v = 3": (0.6, 3),
}
STIFF: dict[str, tuple[float, float]] = {
    "k̄ = 0.6, k_v = 2": (0.6, 2),
    "k̄ = 1.4, k_v = 2": (1.4, 2),
    "k̄ = 2, k_v = 2": (2, 2),
}
_NONE = 1e-3  # an overshoot below it is none


def reproduce(conditions: Conditions) -> Reproduced:
    """Run the five sets."""
    data = spec_data("gains")
    study = conditions.run_study("gains", data)
    runs = {law: {label: _run(study.runs, law, label) for label in DAMPED | STIFF} for law in data["laws"]}
    drawn: dict[str, Draw] = {
        "figure-5.2": lambda: _poses(runs[S17], DAMPED),
        "figure-5.3": lambda: _poses(runs[S17], STIFF),
    }
    tables = [_table(runs), verdicts("gains", _judge(runs[S17]), _judge(runs[OURS]))]
    return Reproduced("silva2017/gains", tables, {"gains": study}, drawn)


def _run(runs: dict[str, Run], law: str, label: str) -> Run:
    return next(run for name, run in runs.items() if {law, label} <= set(name.split(" · ")))


def damping_ratio(stiffness: float, damping: float) -> float:
    """Return ζ = k_v/√k̄ of the linear error dynamics with k_p = k̄/2."""
    return damping / math.sqrt(stiffness)


def overshoot(run: Run) -> float:
    """Return the larger of the overshoots of position and orientation."""
    return float(np.nanmax([run.metrics.position_overshoot, run.metrics.orientation_overshoot]))


def _table(runs: dict[str, dict[str, Run]]) -> Table:
    def row(law: str, label: str, run: Run) -> list[tuple[Column, Cell]]:
        metrics = run.metrics
        return [
            (Column("Law"), law),
            (Column("Set"), label),
            (Column("ζ", "", ".3g"), damping_ratio(*(DAMPED | STIFF)[label])),
            (Column("Settling to 2 %", "s", ".4g"), metrics.settling_time),
            (Column("Samples"), metrics.samples),
            (Column("Overshoot", "%", ".2g"), 100 * overshoot(run)),
            (Column("Peak acceleration", "m/s²", ".3g"), metrics.hand_acceleration.peak),
            (Column("Effort", "rad/√s", ".3g"), metrics.effort),
            (Column("Ended by"), run.record.stopped),
        ]

    title = "S17 Figs 5.2–5.3; a run ends after 50 samples in a row with an error below 1e-4"
    return Table.of((row(law, *each) for law, sets in runs.items() for each in sets.items()), title)


def _judge(runs: dict[str, Run]) -> dict[str, Judgement]:
    def of(sets: dict[str, tuple[float, float]], value: Callable[[Run], float]) -> list[float]:
        return [float(value(runs[label])) for label in sets]

    def rises(values: list[float]) -> bool:
        return bool((np.diff(np.nan_to_num(values, nan=math.inf)) > 0).all())

    damped, stiff = of(DAMPED, overshoot), of(STIFF, overshoot)
    ratios = listed([damping_ratio(*gains) for gains in DAMPED.values()], ".3g")
    stiff_ratios = listed([damping_ratio(*gains) for gains in STIFF.values()], ".3g")
    slower = of(DAMPED, lambda run: run.metrics.settling_time)
    faster = of(STIFF, lambda run: run.metrics.settling_time)
    peaks = of(STIFF, lambda run: run.metrics.hand_acceleration.peak)
    smoother = of(DAMPED, lambda run: run.metrics.hand_acceleration.peak)
    return {
        "damping-attenuates-oscillation": Judgement(
            damped[0] > _NONE and not rises(damped),
            f"ζ = {ratios}: overshoots {listed([100 * each for each in damped], '.2g')} %"
            + ", nothing to attenuate" * (damped[0] <= _NONE),
        ),
        "damping-slows": Judgement(
            rises(slower) and rises(smoother[::-1]),
            f"peak acceleration {listed(smoother, '.3g')} m/s², settling {listed(slower, '.3g')} s",
        ),
        "stiffness-makes-abrupt": Judgement(rises(peaks), f"peak acceleration {listed(peaks, '.3g')} m/s²"),
        "stiffness-makes-oscillatory": Judgement(
            stiff[-1] > _NONE and rises(stiff),
            f"ζ = {stiff_ratios}: overshoots {listed([100 * each for each in stiff], '.2g')} %",
        ),
        "stiffness-settles-faster": Judgement(rises(faster[::-1]), f"settling {listed(faster, '.3g')} s"),
    }


def _poses(runs: dict[str, Run], sets: Iterable[str]) -> Figure:
    return figures.compare_poses({label: runs[label].record for label in sets})
