"""P16 wants its arm for "assembling and writing tasks": how near a millimetre it writes, by each means."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol import figures
from dqcontrol.arrays import Array
from dqcontrol.loop import Record
from dqcontrol.plants import CompliantPlant, Servo
from dqcontrol.robots import load_robot
from dqcontrol.tables import Cell, Column, Table, VerdictCell
from dqcontrol.tuning import learn, tune
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.pereira2016.pereira2016_catalogue import SERVO, SOURCE, published_spec
from dqcontrol_theses.pereira2016.tuned_comparison import linear_counterpart
from dqcontrol_theses.reproduced import Reproduced

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GAIN = 3.0  # 1/s: what the arm takes without swinging, see docs/physics.md
_BUDGET = {SERVO: 16}
_IN_PHYSICS = 8
# 1/s: damped as `check` asks up to 0.999; the 10 of the other experiments would use up the margin
_POSTURE = 0.9
_SLOW = 0.2  # Hz
_GOAL = 1.0  # mm

_WIDTH = 7.16  # in, of a journal's page


def reproduce_writing(conditions: Conditions) -> Reproduced:
    """Draw P16's drawing by K as it is, K tuned, with feed-forward and preview, and learnt."""
    plant = conditions.plant
    data = writing_spec(plant)
    kinds = {
        "K": {"kind": "proportional", "gain": _GAIN},
        "K+FF": {"kind": "proportional-feedforward", "feedforward": "printed", "gain": _GAIN},
    }
    tuned = tune(
        data | {"laws": kinds},
        jobs=conditions.jobs,
        progress=conditions.of("tuning"),
        journal=conditions.journal("tuning"),
        budget=_BUDGET.get(plant, _IN_PHYSICS),
        held_out={"seeds": 1, "starts": [data["start"]]},
    )
    best = {each.label: each.result.law for each in tuned.laws}
    lag = _lag(data)
    ahead = data | {"reference": data["reference"] | {"preview": {"delay": lag}}}
    laws = {
        f"K, k = {_GAIN:g} 1/s": kinds["K"],
        f"K tuned, k = {best['K']['gain']:.3g} 1/s": best["K"],
        f"K+FF tuned, k = {best['K+FF']['gain']:.3g} 1/s": best["K+FF"],
    }
    records = _drawn("drawings", data, laws, conditions)
    records |= _drawn("ahead", ahead, {f"the same, {1e3 * lag:.2g} ms ahead": best["K+FF"]}, conditions)
    learnt = learn(
        data | {"law": kinds["K+FF"]},
        repeats=4,
        measured_by="tracker",
        return_time=10.0,
        model=linear_counterpart(data["plant"]),
        progress=conditions.of("learning"),
        journal=conditions.journal("learning"),
    )
    records[f"K+FF, k = {_GAIN:g} 1/s, learnt in {learnt.best} repeats"] = learnt.last
    if plant != SERVO:
        whole = data | {
            "plant": published_spec("light-painting", plant)["plant"] | {"command_mode": "integrated"}
        }
        shaken = {"K+FF, with friction and a shaking base": kinds["K+FF"]}
        records |= _drawn("shaken", whole, shaken, conditions)
    asked = learnt.first.desired_position
    tables = [_table(records, asked), tuned.table(), learnt.table()]
    drawn = {"writing": lambda: writing_figure(records, asked)}
    return Reproduced(f"{SOURCE}/writing", tables, {}, drawn, plant)


def writing_spec(plant: str) -> dict[str, Any]:
    """Return P16's drawing on its arm, its commands counted from the last target, as a writing arm would have them.

    In physics without friction and without the shaking of the base, which no two repeats have alike.
    """
    data = published_spec("light-painting", plant)
    data.pop("laws")
    return data | {
        "name": "writing",
        "null_space": data["null_space"] | {"gain": _POSTURE},
        "plant": (linear_counterpart(data["plant"]) or data["plant"]) | {"command_mode": "integrated"},
        "metrics_from": "true",
        "limits": {"velocity": True},
    }


def _drawn(
    study: str, data: dict[str, Any], laws: Mapping[str, Any], conditions: Conditions
) -> dict[str, Record]:
    """Return the record of the drawing under each law."""
    numbered = {f"law {number}": law for number, law in enumerate(laws.values())}  # no folder is named "1/s"
    runs = conditions.run_study(study, data | {"laws": numbered}).runs.values()
    return {label: run.record for label, run in zip(laws, runs, strict=True)}


def _lag(data: dict[str, Any]) -> float:
    """Return how late the joints follow slow targets, s: the slope of their phase, the mean of all."""
    plant = CompliantPlant if data["plant"]["kind"] == "compliant" else Servo
    given = {key: value for key, value in data["plant"].items() if key != "kind"}
    arm, start = load_robot(data["robot"]), np.array(data["start"])
    model = plant(**given).linear_model(arm, start, data["period"])
    if model is None:
        return 0.0
    z = np.exp(2j * np.pi * _SLOW * data["period"])
    size, m = model.inputs.shape
    answer = np.linalg.solve(z * np.eye(size) - model.transition, model.inputs)[:m] * (z - 1) / data["period"]
    return float(np.mean(-np.angle(np.diagonal(answer)) / (2 * np.pi * _SLOW)))


def _errors(record: Record, asked: Array) -> Array:
    """Return the distances of the hand from the drawing's pose at each time, mm."""
    count = min(len(record), len(asked))
    return 1e3 * np.linalg.norm(record.position[:count] - asked[:count], axis=1)


def _off_line(record: Record, asked: Array) -> Array:
    """Return the distances of the hand from the drawn line, whenever it is there, mm."""
    line = asked[:: max(len(asked) // 4000, 1)]
    places = record.position[: len(asked)][:: max(len(asked) // 1000, 1)]
    return 1e3 * np.array([np.sqrt(np.min(np.sum((line - place) ** 2, axis=1))) for place in places])


def _table(records: Mapping[str, Record], asked: Array) -> Table:
    def row(label: str, record: Record) -> list[tuple[Column, Cell]]:
        errors, off = _errors(record, asked), _off_line(record, asked)
        rms = float(np.sqrt(np.mean(errors**2)))
        return [
            (Column("by"), label),
            (Column("position error RMS", "mm", ".3g"), rms),
            (Column("peak", "mm", ".3g"), float(errors.max())),
            (Column("farthest from the line", "mm", ".3g"), float(off.max())),
            (Column("RMS below a millimetre"), VerdictCell("yes" if rms < _GOAL else "no", rms < _GOAL)),
        ]

    return Table.of((row(*each) for each in records.items()), "P16's drawing on its arm")


def writing_figure(records: Mapping[str, Record], asked: Array) -> Figure:
    """Return one picture: what each means draws, errors shown ten times as large, in the plane of the drawing."""
    enlarged = 10.0
    centred = asked - asked.mean(axis=0)
    _, _, axes_of_plane = np.linalg.svd(centred, full_matrices=False)
    across, up = _upright(axes_of_plane)
    figure = figures.new_figure(_WIDTH, 0.4 + 2.2 * -(-len(records) // 3))
    grid = figure.subplots(-(-len(records) // 3), 3, squeeze=False)
    for i, (axes, (label, record)) in enumerate(zip(grid.flat, records.items(), strict=False)):
        count = min(len(record), len(asked))
        shown = asked[:count] + enlarged * (record.position[:count] - asked[:count])
        for path, colour, width in (
            (asked, figures.DESIRED, 0.6),
            (shown, figures.COLOURS[i % len(figures.COLOURS)], 0.9),
        ):
            axes.plot(1e3 * path @ across, 1e3 * path @ up, color=colour, lw=width)
        axes.set_aspect("equal")
        axes.set_title(f"{label}\nerrors × {enlarged:g}", fontsize="x-small")
        axes.set(xticks=[], yticks=[])
    for axes in grid.flat[len(records) :]:
        axes.remove()
    return figure


def _upright(directions: Array) -> tuple[Array, Array]:
    """Return two directions of a plane: across and, as far as it goes, up."""
    normal = directions[2]
    up = np.array([0.0, 0.0, 1.0]) - normal[2] * normal
    if np.linalg.norm(up) < 1e-6:
        return directions[0], directions[1]
    up /= np.linalg.norm(up)
    return np.cross(up, normal), up
