"""Hints on failed runs, in a line each: tasks that were not done, limits that were passed, and what helps."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from dqcontrol import laws
from dqcontrol.errors import CollisionWarning, LimitWarning, TaskWarning
from dqcontrol.experiments.feasibility import too_few_joints, way_out
from dqcontrol.experiments.prepared_experiment import Combination
from dqcontrol.laws.null_space import BestHeading
from dqcontrol.measures.metrics import AT_LIMIT, UNSEEN
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.sample import TIME
from dqcontrol.tables.number_texts import angle_text, length_text, percent_text

Trials = Sequence[Mapping[str, Any]]  # metrics of the repeats of one case

_MISSED = re.compile("not (reached|followed|kept)")
_BLOCKED = re.compile("(held by (?!the supervisor)|hit )(?!.*(out of reach|singularity)).*not reached: rests")
_ROUNDING = 1e-9  # as a share of a velocity limit
_OFTEN = 0.1  # of the samples at a velocity limit
_THROUGH = ("crossed", "contact")
_SETTLED = 4.0  # time constants of a loop, until 2 % of an error are left: the usual criterion


def warn_of_failures(cases: Sequence[tuple[Combination, Trials]], *, stacklevel: int) -> None:
    """Warn of what fell short in runs: of the first, and how many more there are, for each kind.

    Parameters
    ----------
    cases
        Each with the metrics of its repeats.
    stacklevel
        As for `warnings.warn`.
    """
    found = (
        (LimitWarning, (beyond_limits(case, trials) for case, trials in cases)),
        (LimitWarning, (beyond_velocities(case.names.label, trials) for case, trials in cases)),
        (CollisionWarning, (collided(case, trials) for case, trials in cases)),
        (TaskWarning, (not_done(case, trials) for case, trials in cases)),
    )
    for kind, said in found:
        if lines := [line for line in said if line]:
            more = f" (and {len(lines) - 1} more; see the table)" if len(lines) > 1 else ""
            warnings.warn(lines[0] + more, kind, stacklevel=stacklevel + 1)


def beyond_limits(case: Combination, trials: Trials) -> str:
    """Say how far repeats of one case went beyond the joint limits; nothing if none did."""
    crossed = [trial for trial in trials if (trial["limit_margin"] or 0.0) < -UNSEEN]
    if not crossed:
        return ""
    worst = min(crossed, key=lambda trial: trial["limit_margin"])
    robot, name, beyond = case.scene.robot, worst["limit_joint"], -worst["limit_margin"]
    turns = robot.joint_types[robot.joint_names.index(name)] == "revolute"
    by = angle_text(beyond) if turns else length_text(beyond)
    return f"{case.names.label}: {name} went {by} beyond its limits{_count(crossed, trials, ', ')}"


def beyond_velocities(label: str, trials: Trials) -> str:
    """Say how far commands of one case were beyond the velocity limits; nothing if none were."""
    fast = [trial for trial in trials if (trial["peak_velocity_share"] or 0.0) > 1 + _ROUNDING]
    if not fast:
        return ""
    worst = max(fast, key=lambda trial: trial["peak_velocity_share"])
    return (
        f"{label}: commands up to {percent_text(worst['peak_velocity_share'], 3)} of the velocity limits, in "
        f"{percent_text(worst['saturation'])} of the samples{_count(fast, trials, ', ')}: take a slower reference or "
        "less gain, or scale them with limits: {velocity: true}"
    )


def collided(case: Combination, trials: Trials) -> str:
    """Say what a robot of one case crossed or went through; nothing if it did not."""
    through = [trial for trial in trials if trial["failure"] in _THROUGH]
    if not through:
        return ""
    words = f"{case.names.label}: {through[0]['verdict']}{_count(through, trials, ', ')}"
    if through[0]["failure"] == "crossed" or str(through[0]["verdict"]).startswith("hit "):
        return words
    words += "; nothing stopped it there"
    if "through the floor" in words and not case.scene.robot.bases:
        words += ": the floor is z = 0, where the arm stands; 'base' in its robot file lifts it above"
    return words


def not_done(case: Combination, trials: Trials) -> str:
    """Say what is left of the task of one case, and what helps; nothing if all repeats did it."""
    if lost := [trial for trial in trials if trial["failure"] in ("grip", "outcome")]:
        return f"{case.names.label}: {lost[0]['verdict']}{_count(lost, trials, ', ')}"
    short = [trial for trial in trials if trial["failure"] and _MISSED.search(str(trial["verdict"]))]
    if not short:
        return ""
    worst = max(short, key=lambda trial: trial["final_error"] or 0.0)
    verdict, help_ = str(worst["verdict"]), "; ".join(_remedies(case, worst))
    if worst["failure"] in _THROUGH:  # `collided` says all of it
        verdict = verdict.rpartition("; ")[2]
        if not help_:
            return ""
    return f"{case.names.label}: {verdict}{_count(short, trials, ', ')}{': ' if help_ else ''}{help_}"


def _remedies(case: Combination, trial: Mapping[str, Any]) -> Iterator[str]:
    robot, law, task = case.scene.robot, case.variant.law, str(trial["verdict"])
    if robot.input_size < 6 and not isinstance(law, laws.PartialProportional):
        yield too_few_joints(robot)
    guided = isinstance(law, laws.GuidedProportional) or isinstance(law.null_space, BestHeading)
    if len(robot.drives) and not guided:
        yield (
            "a base with wheels cannot go sideways; plan its way with reference drive-to, or turn it with null_space "
            "best-heading"
        )
    if _BLOCKED.search(task) and not isinstance(case.scene.reference, PlannedWay):
        yield "reference plan-to goes around what is in the way"
        return  # joints that press, or try to get past, come to their limits
    margin = trial["limit_margin"]
    if margin is not None and margin < AT_LIMIT:
        yield f"{trial['limit_joint']} came to its position limit; start elsewhere, or turn the goal"
    if "in a singularity" in task:
        yield "no joint can move the hand that way from there; " + way_out(law)
    if (trial["saturation"] or 0.0) > _OFTEN:
        yield (
            f"commands were at the velocity limits in {percent_text(trial['saturation'])} of the samples; take a "
            "slower reference, or more time"
        )
    elif isinstance(law, laws.OpenLoop):
        yield "open-loop corrects no error; take a law that does"
    elif "not followed" in task and _feeds_nothing_forward(law):
        yield "a law without feed-forward lags; take proportional-feedforward, more gain or a slower reference"
    elif "still moves" in task:
        yield f"it takes more time (duration{_longer(case)}), or a loop that settles (dqcontrol check)"


def _longer(case: Combination) -> str:
    """Say how long a run should last that ends with its reference, before its joints have come to rest."""
    ends = case.scene.reference.duration
    rates = [abs(gain.value) for gain in case.gains or () if gain.loop != "null space" and gain.value]
    if not rates or case.scene.samples[-2, TIME] >= ends or math.isinf(ends):
        return ""
    return f": {ends + _SETTLED / min(rates):.3g}"


def _count(some: Trials, trials: Trials, before: str) -> str:
    return f"{before}in {len(some)} of {len(trials)} repeats" if len(trials) > 1 else ""


def _feeds_nothing_forward(law: laws.Law) -> bool:
    return isinstance(
        law, laws.IntegralPoseLaw | laws.HInfinity | laws.PartialProportional
    ) and not isinstance(law, laws.ProportionalFeedforward | laws.HInfinityTracking)
