"""Verdicts on what [P16] says in its appendices C and D."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from dqcontrol.measures import evaluate
from dqcontrol_theses.judgement import ABOUT_THE_ROBOT, Judgement, by_cases, listed
from dqcontrol_theses.pereira2016.verdicts.circle_verdicts import NO_DIFFERENCE, ONE_CONTROLLER, span_of
from dqcontrol_theses.pereira2016.verdicts.evidence import (
    PROPORTIONAL,
    Cases,
    Evidence,
    agreed,
    decides,
    grid_of,
    record_of,
)

IIWA, MEKA = ("iiwa circle", "iiwa square"), ("meka circle", "meka square")
_ROBOTS = ("iiwa", "meka")
_LQR = "LQR-R8"


def _over(evidence: Evidence, experiments: tuple[str, ...], metric: str) -> list[float]:
    """Return a metric of every LQR set over those of K and K+FF."""
    return [
        evidence.mean(_LQR, each, metric, where) / evidence.mean(law, "", metric, where)
        for where in experiments
        for each in evidence.ours.sets(_LQR, where)
        for law in PROPORTIONAL
    ]


@decides("robot-varies-more-than-simulation")
def _varies(evidence: Evidence) -> Judgement:
    shares = [
        100 * evidence.ours.deviation("K", "", "error", where) / evidence.mean("K", "", "error", where)
        for where in MEKA
    ]
    return Judgement(
        None,
        f"Err of K repeats to {listed(shares, '.2g')} % with noise, exactly without: by construction",
        ABOUT_THE_ROBOT,
    )


@decides("simulated-lqr-worse")
def _worse(evidence: Evidence) -> Judgement:
    return _by_both_simulators(evidence, "error", lambda ratios: min(ratios) > 1, "Err")


@decides("simulated-lqr-slower-hand")
def _slower(evidence: Evidence) -> Judgement:
    return _by_both_simulators(
        evidence, "hand_speed", lambda ratios: max(ratios) < 1 - NO_DIFFERENCE, "L.Vel"
    )


def _by_both_simulators(
    evidence: Evidence, metric: str, holds: Callable[[list[float]], bool], name: str
) -> Judgement:
    """Judge where targets move on from the measured angle, as was chosen, and where from the last target."""
    cases: Cases = {}
    texts = []
    for where in IIWA:
        chosen = _over(evidence, (where,), metric)
        setting = evidence.changed(
            where.replace(" ", "-"), (*PROPORTIONAL, _LQR), plant={"kind": "servo", "time_constant": 0.05}
        )
        lqr, *others = (
            getattr(evaluate(record_of(setting, law)), metric).integral for law in (_LQR, *PROPORTIONAL)
        )
        integrated = [lqr / other for other in others]
        cases[where] = agreed("what a target is counted from", holds(chosen), holds(integrated))
        texts.append(f"{where} {span_of(chosen)} and {span_of(integrated)}")
    return by_cases(
        cases,
        f"{name} over K's and K+FF's by targets from the measured angle, and from the last target: {'; '.join(texts)}",
    )


@decides("simulated-error-rises-with-r")
def _rises(evidence: Evidence) -> Judgement:
    errors, steps = (evidence.by_set(_LQR, key, IIWA[0]) for key in ("error", "joint_step"))
    return by_cases(
        {
            "an error that rises": all(b > (1 + NO_DIFFERENCE) * a for a, b in pairwise(errors)),
            "Eff that barely changes": max(steps) / min(steps) <= 1.02,
        },
        f"circle: Err {listed(errors, '.4f')}, Eff {listed(steps, '.4f')}: {ONE_CONTROLLER}",
    )


@decides("simulated-hand-faster-with-r")
def _faster(evidence: Evidence) -> Judgement:
    steps = [
        b / a - 1
        for where in IIWA
        for metric in ("hand_speed", "hand_acceleration")
        for a, b in pairwise(evidence.by_set(_LQR, metric, where))
    ]
    count = sum(step > NO_DIFFERENCE for step in steps)
    return Judgement(
        count > len(steps) / 2,
        f"{count} of {len(steps)} steps rise by more than 1 %, the most by {100 * max(steps):.1g} %: {ONE_CONTROLLER}",
    )


@decides("larger-r-less-effort")
def _less_effort(evidence: Evidence) -> Judgement:
    return _first_to_last(evidence, "joint_step", "Eff")


@decides("larger-q-less-error")
def _less_error(evidence: Evidence) -> Judgement:
    return _first_to_last(evidence, "error", "Err")


def _first_to_last(evidence: Evidence, metric: str, name: str) -> Judgement:
    values = {where: evidence.by_set(_LQR, metric, where) for where in MEKA}
    changes = {where: each[-1] / each[0] - 1 for where, each in values.items()}
    return by_cases(
        {where: change < -NO_DIFFERENCE for where, change in changes.items()},
        f"{name} last over first set {listed([100 * each for each in changes.values()], '+.2f')} %: {ONE_CONTROLLER}",
    )


@decides("lqr-less-effort-and-speed")
def _less_both(evidence: Evidence) -> Judgement:
    steps, speeds = (_over(evidence, MEKA, key) for key in ("joint_step", "hand_speed"))
    return by_cases(
        {"Eff": max(steps) < 1, "L.Vel": max(speeds) < 1},
        f"Eff {span_of(steps)}, L.Vel {span_of(speeds)} of K's and K+FF's",
    )


@decides("lqr-less-precise")
def _less_precise(evidence: Evidence) -> Judgement:
    ratios = {where: _over(evidence, (where,), "error") for where in MEKA}
    return by_cases(
        {where: min(each) > 1 for where, each in ratios.items()},
        f"Err over K's and K+FF's: {', '.join(map(span_of, ratios.values()))}; the gains give 1.58",
    )


@decides("lqr-lowest-peaks")
def _lowest_peaks(evidence: Evidence) -> Judgement:
    return _lower_peaks(evidence, later=False)


@decides("lqr-lower-peaks-throughout")
def _later_peaks(evidence: Evidence) -> Judgement:
    return _lower_peaks(evidence, later=True)


def _lower_peaks(evidence: Evidence, *, later: bool) -> Judgement:
    def peak(key: str, law: str, each: str, where: str) -> float:
        return evidence.peak(key, law, each, where, later=later)

    ratios = {
        f"{name}, {where}": [
            peak(key, _LQR, evidence.ours.sets(_LQR, where)[-1], where) / peak(key, law, "", where)
            for law in PROPORTIONAL
        ]
        for where in MEKA
        for name, key in (("L.Vel", "hand_speed"), ("L.Acc", "hand_acceleration"))
    }
    found = "; ".join(f"{name} {span_of(each)}" for name, each in ratios.items())
    return by_cases(
        {name: max(each) < 1 for name, each in ratios.items()},
        f"{'later' if later else 'first'} peaks over K's and K+FF's: {found}",
    )


@decides("lqr-higher-first-effort")
def _first_effort(evidence: Evidence) -> Judgement:
    where = MEKA[0]
    ratio = evidence.first_peak("joint_step", _LQR, evidence.ours.sets(_LQR, where)[-1], where)
    ratio /= evidence.first_peak("joint_step", "K", "", where)
    return Judgement(ratio > 1, f"first peak of the joint step over K's: {ratio:.3f}")


def _surface(evidence: Evidence, robot: str, metric: str) -> tuple[list[float], list[float], np.ndarray]:
    return grid_of(evidence.ours.rows[robot], f"{metric}.integral")


@decides("surface-larger-r-less-effort")
def _surface_effort(evidence: Evidence) -> Judgement:
    steps = [np.diff(_surface(evidence, robot, "joint_step")[2], axis=1) for robot in _ROBOTS]
    shares = [100 * float((each < 0).sum() / np.isfinite(each).sum()) for each in steps]
    return by_cases(
        {"iiwa": shares[0] > 50, "meka, of which the reverse is said": shares[1] < 50},
        f"steps of r in which Eff falls: iiwa {shares[0]:.0f} %, meka, of which the reverse is said, {shares[1]:.0f} %",
    )


@decides("surface-speed")
def _surface_speed(evidence: Evidence) -> Judgement:
    found = {robot: _rank_correlation(*_against_gain(evidence, robot, "hand_speed")) for robot in _ROBOTS}
    text = ", ".join(f"{robot} {value:.2f}" for robot, value in found.items())
    return by_cases(
        {robot: value > 0.5 for robot, value in found.items()}, f"rank correlation of L.Vel with q/r: {text}"
    )


@decides("q-matters-more-than-r")
def _q_or_r(evidence: Evidence) -> Judgement:
    qs, rs, errors = _surface(evidence, "iiwa", "error")
    low, high = qs.index(1), qs.index(10)
    ratios = [
        float(errors[high, j] / errors[low, rs.index(r / 10)]) for j, r in enumerate(rs) if r / 10 in rs
    ]
    return Judgement(
        max(ratios) < 0.99, f"iiwa, q = 1: Err after q × 10 over Err after r / 10: {listed(ratios)}"
    )


@decides("surface-error")
def _surface_error(evidence: Evidence) -> Judgement:
    texts = []
    cases: Cases = {}
    for robot in _ROBOTS:
        gains, errors = _against_gain(evidence, robot, "error")
        levels = sorted(set(np.round(gains, 9)))
        means = [float(errors[np.isclose(gains, level)].mean()) for level in levels]
        count = int((np.diff(means) > 0).sum())
        cases[robot] = count > 0
        texts.append(f"{robot} {count} of {len(means) - 1} steps")
    return by_cases(cases, f"steps of √(q/r) in which Err rises: {'; '.join(texts)}")


def _against_gain(evidence: Evidence, robot: str, metric: str) -> tuple[np.ndarray, np.ndarray]:
    """Return √(q/r) and the metric of every cell whose run did not fail."""
    qs, rs, grid = _surface(evidence, robot, metric)
    gains = np.sqrt(np.array(qs)[:, None] / np.array(rs)[None, :])
    kept = np.isfinite(grid)
    return gains[kept], grid[kept]


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    first, second = (np.unique(np.round(values, 12), return_inverse=True)[1] for values in (a, b))
    return float(np.corrcoef(first, second)[0, 1])
