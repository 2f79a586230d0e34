"""The ranking that P16 asked for: its six laws on its arm, each tuned, not at gains that differ by chance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from dqcontrol import figures
from dqcontrol.measures import confidence_table, mean_of
from dqcontrol.tables import Cell, Column, Table
from dqcontrol.tuning import Tuning, learn, tune
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.judgement import Judgement, verdict_table
from dqcontrol_theses.pereira2016.pereira2016_catalogue import SERVO, SOURCE, published_spec
from dqcontrol_theses.pereira2016.published_numbers import claims
from dqcontrol_theses.reproduced import Draw, Reproduced
from dqcontrol_theses.results import Results

_GAIN = 20.0  # 1/s, that the search begins at; what it is does not matter
_WEIGHTS = {"error_weight": _GAIN**2, "control_weight": 1.0}
_GAINS = {"orientation_gain": 2 * _GAIN, "translation_gain": _GAIN}
_LAWS: dict[str, dict[str, Any]] = {
    "K": {"kind": "proportional", "gain": _GAIN},
    "K+FF": {"kind": "proportional-feedforward", "feedforward": "printed", "gain": _GAIN},
    "LQR-R8": {"kind": "linear-quadratic-r8"} | _WEIGHTS,
    "LQR-DQ": {"kind": "linear-quadratic-dq", "feedforward": "printed"} | _WEIGHTS,
    "HIR": {"kind": "h-infinity"} | _GAINS,
    "HIRT": {"kind": "h-infinity-tracking", "feedforward": "printed"} | _GAINS,
}
_ROBUST, _LINEAR_QUADRATIC, _PROPORTIONAL = ("HIR", "HIRT"), ("LQR-R8", "LQR-DQ"), ("K", "K+FF")
_BUDGET = {SERVO: 24}
_IN_PHYSICS = 10
_PRODUCTS = 0.05, 3.0  # k T that are searched in physics
_NOT_LINEAR = ("exchange_period", "dry_friction", "base_shaking")
_REPEATS = {SERVO: 20}
_FEW = 3
_SHOWN = ("error.integral", "position.rms", "orientation.rms", "joint_step.integral", "hand_speed.peak")
_COMPARISONS = (
    "lqr-worst-error-on-circle",
    "h-infinity-lowest-error-on-circle",
    "lqr-dq-worse-tracking",
    "lqr-lower-effort",
    "h-infinity-best-everywhere",
    "h-infinity-lower-effort",
    "dq-better-than-proportional",
)


def reproduce_tuned_comparison(conditions: Conditions) -> Reproduced:
    """Tune the six laws on a circle, judge them on the spiral, and let the best one learn it."""
    data, plant = tuned_comparison_spec(conditions.plant), conditions.plant
    tuning = tune(
        data, jobs=conditions.jobs, progress=conditions.of("tuning"), journal=conditions.journal("tuning")
    )
    repeats = conditions.repeats or _REPEATS.get(plant, _FEW)
    judged = _spiral(data) | {
        "laws": {each.label: each.result.law for each in tuning.laws},
        "repeats": max(repeats, 2),
    }
    study = conditions.run_study("spiral", judged)
    results = Results({"": study.rows})
    tables = [
        tuning.table(),
        confidence_table(study.rows, _SHOWN, "P16's spiral, every law tuned: mean ± 95 % interval"),
        _ranking(tuning, results),
        _learnt(data, tuning, conditions),
        verdict_table(
            [claim for name in ("circle", "spiral") for claim in claims(name) if claim.id in _COMPARISONS],
            _judged(results),
            "P16",
            f"P16's comparisons, every law tuned · {plant}",
        ),
    ]
    drawn: dict[str, Draw] = {"search": lambda: figures.search_figure(tuning)}
    return Reproduced(f"{SOURCE}/tuned-comparison", tables, {"spiral": study}, drawn, plant)


def tuned_comparison_spec(plant: str) -> dict[str, Any]:
    """Return the spec of the search: P16's arm and period, a circle of its spiral's radius and speed, from rest."""
    data = published_spec("spiral", plant)
    for key in ("parameter_sets", "repeats"):
        data.pop(key, None)
    return data | {
        "name": "tuned-comparison",
        "laws": _LAWS,
        "reference": {"kind": "circle", "radius": 0.07, "plane": "xz", "duration": 8.0, "ramp": 1.0},
        "metrics_from": "true",
        "skip_initial": 1.0,
        "tune": {
            "budget": _BUDGET.get(plant, _IN_PHYSICS),
            **unmodelled(plant, _LAWS, _PRODUCTS),
            "held_out": {"references": [_spiral(data)["reference"]], "seeds": 1},
        },
    }


def unmodelled(plant: str, laws: Mapping[str, Any], products: tuple[float, float]) -> dict[str, Any]:
    """Return what a search on the arm in physics takes in place of a margin: its joints have no linear model.

    Their controllers exchange numbers with the law at another period than its own. Gains that are too high shake, which
    the objectives price.
    """
    if plant == SERVO:
        return {}
    low, high = products
    return {"margin": 0.0, "free": {law: {"loop_gain": {"low": low, "high": high}} for law in laws}}


def linear_counterpart(plant: dict[str, Any]) -> dict[str, Any] | None:
    """Return what learning takes the arm for: itself without friction, shaking and another period; None for servos."""
    if plant["kind"] == "servo":
        return None
    return {key: value for key, value in plant.items() if key not in _NOT_LINEAR}


def _spiral(data: dict[str, Any]) -> dict[str, Any]:
    """Return a spec with P16's spiral, from rest and without its first offset, which is none of tracking."""
    whole = published_spec("spiral", SERVO)["reference"]
    reference = {key: value for key, value in whole.items() if key != "offset"} | {"ramp": 1.0}
    return {key: value for key, value in data.items() if key != "tune"} | {
        "name": "tuned-spiral",
        "reference": reference,
    }


def _ranking(tuning: Tuning, results: Results) -> Table:
    """Return the laws by their error on the spiral, and by how much each is behind the one before it, paired."""
    order = sorted((each.label for each in tuning.laws), key=results.mean)

    def behind(law: str, before: str) -> str:
        difference, half = _difference(results, law, before)
        share, spread = (100 * each / results.mean(before) for each in (difference, half))
        return f"{share:.2g} ± {spread:.1g} %" + ", no difference" * (difference <= half)

    rows: list[list[tuple[Column, Cell]]] = [
        [
            (Column("place"), place + 1),
            (Column("law"), law),
            (Column("pose error integral", "s", ".4g"), results.mean(law)),
            (Column("behind"), behind(law, order[place - 1]) if place else "–"),
        ]
        for place, law in enumerate(order)
    ]
    return Table.of(rows, "Ranking on P16's spiral, every law tuned")


def _difference(results: Results, law: str, other: str, metric: str = "error") -> tuple[float, float]:
    """Return the mean difference of two laws on the same seeds, and half of its 95 % interval."""
    first, second = (results.values(each, metric=metric) for each in (law, other))
    count = min(len(first), len(second))
    if count < 2:
        return math.nan, math.nan
    difference = mean_of(first[:count] - second[:count])
    return difference.mean, difference.half_width()


def _judged(results: Results) -> dict[str, Judgement]:
    """Return verdicts on P16's comparisons of laws."""

    def all_below(some: tuple[str, ...], others: tuple[str, ...], metric: str = "error") -> Judgement:
        lower = [_difference(results, a, b, metric) for a in some for b in others if a != b]
        holds = all(difference < -half for difference, half in lower)
        means = ", ".join(f"{law} {results.mean(law, metric=metric):.3g}" for law in (*some, *others))
        return Judgement(holds, means)

    return {
        "lqr-worst-error-on-circle": all_below((*_PROPORTIONAL, *_ROBUST), _LINEAR_QUADRATIC),
        "h-infinity-lowest-error-on-circle": all_below(_ROBUST, (*_PROPORTIONAL, *_LINEAR_QUADRATIC)),
        "lqr-dq-worse-tracking": all_below(("LQR-R8",), ("LQR-DQ",)),
        "lqr-lower-effort": all_below(_LINEAR_QUADRATIC, ("K",), "joint_step"),
        "h-infinity-best-everywhere": all_below(("HIR",), (*_PROPORTIONAL, *_LINEAR_QUADRATIC)),
        "h-infinity-lower-effort": all_below(("HIR",), ("K", "LQR-R8"), "joint_step"),
        "dq-better-than-proportional": all_below(("LQR-DQ",), _PROPORTIONAL),
    }


def _learnt(data: dict[str, Any], tuning: Tuning, conditions: Conditions) -> Table:
    """Return what the best law misses of the spiral, before and after it has learnt it."""
    spiral = {key: value for key, value in _spiral(data).items() if key != "laws"}
    found = learn(
        spiral | {"law": tuning.best.result.law},
        repeats=5,
        measured_by="tracker",
        return_time=5.0,
        model=linear_counterpart(data["plant"]),
        progress=conditions.of("learning"),
        journal=conditions.journal("learning"),
    )
    first, best = found.repeats[0], found.repeats[found.best]
    rows: list[list[Cell]] = [
        [f"{tuning.best.label}, tuned", first.position, first.peak],
        [f"{tuning.best.label}, after {found.best} repeats with a tracker", best.position, best.peak],
    ]
    columns = [Column(""), Column("position error RMS", "mm", ".3g"), Column("peak", "mm", ".3g")]
    return Table(columns, rows, "The spiral, and what is possible")
