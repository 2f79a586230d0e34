"""Verdicts on what [P16] says of its circles (5.4, 5.6)."""

from __future__ import annotations

import numpy as np

from dqcontrol.reproductions.judgement import Judgement, listed
from dqcontrol.reproductions.pereira2016.verdicts.evidence import (
    LAWS,
    LQR,
    ROBUST,
    Evidence,
    decides,
    record_of,
)

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
    errors = {law: min(evidence.mean(law, each) for each in evidence.ours.sets(law)) for law in LAWS}
    first = min(errors, key=errors.__getitem__) in ROBUST
    rise = evidence.mean("HIR", "", "joint_step") - evidence.mean("K", "", "joint_step")
    return Judgement(
        first and rise <= 0.025, f"Err HIR {errors['HIR']:.3g}, K {errors['K']:.3g}; Eff {rise:+.3f}"
    )


@decides("lqr-dq-worse-tracking")
def _dq_over_r8(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.mean("LQR-DQ", each) / evidence.mean("LQR-R8", each) for each in evidence.ours.sets("LQR-R8")
    ]
    return Judgement(min(ratios) > 1, f"Err of DQ over R8 {_range(ratios)}; the same gain gives 1")


@decides("lqr-lower-first-peaks")
def _peaks(evidence: Evidence) -> Judgement:
    first = evidence.ours.sets("LQR-R8")[0]
    peaks = {law: evidence.first_peak("hand_speed", law, first if law in LQR else "") for law in LAWS}
    lower = max(peaks[law] for law in LQR) < min(peaks["K"], peaks["HIR"])
    text = ", ".join(f"{law} {peaks[law]:.2g}" for law in ("K", "LQR-R8", "LQR-DQ", "HIR"))
    return Judgement(lower, f"first peaks of the hand's speed, m/s: {text}")


@decides("large-first-commands")
def _first_commands(evidence: Evidence) -> Judgement:
    ratios = []
    for law in LAWS:
        record = evidence.record(law, evidence.ours.sets(law)[0])
        command = np.linalg.norm(record.command, axis=1)
        first = record.time < 1.0
        ratios.append(float(command[first].max() / command[~first].mean()))
    return Judgement(min(ratios) > 1, f"first peak over later mean: {_range(ratios)}")


@decides("h-infinity-fast-at-low-rate")
def _low_rate(evidence: Evidence) -> Judgement:
    slow = evidence.mean("HIR", "", "hand_speed") / evidence.mean("K", "", "hand_speed")
    setting = evidence.changed("circle", ("K", "HIR"), period=0.008)
    lengths = [
        np.linalg.norm(np.diff(record_of(setting, law).position, axis=0), axis=1).sum()
        for law in ("HIR", "K")
    ]
    fast = float(lengths[0] / lengths[1])
    return Judgement(
        slow > 1.1 and slow > fast, f"L.Vel of HIR over K: {slow:.3f} at 20 ms, {fast:.3f} at 8 ms"
    )


def _over_k(evidence: Evidence, metric: str) -> list[float]:
    return [
        evidence.mean(law, each, metric) / evidence.mean("K", "", metric)
        for law in LQR
        for each in evidence.ours.sets(law)
    ]


def _range(values: list[float]) -> str:
    return f"{min(values):.3f} … {max(values):.3f}"
