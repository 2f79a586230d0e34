"""Verdicts on what [P16] says in its appendices C and D."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dqcontrol.measures.metrics import evaluate
from dqcontrol.reproductions.judgement import ABOUT_THE_ROBOT, Judgement, listed
from dqcontrol.reproductions.pereira2016.verdicts.evidence import PROPORTIONAL, Evidence, decides, record_of
from dqcontrol.reproductions.pereira2016.verdicts.grid import grid_of

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


def _range(values: list[float]) -> str:
    return f"{min(values):.3f} … {max(values):.3f}"


def _by_set(evidence: Evidence, metric: str, where: str) -> list[float]:
    return [evidence.mean(_LQR, each, metric, where) for each in evidence.ours.sets(_LQR, where)]


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
    ratios = _over(evidence, IIWA, "error")
    followed = []  # where targets do not move on from the measured angle, the error is another one
    for where in IIWA:
        setting = evidence.changed(
            where.replace(" ", "-"), ("K", _LQR), plant={"kind": "servo", "time_constant": 0.05}
        )
        lqr, k = (evaluate(record_of(setting, law)).error.integral for law in (_LQR, "K"))
        followed.append(lqr / k)
    return Judgement(
        min(ratios) > 1,
        f"Err over K's and K+FF's: {_range(ratios)} with targets from the measured angle; over K's with integrated "
        f"targets {listed(followed)}",
    )


@decides("simulated-error-rises-with-r")
def _rises(evidence: Evidence) -> Judgement:
    errors, steps = (_by_set(evidence, key, IIWA[0]) for key in ("error", "joint_step"))
    rises = all(b > a for a, b in pairwise(errors))
    barely = max(steps) / min(steps) <= 1.02
    return Judgement(rises and barely, f"circle: Err {listed(errors, '.4f')}, Eff {listed(steps, '.4f')}")


@decides("simulated-lqr-slower-hand")
def _slower(evidence: Evidence) -> Judgement:
    ratios = np.array(_over(evidence, IIWA, "hand_speed")).reshape(-1, 2)
    count = int((ratios < 1).all(axis=1).sum())
    return Judgement(count > 4, f"below both in {count} of {len(ratios)}; {_range(list(ratios.ravel()))}")


@decides("simulated-hand-faster-with-r")
def _faster(evidence: Evidence) -> Judgement:
    steps = [
        100 * (b / a - 1)
        for where in IIWA
        for metric in ("hand_speed", "hand_acceleration")
        for a, b in pairwise(_by_set(evidence, metric, where))
    ]
    count = sum(step > 0 for step in steps)
    number = f"{count} of {len(steps)} steps rise, by {min(steps):+.2g} … {max(steps):+.2g} %"
    if max(map(abs, steps)) < 1:
        return Judgement(None, f"{number}: q/r = 1000 in all four sets, one controller")
    return Judgement(count > len(steps) / 2, number)


@decides("larger-r-less-effort")
def _less_effort(evidence: Evidence) -> Judgement:
    return _first_to_last(evidence, "joint_step", "Eff")


@decides("larger-q-less-error")
def _less_error(evidence: Evidence) -> Judgement:
    return _first_to_last(evidence, "error", "Err")


def _first_to_last(evidence: Evidence, metric: str, name: str) -> Judgement:
    changes, noise = [], []
    for where in MEKA:
        values = _by_set(evidence, metric, where)
        changes.append(100 * (values[-1] / values[0] - 1))
        noise.append(
            100 * evidence.ours.deviation(_LQR, evidence.ours.sets(_LQR, where)[0], metric, where) / values[0]
        )
    number = (
        f"{name} last over first set {listed(changes, '+.2f')} %, deviation of repeats {max(noise):.2g} %"
    )
    if max(abs(change) for change in changes) < 1:
        return Judgement(None, f"{number}: q/r = 1000 in all four sets, one controller")
    return Judgement(max(changes) < 0, number)


@decides("lqr-less-effort-and-speed")
def _less_both(evidence: Evidence) -> Judgement:
    steps, speeds = (_over(evidence, MEKA, key) for key in ("joint_step", "hand_speed"))
    holds = max(steps + speeds) < 1
    return Judgement(holds, f"Eff {_range(steps)}, L.Vel {_range(speeds)} of K's and K+FF's")


@decides("lqr-less-precise")
def _less_precise(evidence: Evidence) -> Judgement:
    ratios = _over(evidence, MEKA, "error")
    return Judgement(min(ratios) > 1, f"Err over K's and K+FF's: {_range(ratios)}; the gains give 1.58")


@decides("lqr-lowest-peaks")
def _lowest_peaks(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.first_peak(key, _LQR, evidence.ours.sets(_LQR, where)[-1], where)
        / evidence.first_peak(key, law, "", where)
        for where in MEKA
        for key in ("hand_speed", "hand_acceleration")
        for law in PROPORTIONAL
    ]
    return Judgement(max(ratios) < 1, f"first peaks over K's and K+FF's: {_range(ratios)}")


@decides("lqr-lower-peaks-throughout")
def _later_peaks(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.peak(key, _LQR, evidence.ours.sets(_LQR, where)[-1], where, later=True)
        / evidence.peak(key, law, "", where, later=True)
        for where in MEKA
        for key in ("hand_speed", "hand_acceleration")
        for law in PROPORTIONAL
    ]
    return Judgement(max(ratios) < 1, f"later peaks over K's and K+FF's: {_range(ratios)}")


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
    shares = []
    for robot in _ROBOTS:
        steps = np.diff(_surface(evidence, robot, "joint_step")[2], axis=1)
        shares.append(100 * float((steps < 0).sum() / np.isfinite(steps).sum()))
    return Judgement(
        shares[0] > 50,
        f"steps of r in which Eff falls: iiwa {shares[0]:.0f} %, of which it is said; meka {shares[1]:.0f} %",
    )


@decides("surface-speed")
def _surface_speed(evidence: Evidence) -> Judgement:
    iiwa, meka = (_rank_correlation(*_against_gain(evidence, robot, "hand_speed")) for robot in _ROBOTS)
    return Judgement(
        iiwa > 0.5,
        f"rank correlation of L.Vel with q/r: iiwa {iiwa:.2f}, of which it is said; meka {meka:.2f}",
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
    texts, rises = [], False
    for robot in _ROBOTS:
        gains, errors = _against_gain(evidence, robot, "error")
        levels = sorted(set(np.round(gains, 9)))
        means = [float(errors[np.isclose(gains, level)].mean()) for level in levels]
        count = int((np.diff(means) > 0).sum())
        rises = rises or count > 0
        texts.append(f"{robot} {count} of {len(means) - 1} steps")
    return Judgement(rises, f"steps of √(q/r) in which Err rises: {'; '.join(texts)}")


def _against_gain(evidence: Evidence, robot: str, metric: str) -> tuple[np.ndarray, np.ndarray]:
    """Return √(q/r) and the metric of every cell whose run did not fail."""
    qs, rs, grid = _surface(evidence, robot, metric)
    gains = np.sqrt(np.array(qs)[:, None] / np.array(rs)[None, :])
    kept = np.isfinite(grid)
    return gains[kept], grid[kept]


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    first, second = (np.unique(np.round(values, 12), return_inverse=True)[1] for values in (a, b))
    return float(np.corrcoef(first, second)[0, 1])
