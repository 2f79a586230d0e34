"""Verdicts on what [P16] says of its circles (5.4, 5.6)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dqcontrol.loop import Record
from dqcontrol_theses.judgement import Judgement, by_cases, listed
from dqcontrol_theses.pereira2016.own_periods import stretch
from dqcontrol_theses.pereira2016.pereira2016_catalogue import PHYSICS
from dqcontrol_theses.pereira2016.verdicts.evidence import (
    LQR,
    PROPORTIONAL,
    Cases,
    Evidence,
    decides,
    record_of,
)

_PRINTED_BOUND = 0.12  # rad s
# sets whose numbers differ by less are one controller with noise: repeats deviate by 0.8 %
NO_DIFFERENCE = 0.01
ONE_CONTROLLER = "with q/r = 1000 in all four they are one controller"


@decides("lqr-trades-effort-for-error")
def _trade(evidence: Evidence) -> Judgement:
    cases: Cases = {}
    spreads = []
    for law in LQR:
        errors, steps = evidence.by_set(law), evidence.by_set(law, "joint_step")
        spreads.append(100 * np.ptp(errors) / np.mean(errors))
        cases[law] = _falls(errors) and _falls(steps[::-1])
    number = f"errors of the four sets differ by {listed(spreads, '.2g')} % (R8, DQ)"
    return by_cases(cases, f"{number}: {ONE_CONTROLLER}; over a grid of weights see lqr-surface")


@decides("dq-error-rises-with-r")
def _rises(evidence: Evidence) -> Judgement:
    errors = evidence.by_set("LQR-DQ")
    return by_cases({"LQR-DQ": _falls(errors[2::-1])}, f"errors {listed(errors)}: {ONE_CONTROLLER}")


@decides("lower-r-more-effort")
def _lower_r(evidence: Evidence) -> Judgement:
    cases: Cases = {}
    ratios = []
    for law in LQR:
        first, second, *_ = evidence.by_set(law, "joint_step")
        ratios.append(first / second)
        cases[law] = _falls([first, second])
    number = f"Eff at r = 0.001, q = 1 over r = 0.01, q = 10: {listed(ratios)} (R8, DQ)"
    return by_cases(cases, f"{number}: {ONE_CONTROLLER}")


def _falls(values: list[float]) -> bool:
    """Tell whether each value is below the one before it by more than noise."""
    return all(after < (1 - NO_DIFFERENCE) * before for before, after in pairwise(values))


@decides("lqr-effort-bounded")
def _bounded(evidence: Evidence) -> Judgement:
    """Judge the cause by K, which has no r."""
    steps = [each for law in LQR for each in evidence.by_set(law, "joint_step")]
    without = evidence.mean("K", "", "joint_step")
    cases: Cases = {
        "Eff below 0.12": max(steps) < _PRINTED_BOUND,
        "that r keeps it there": max(steps) < _PRINTED_BOUND <= without,
    }
    return by_cases(cases, f"Eff {span_of(steps)}; of K, which has no r, {without:.3f}")


@decides("lqr-lower-torques")
def _torques(evidence: Evidence) -> Judgement:
    def loads(law: str, label: str = "") -> tuple[float, float]:
        torque = evidence.record(law, label).readings["spring_torque"].values
        return float(np.sqrt((torque**2).mean())), float(np.sqrt((np.diff(torque, axis=0) ** 2).mean()))

    if evidence.plant != PHYSICS:
        return Judgement(None, "servos have no torques")
    whole, steps = loads("K")
    cases: Cases = {}
    texts = []
    for law in LQR:
        load, step = loads(law, evidence.ours.sets(law)[0])
        ratios = {"torques": load / whole, "their steps": step / steps}
        cases |= {f"{law}'s {what}": ratio < 1 - NO_DIFFERENCE for what, ratio in ratios.items()}
        texts.append(f"{law} {listed(list(ratios.values()))}")
    return by_cases(
        cases,
        f"springs' torques over K's, RMS and RMS of their steps: {', '.join(texts)}; they bear {whole:.2f} N·m",
    )


@decides("commanded-above-actual-velocity")
def _commanded(evidence: Evidence) -> Judgement:
    def ratio(law: str, parameters: str = "") -> float:
        command, step = (evidence.mean(law, parameters, key) for key in ("control", "joint_step"))
        return command * evidence.period() / step

    ratios = {law: ratio(law, each) for law in (*PROPORTIONAL, *LQR) for each in evidence.ours.sets(law)}
    of_robust, text = evidence.of_robust(
        lambda laws, _: (min(map(ratio, laws)) > 2, listed([ratio(law) for law in laws], ".0f"))
    )
    found = ", ".join(f"{law} {value:.0f}" for law, value in ratios.items())
    cases = {law: value > 2 for law, value in ratios.items()} | of_robust
    return by_cases(cases, f"commanded over actual joint path: {found}; HIR, HIRT {text}")


@decides("lqr-lower-effort")
def _effort(evidence: Evidence) -> Judgement:
    ratios = {law: _over_k(evidence, law, "joint_step") for law in LQR}
    cases: Cases = {law: max(values) < 1 - NO_DIFFERENCE for law, values in ratios.items()}
    return by_cases(cases, f"Eff over K's: {_ranges(ratios)}")


@decides("lqr-worst-error-on-circle")
def _worst(evidence: Evidence) -> Judgement:
    least = min(min(evidence.by_set(law)) for law in LQR)
    cases: Cases = {law: least > (1 + NO_DIFFERENCE) * evidence.mean(law) for law in PROPORTIONAL}
    of_robust, text = evidence.of_robust(
        lambda laws, _: (least > max(map(evidence.mean, laws)), f"Err {listed(map(evidence.mean, laws))}")
    )
    ratios = {law: _over_k(evidence, law, "error") for law in LQR}
    return by_cases(
        cases | of_robust,
        f"Err over K's: {_ranges(ratios)}; the gains 50 and 31.6 give 1.58; HIR, HIRT {text}",
    )


@decides("h-infinity-lowest-error-on-circle")
def _lowest(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...], _: str) -> tuple[bool, str]:
        errors = {law: min(evidence.by_set(law)) for law in (*PROPORTIONAL, *LQR, *laws)}
        first = min(errors, key=errors.__getitem__) in laws
        rise = evidence.mean(laws[0], "", "joint_step") - evidence.mean("K", "", "joint_step")
        return first and rise <= 0.025, f"Err HIR {errors[laws[0]]:.3g}, K {errors['K']:.3g}; Eff {rise:+.3f}"

    return evidence.judged_by_robust(look)


@decides("lqr-dq-worse-tracking")
def _dq_over_r8(evidence: Evidence) -> Judgement:
    """Take the sentence apart: the integral, which grows with the duration, and the error at a time, which does not."""
    sets = evidence.ours.sets("LQR-R8")
    longer = stretch("LQR-DQ", evidence.period()) / stretch("LQR-R8", evidence.period())
    at_a_time = [evidence.ours.mean("LQR-DQ", each) / evidence.ours.mean("LQR-R8", each) for each in sets]
    integrals = [longer * ratio for ratio in at_a_time]
    cases: Cases = {
        "a higher integral": min(integrals) > 1 + NO_DIFFERENCE,
        "a worse tracking": min(at_a_time) > 1 + NO_DIFFERENCE,
    }
    return by_cases(
        cases,
        f"Err of DQ over R8 at equal times {span_of(at_a_time)}, as the same gain gives; as integrals over the printed "
        f"durations, of which DQ's is {100 * (longer - 1):.1f} % longer, {span_of(integrals)}",
    )


@decides("lqr-lower-first-peaks")
def _peaks(evidence: Evidence) -> Judgement:
    first = evidence.ours.sets("LQR-R8")[0]
    peaks = {
        law: evidence.first_peak("hand_speed", law, first if law in LQR else "")
        for law in (*PROPORTIONAL, *LQR)
    }
    highest = max(peaks[law] for law in LQR)

    def look(laws: tuple[str, ...], _: str) -> tuple[bool, str]:
        theirs = [evidence.first_peak("hand_speed", law) for law in laws]
        return highest < min(theirs), listed(theirs, ".2g")

    of_robust, text = evidence.of_robust(look)
    cases = {f"below {law}'s": highest < peaks[law] for law in PROPORTIONAL} | of_robust
    shown = ", ".join(f"{law} {peak:.2g}" for law, peak in peaks.items())
    return by_cases(cases, f"first peaks of the hand's speed, m/s: {shown}; HIR, HIRT {text}")


@decides("large-first-commands")
def _first_commands(evidence: Evidence) -> Judgement:
    def ratio(law: str) -> float:
        record = evidence.record(law, evidence.ours.sets(law)[0])
        command = np.linalg.norm(record.command, axis=1)
        first = record.time < 1.0
        return float(command[first].max() / command[~first].mean())

    ratios = {law: ratio(law) for law in (*PROPORTIONAL, *LQR)}
    of_robust, text = evidence.of_robust(
        lambda laws, _: (min(map(ratio, laws)) > 1, listed([ratio(law) for law in laws], ".2f"))
    )
    found = ", ".join(f"{law} {value:.2f}" for law, value in ratios.items())
    cases = {law: value > 1 for law, value in ratios.items()} | of_robust
    return by_cases(cases, f"first peak over later mean: {found}; HIR, HIRT {text}")


@decides("h-infinity-fast-at-low-rate")
def _low_rate(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...], _: str) -> tuple[bool, str]:
        slow = evidence.mean(laws[0], "", "hand_speed") / evidence.mean("K", "", "hand_speed")
        fast = _path_over_k(evidence, laws[0], 0.008)
        return slow > 1.1 and slow > fast, f"L.Vel of HIR over K: {slow:.3f} at 20 ms, {fast:.3f} at 8 ms"

    return evidence.judged_by_robust(look)


@decides("h-infinity-well-behaved")
def _well_behaved(evidence: Evidence) -> Judgement:
    """Judge at three periods; whether a law that does not follow behaves well, nobody can tell."""

    def look(laws: tuple[str, ...], _: str) -> tuple[bool, str]:
        paths = {period: _path_over_k(evidence, laws[0], period) for period in (0.008, 0.02, 0.025)}
        text = ", ".join(f"{1e3 * period:g} ms {path:.2f}" for period, path in paths.items())
        return max(paths.values()) < 1.1, f"path of HIR's hand over K's: {text}"

    return evidence.judged_by_robust(look)


def _path_over_k(evidence: Evidence, law: str, period: float) -> float:
    """Return the length of the hand's path on the circle over that under K, with a control period in s."""
    setting = evidence.changed("circle", ("K", law), period=period)
    return float(_path(record_of(setting, law)) / _path(record_of(setting, "K")))


def _path(record: Record) -> float:
    return float(np.linalg.norm(np.diff(record.position, axis=0), axis=1).sum())


@decides("decoupled-higher-peaks")
def _decoupled(evidence: Evidence) -> Judgement:
    """Run the decoupled law with K's gain."""
    setting = evidence.changed("circle", ("K",), laws={"K": {"kind": "decoupled-proportional"}})
    decoupled = record_of(setting, "K")
    usual = evidence.record("K")
    ratios = {
        "orientation error": _rms(decoupled.orientation_error) / _rms(usual.orientation_error),
        "velocity peak": _peak(decoupled, 1) / _peak(usual, 1),
        "acceleration peak": _peak(decoupled, 2) / _peak(usual, 2),
        "Eff": _steps(decoupled) / _steps(usual),
    }
    cases: Cases = {f"a larger {name}": ratio > 1 + NO_DIFFERENCE for name, ratio in ratios.items()}
    found = ", ".join(f"{name} {ratio:.3f}" for name, ratio in ratios.items())
    return by_cases(cases, f"decoupled over K, k = 50 1/s, circle: {found}")


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean()))


def _peak(record: Record, order: int) -> float:
    return float(np.linalg.norm(np.diff(record.position, order, axis=0), axis=1).max())


def _steps(record: Record) -> float:
    return float(np.linalg.norm(np.diff(record.q, axis=0), axis=1).sum())


def _over_k(evidence: Evidence, law: str, metric: str) -> list[float]:
    return [each / evidence.mean("K", "", metric) for each in evidence.by_set(law, metric)]


def _ranges(values: dict[str, list[float]]) -> str:
    return ", ".join(f"{law} {span_of(each)}" for law, each in values.items())


def span_of(values: list[float]) -> str:
    """Return the least and the largest number as text."""
    return f"{min(values):.3f} … {max(values):.3f}"
