"""Verdicts on what [P16] says of its spiral (5.7): errors against gains, efforts, speeds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dqcontrol.reproductions.judgement import ABOUT_THE_ROBOT, Judgement, listed
from dqcontrol.reproductions.pereira2016.hundredfold import SUFFIX
from dqcontrol.reproductions.pereira2016.published_numbers import published_cells
from dqcontrol.reproductions.pereira2016.verdicts.evidence import (
    LAWS,
    LQR,
    PROPORTIONAL,
    ROBUST,
    Evidence,
    decides,
)
from dqcontrol.reproductions.results import Results

HUNDREDFOLD = tuple(law + SUFFIX for law in ROBUST)
SETS = ("best", "ln2", "ln2²")
METRICS = ("error", "control", "joint_step", "hand_speed", "hand_acceleration")
_STEP, _LQR_STEP = 1 / np.log(2), 1 / np.sqrt(np.log(2))


def _steps(results: Results, law: str) -> list[float]:
    """Return the error of one set over that of the next higher one."""
    return [results.mean(law, low) / results.mean(law, high) for high, low in pairwise(SETS)]


def _near(values: list[float], target: float, share: float = 0.05) -> bool:
    return bool((np.abs(np.array(values) / target - 1) <= share).all())


@decides("error-inverse-to-gain")
def _inverse(evidence: Evidence) -> Judgement:
    """Judge by the laws that followed; those that did not say nothing about the sentence."""
    steps = {law: _steps(evidence.ours, law) for law in (*PROPORTIONAL, *ROBUST, *HUNDREDFOLD)}
    left_out = [law for law in steps if not evidence.followed(law, SETS)]
    text = "; ".join(
        f"{law}{' (did not follow)' if law in left_out else ''} {listed(values)}"
        for law, values in steps.items()
    )
    kept = [values for law, values in steps.items() if law not in left_out]
    return Judgement(all(_near(values, _STEP) for values in kept), f"{text}; 1/ln2 = {_STEP:.3f}")


@decides("dq-error-inverse-to-gain")
def _dq_inverse(evidence: Evidence) -> Judgement:
    steps = _steps(evidence.ours, "LQR-DQ")
    return Judgement(_near(steps, _STEP), f"{listed(steps)}; the gain √(q/r) gives {_LQR_STEP:.3f}")


@decides("r8-not-exponential")
def _r8(evidence: Evidence) -> Judgement:
    steps, exact = (_steps(evidence.ours, law) for law in ("LQR-R8", "LQR-R8 exact"))
    return Judgement(
        not _near(steps, _LQR_STEP),
        f"{listed(steps)} with one Euler step a period; solved exactly {listed(exact)}; √(q/r) gives {_LQR_STEP:.3f}",
    )


@decides("h-infinity-best-everywhere")
def _best(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        holds, places, all_laws = True, [], (*PROPORTIONAL, *LQR, *laws)
        for each in SETS:
            for number in (evidence.ours.mean, evidence.ours.deviation):
                ranked = sorted(all_laws, key=lambda law, of=number, at=each: of(law, at))
                holds = holds and set(ranked[:2]) == set(laws)
            ranked = sorted(all_laws, key=lambda law, at=each: evidence.mean(law, at))
            places.append(f"{each} {1 + min(ranked.index(law) for law in laws)}")
        return holds, f"place of the better of HIR and HIRT by mean error {', '.join(places)}"

    return evidence.of_robust(look, SETS)


@decides("h-infinity-without-excessive-speed")
def _speed(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        ratios = [
            evidence.mean(laws[0], "best", key) / evidence.mean("K", "best", key)
            for key in ("hand_speed", "joint_step")
        ]
        return max(ratios) <= 1.1, f"L.Vel and Eff over K's {listed(ratios)}"

    return evidence.of_robust(look, ["best"])


@decides("h-infinity-lower-effort")
def _lower_effort(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        ratios = [
            evidence.mean(laws[0], each, "joint_step") / evidence.mean(law, each, "joint_step")
            for each in SETS
            for law in ("K", "LQR-R8")
        ]
        return max(ratios) < 1, f"Eff over K's and R8's {min(ratios):.3f} … {max(ratios):.3f}"

    return evidence.of_robust(look, SETS)


@decides("dq-predictable")
def _predictable(evidence: Evidence) -> Judgement:
    errors = [evidence.mean("LQR-DQ", each) for each in SETS]
    return Judgement(errors[0] < errors[1] < errors[2], f"Err from high to low q: {listed(errors)}")


@decides("dq-better-than-proportional")
def _better(evidence: Evidence) -> Judgement:
    less = [
        evidence.mean("LQR-DQ", "best", key) - evidence.mean("K", "best", key)
        for key in ("error", "joint_step", "hand_speed")
    ]
    return Judgement(less[0] < 0, f"Err {less[0]:+.3f}, Eff {less[1]:+.4f}, L.Vel {less[2]:+.3f}")


@decides("k-raises-speed-and-effort")
def _raises(evidence: Evidence) -> Judgement:
    holds, texts = True, []
    for law in PROPORTIONAL:
        error, speed, step = (
            [evidence.mean(law, each, key) for each in SETS] for key in ("error", "hand_speed", "joint_step")
        )
        holds = holds and error[0] < error[1] < error[2]
        holds = holds and speed[0] > speed[1] > speed[2] and step[0] > step[1] > step[2]
        texts.append(f"{law} L.Vel {listed(speed)}, Eff {listed(step, '.4f')}")
    return Judgement(holds, "from high to low k: " + "; ".join(texts))


@decides("proportional-less-repeatable")
def _less_repeatable(evidence: Evidence) -> Judgement:
    counts = [
        sum(
            evidence.ours.deviation(law, each, key) > evidence.ours.deviation(other, each, key)
            for each in SETS
            for key in METRICS
        )
        for law in PROPORTIONAL
        for other in (*LQR, *ROBUST)
    ]
    share = 100 * max(evidence.ours.deviation(law, "best") / evidence.mean(law, "best") for law in LAWS)
    printed = max(
        100 * (cell.deviation or 0.0) / cell.mean
        for cell in published_cells("spiral")
        if (cell.set, cell.metric) == ("best", "error")
    )
    larger = "of 15 deviations, K's and then K+FF's are larger than those of R8, DQ, HIR and HIRT in"
    return Judgement(
        None,
        f"errors repeat to {share:.2g} % or better, printed {printed:.2g} %: what varied on the robot is not in the "
        f"model; {larger} {', '.join(map(str, counts))}",
        ABOUT_THE_ROBOT,
    )


@decides("proportional-less-precise")
def _less_precise(evidence: Evidence) -> Judgement:
    others = [
        (law, each)
        for each in SETS
        for law in (*LQR, *ROBUST, *HUNDREDFOLD)
        if evidence.followed(law, [each])
    ]
    ratios = {where: evidence.mean("K", where[1]) / evidence.mean(*where) for where in others}
    worst = min(ratios, key=ratios.__getitem__)
    least, most = ratios[worst], max(ratios.values())
    return Judgement(
        least > 1, f"Err of K over those that followed: {least:.3f} ({' '.join(worst)}) … {most:.3f}"
    )


@decides("lqr-lower-hand-speed")
def _lqr_speed(evidence: Evidence) -> Judgement:
    ratios = [
        evidence.mean(law, each, "hand_speed") / evidence.mean("K", each, "hand_speed")
        for each in SETS
        for law in LQR
    ]
    return Judgement(max(ratios) < 1, f"L.Vel over K's: {min(ratios):.3f} … {max(ratios):.3f}")


@decides("feedforward-changes-nothing")
def _feedforward(evidence: Evidence) -> Judgement:
    return _no_change(evidence, "K+FF", "K")


@decides("tracking-term-changes-nothing")
def _tracking(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        found = _no_change(evidence, laws[1], laws[0])
        return bool(found.holds), found.number

    return evidence.of_robust(look, SETS)


def _no_change(evidence: Evidence, law: str, other: str) -> Judgement:
    ratios = [evidence.mean(law, each) / evidence.mean(other, each) for each in SETS]
    return Judgement(_near(ratios, 1.0, 0.01), f"Err of {law} over {other}: {listed(ratios, '.4f')}")
