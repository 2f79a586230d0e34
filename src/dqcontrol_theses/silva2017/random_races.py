"""The laws of [S17]'s comparison on many random goals."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.experiments import PreparedRobot
from dqcontrol.laws import DampedPoseInverse, Law
from dqcontrol.references import SetPoint, random_goals
from dqcontrol.tables import Cell, Column, Table
from dqcontrol_theses.catalogue import Conditions
from dqcontrol_theses.silva2017.goal_runs import RaceOutcome, guided_outcome, matched_gain, outcome
from dqcontrol_theses.silva2017.inverses import UNDAMPED
from dqcontrol_theses.silva2017.specs import GOOD_ENOUGH, S17, setting_of

_SEED = 2017
_SECONDS = 120.0
_AT_ONCE = 5  # goals
_SETTLED = 1e-3  # last error norm of a run that has arrived
_CLASSIC, _MATCHED = "classic", "classic, matched to S17's on each goal"
_LEVEL = 0.05  # λ of S17's law in the spec
_GUIDED = "remedy: guided K along a planned way"


@dataclass(frozen=True)
class GoalBox:
    """Where goals are drawn: half the side of the box for the base, m, and the range of its heading, rad."""

    name: str
    reach: float
    heading: float

    def goals(self, scene: PreparedRobot, count: int) -> Array:
        """Return hand poses of configurations drawn in the box, the arm within its limits, shape (count, 8)."""
        drawn = random_goals(
            scene.robot, scene.start, count, reach=self.reach, heading=self.heading, seed=_SEED
        )
        return scene.robot.fkm(drawn)


BOXES = (GoalBox("near", 0.5, math.pi / 4), GoalBox("far", 1.5, math.pi))


class Heat(NamedTuple):
    """Some of the goals of a box: `first`, and those after it before `last`, of so many drawn."""

    box: GoalBox
    drawn: int
    first: int
    last: int


@dataclass(frozen=True)
class HeatOutcome:
    """By law what came of its run to each goal; None where there was none."""

    found: dict[str, list[RaceOutcome | None]]


Races = Mapping[GoalBox, Sequence[HeatOutcome]]


def race_on_random_goals(count: int, conditions: Conditions) -> Races:
    """Run all laws to so many goals of each box.

    The goals are hand poses of configurations with the base in the box and the arm within its limits; runs last two
    minutes on ideal joints, without limits, which the remedy's plan keeps nevertheless.
    """
    heats = [
        Heat(box, count, first, min(first + _AT_ONCE, count))
        for box in BOXES
        for first in range(0, count, _AT_ONCE)
    ]
    text = setting_of("comparison", duration=_SECONDS).text
    outcomes = dict(
        zip(heats, conditions.each("random goals", run_heat, HeatOutcome, heats, text), strict=True)
    )
    return {box: [outcomes[heat] for heat in heats if heat.box == box] for box in BOXES}


def random_tables(count: int, races: Races) -> list[Table]:
    """Return of each box one row a law: how many goals it reached, and medians over those that the classic one did."""
    return [_table(box, count, heats) for box, heats in races.items()]


def overshooting(label: str, races: Races, least: float) -> tuple[int, int]:
    """Return on how many goals the classic law overshoots by more than that and than another law, and of how many."""
    pairs = [
        (linear.overshoot, other.overshoot)
        for heats in races.values()
        for heat in heats
        for linear, other in zip(heat.found[_CLASSIC], heat.found[label], strict=True)
        if linear and other
    ]
    return sum(linear > max(least, other) for linear, other in pairs), len(pairs)


def run_heat(heat: Heat) -> HeatOutcome:
    """Run all laws to some goals."""
    setting = setting_of("comparison", duration=_SECONDS)
    scene, period = setting.scene, setting.spec.period
    classic = setting.spec.law_by_label[_CLASSIC]
    laws = setting.spec.law_by_label | {
        "classic, N† undamped": msgspec.structs.replace(classic, inverse=UNDAMPED),
        f"classic, N† damped, λ = {_LEVEL:g}": msgspec.structs.replace(
            classic, inverse=DampedPoseInverse(damping=_LEVEL)
        ),
    }
    found: dict[str, list[RaceOutcome | None]] = {label: [] for label in (*laws, _GUIDED, _MATCHED)}
    for goal in _goals(heat.box, heat.drawn)[heat.first : heat.last]:
        samples = SetPoint(goal).samples(scene.samples[:, -1])

        def run(law: Law, samples: np.ndarray = samples) -> RaceOutcome:
            return outcome(scene.robot, scene.start, samples, law, period)

        for label, law in laws.items():
            found[label].append(run(law))
        found[_GUIDED].append(guided_outcome(scene.robot, scene.start, samples, period))
        target = found[S17][-1]
        gain = matched_gain(
            lambda k, run=run: run(msgspec.structs.replace(classic, gain=k)).settling,
            target.settling if target else math.nan,
        )
        found[_MATCHED].append(None if gain is None else run(msgspec.structs.replace(classic, gain=gain)))
    return HeatOutcome(found)


@functools.cache
def _goals(box: GoalBox, count: int) -> Array:
    """Return the goals of a box, which all its heats share."""
    return box.goals(setting_of("comparison", duration=_SECONDS).scene, count)


def _table(box: GoalBox, count: int, heats: Sequence[HeatOutcome]) -> Table:
    found = {label: [outcome for heat in heats for outcome in heat.found[label]] for label in heats[0].found}
    title = (
        f"{count} {box.name} goals: base within ±{box.reach:g} m and ±{math.degrees(box.heading):.0f}°, any arm within "
        f"its limits, hand above 5 cm, seed {_SEED}; {_SECONDS:g} s without limits"
    )
    return Table.of((_row(label, found[label], found[_CLASSIC], found[S17]) for label in found), title)


def _row(
    label: str,
    mine: list[RaceOutcome | None],
    classic: list[RaceOutcome | None],
    nonlinear: list[RaceOutcome | None],
) -> list[tuple[Column, Cell]]:
    runs = [each for each in mine if each is not None]
    effort = _ratios(mine, classic, "effort")
    quartiles = f"{np.quantile(effort, 0.25):.3g} … {np.quantile(effort, 0.75):.3g}" if effort else ""
    settled = [each.settling for each in runs if math.isfinite(each.settling)]
    first = _median(_ratios(mine, classic, "first"))
    return [
        (Column("Law"), label),
        (
            Column(f"First below {GOOD_ENOUGH}: S17's stop"),
            sum(math.isfinite(each.first_below) for each in runs),
        ),
        (Column(f"Settled below {GOOD_ENOUGH}"), len(settled)),
        (Column(f"Below {_SETTLED:g} at the end"), sum(each.final < _SETTLED for each in runs)),
        (Column("Iterations, median", "", ".4g"), _median(settled)),
        (Column("Effort over classic, median", "", ".3g"), _median(effort)),
        (Column("Quartiles"), quartiles),
        (Column("Effort of S17 over it, median", "", ".3g"), _median(_ratios(nonlinear, mine, "effort"))),
        (Column("First command over classic, median", "", ".3g"), first),
        (Column("Overshoot above 1 %"), sum(each.overshoot > 0.01 for each in runs)),
    ]


def _ratios(over: list[RaceOutcome | None], under: list[RaceOutcome | None], number: str) -> list[float]:
    """Return ratios over the goals where both runs settled."""
    return [
        getattr(a, number) / getattr(b, number)
        for a, b in zip(over, under, strict=True)
        if a and b and math.isfinite(a.settling) and math.isfinite(b.settling)
    ]


def _median(values: list[float]) -> float | None:
    return float(np.median(values)) if values else None
