"""Verdicts on what [P16] says of its circles (5.4, 5.6)."""

from __future__ import annotations

import numpy as np

from dqcontrol.reproductions.judgement import Judgement, listed
from dqcontrol.reproductions.pereira2016.hundredfold import SUFFIX
from dqcontrol.reproductions.pereira2016.own_periods import stretch
from dqcontrol.reproductions.pereira2016.pereira2016_catalogue import PHYSICS
from dqcontrol.reproductions.pereira2016.verdicts.evidence import (
    LAWS,
    LQR,
    PROPORTIONAL,
    ROBUST,
    Evidence,
    decides,
    record_of,
)

_PRINTED_BOUND = 0.12  # rad s
_ONE_CONTROLLER = 0.01  # sets whose errors differ by less are one controller with noise


@decides("lqr-trades-effort-for-error")
def _trade(evidence: Evidence) -> Judgement:
    spreads, holds = [], True
    for law in LQR:
        sets = evidence.ours.sets(law)
        errors = np.array([evidence.mean(law, each) for each in sets])
        steps = np.array([evidence.mean(law, each, "joint_step") for each in sets])
        spreads.append(np.ptp(errors) / errors.mean())
        holds = holds and (np.diff(errors) < 0).all() and (np.diff(steps) > 0).all()
    number = f"errors of the four sets differ by {listed([100 * s for s in spreads], '.2g')} % (R8, DQ)"
    if max(spreads) < _ONE_CONTROLLER:
        return Judgement(
            None, f"{number}: with q/r = 1000 in all four they are one controller; see lqr-surface"
        )
    return Judgement(bool(holds), number)


@decides("dq-error-rises-with-r")
def _rises(evidence: Evidence) -> Judgement:
    errors = [evidence.mean("LQR-DQ", each) for each in evidence.ours.sets("LQR-DQ")]
    spread = max(evidence.ours.deviation("LQR-DQ", each) for each in evidence.ours.sets("LQR-DQ"))
    rises = bool((np.diff(errors[:3]) > spread).all())
    return Judgement(rises, f"errors {listed(errors)}, deviation of repeats {spread:.2g}")


@decides("lqr-effort-bounded")
def _bounded(evidence: Evidence) -> Judgement:
    steps = [evidence.mean(law, each, "joint_step") for law in LQR for each in evidence.ours.sets(law)]
    return Judgement(max(steps) < _PRINTED_BOUND, f"Eff {_range(steps)}")


@decides("lower-r-more-effort")
def _lower_r(evidence: Evidence) -> Judgement:
    ratios = []
    for law in LQR:
        first, second, *_ = evidence.ours.sets(law)
        ratios.append(evidence.mean(law, first, "joint_step") / evidence.mean(law, second, "joint_step"))
    number = f"Eff at r = 0.001, q = 1 over r = 0.01, q = 10: {listed(ratios)} (R8, DQ)"
    if max(abs(ratio - 1) for ratio in ratios) < _ONE_CONTROLLER:
        return Judgement(None, f"{number}: one controller")
    return Judgement(min(ratios) > 1, number)


@decides("lqr-lower-torques")
def _torques(evidence: Evidence) -> Judgement:
    def loads(law: str, label: str = "") -> tuple[float, float]:
        torque = evidence.record(law, label).readings["spring_torque"].values
        return float(np.sqrt((torque**2).mean())), float(np.sqrt((np.diff(torque, axis=0) ** 2).mean()))

    if evidence.plant != PHYSICS:
        return Judgement(None, "servos have no torques")
    whole, steps = loads("K")
    found = {law: loads(law, evidence.ours.sets(law)[0]) for law in LQR}
    ratios = [ratio for load, step in found.values() for ratio in (load / whole, step / steps)]
    return Judgement(
        max(ratios) < 1 - _ONE_CONTROLLER,
        f"springs' torques over K's, RMS and RMS of their steps: R8 {listed(ratios[:2])}, DQ {listed(ratios[2:])}; "
        f"they bear the arm, {whole:.2f} N·m",
    )


@decides("commanded-above-actual-velocity")
def _commanded(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.mean(law, each, "control") * evidence.period() / evidence.mean(law, each, "joint_step")
        for law in LQR
        for each in evidence.ours.sets(law)
    ]
    return Judgement(
        min(ratios) > 2, f"commanded over actual joint path {min(ratios):.0f} … {max(ratios):.0f}"
    )


@decides("lqr-lower-effort")
def _effort(evidence: Evidence) -> Judgement:
    ratios = _over_k(evidence, "joint_step")
    return Judgement(max(ratios) < 1, f"Eff over K's: {_range(ratios)}")


@decides("lqr-worst-error-on-circle")
def _worst(evidence: Evidence) -> Judgement:
    ratios = _over_k(evidence, "error")
    return Judgement(min(ratios) > 1, f"Err over K's: {_range(ratios)}; the gains 50 and 31.6 give 1.58")


@decides("h-infinity-lowest-error-on-circle")
def _lowest(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        errors = {
            law: min(evidence.mean(law, each) for each in evidence.ours.sets(law))
            for law in (*PROPORTIONAL, *LQR, *laws)
        }
        first = min(errors, key=errors.__getitem__) in laws
        rise = evidence.mean(laws[0], "", "joint_step") - evidence.mean("K", "", "joint_step")
        return first and rise <= 0.025, f"Err HIR {errors[laws[0]]:.3g}, K {errors['K']:.3g}; Eff {rise:+.3f}"

    return evidence.of_robust(look)


@decides("lqr-dq-worse-tracking")
def _dq_over_r8(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.mean("LQR-DQ", each) / evidence.mean("LQR-R8", each) for each in evidence.ours.sets("LQR-R8")
    ]
    longer = stretch("LQR-DQ", evidence.period()) / stretch("LQR-R8", evidence.period())
    return Judgement(
        min(ratios) > 1,
        f"Err of DQ over R8 {_range(ratios)}; the same gain gives 1. As integrals over the printed durations, of which "
        f"DQ's is {100 * (longer - 1):.1f} % longer: {_range([longer * each for each in ratios])}",
    )


@decides("lqr-lower-first-peaks")
def _peaks(evidence: Evidence) -> Judgement:
    """Judge by K, and by HIR where it followed."""
    first = evidence.ours.sets("LQR-R8")[0]
    followed = [law for law in ("HIR", f"HIR{SUFFIX}") if evidence.followed(law)]
    others = ("K", *followed)
    shown = dict.fromkeys(("K", *LQR, "HIR", f"HIR{SUFFIX}"))
    peaks = {law: evidence.first_peak("hand_speed", law, first if law in LQR else "") for law in shown}
    lower = max(peaks[law] for law in LQR) < min(peaks[law] for law in others)
    text = ", ".join(f"{law} {peak:.2g}" for law, peak in peaks.items())
    return Judgement(lower, f"first peaks of the hand's speed, m/s: {text}; judged by {' and '.join(others)}")


@decides("large-first-commands")
def _first_commands(evidence: Evidence) -> Judgement:
    """Judge by the laws that followed."""
    ratios = {}
    for law in (*LAWS, *(law + SUFFIX for law in ROBUST)):
        if law in LQR or evidence.followed(law):
            record = evidence.record(law, evidence.ours.sets(law)[0])
            command = np.linalg.norm(record.command, axis=1)
            first = record.time < 1.0
            ratios[law] = float(command[first].max() / command[~first].mean())
    return Judgement(
        min(ratios.values()) > 1,
        "first peak over later mean: " + ", ".join(f"{law} {ratio:.2f}" for law, ratio in ratios.items()),
    )


@decides("h-infinity-fast-at-low-rate")
def _low_rate(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        slow = evidence.mean(laws[0], "", "hand_speed") / evidence.mean("K", "", "hand_speed")
        setting = evidence.changed("circle", ("K", laws[0]), period=0.008)
        lengths = [
            np.linalg.norm(np.diff(record_of(setting, law).position, axis=0), axis=1).sum()
            for law in (laws[0], "K")
        ]
        fast = float(lengths[0] / lengths[1])
        return slow > 1.1 and slow > fast, f"L.Vel of HIR over K: {slow:.3f} at 20 ms, {fast:.3f} at 8 ms"

    return evidence.of_robust(look)


def _over_k(evidence: Evidence, metric: str) -> list[float]:
    return [
        evidence.mean(law, each, metric) / evidence.mean("K", "", metric)
        for law in LQR
        for each in evidence.ours.sets(law)
    ]


def _range(values: list[float]) -> str:
    return f"{min(values):.3f} … {max(values):.3f}"
