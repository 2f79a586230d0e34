"""Verdicts on what [P16] says of its robust laws (5.5, theorem 3.1)."""

from __future__ import annotations

from functools import cache

import numpy as np

from dqcontrol.measures import Attenuation, verify_attenuation
from dqcontrol_theses.judgement import ABOUT_THE_ROBOT, Judgement, by_cases, listed
from dqcontrol_theses.pereira2016.verdicts.evidence import Evidence, decides

SHARES = {"20 %": 0.2, "40 %": 0.4, "60 %": 0.6, "80 %": 0.8, "100 %": 1.0}
_FIRST = "20 %"  # with the least gain the arm is steadiest
_TIGHT = 0.95  # of a bound: what comes as near needs its gain


@decides("error-proportional-to-gamma")
def _proportional(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...], each: str) -> tuple[bool, str]:
        mean = evidence.ours.mean
        products = [SHARES[each] * mean(law, each) / (SHARES[_FIRST] * mean(law, _FIRST)) for law in laws]
        return all(abs(product - 1) <= 0.1 for product in products), listed(products, ".2f")

    return evidence.judged_by_robust(
        look, [each for each in SHARES if each != _FIRST], "Err × gain over that at 20 %, HIR and HIRT: "
    )


@decides("gain-doubled-error-halved")
def _halved(evidence: Evidence) -> Judgement:
    """Look at 20 over 40 % as well as at the printed 40 over 80 %, with which our arm shakes."""

    def look(laws: tuple[str, ...], each: str) -> tuple[bool, str]:
        ratios = [evidence.ours.mean(law, _HALF[each]) / evidence.ours.mean(law, each) for law in laws]
        return all(abs(ratio / 2 - 1) <= 0.05 for ratio in ratios), listed(ratios)

    return evidence.judged_by_robust(
        look, list(_HALF), "Err at half of the gain over that at 40 and 80 %, HIR and HIRT: "
    )


_HALF = {"40 %": "20 %", "80 %": "40 %"}


@cache
def attenuations() -> tuple[Attenuation, ...]:
    """Return the H∞ ratios of 120 random cases on ideal joints."""
    return tuple(verify_attenuation(120))


@decides("h-infinity-attenuates-noise")
def _attenuates(evidence: Evidence) -> Judgement:
    rows = attenuations()
    worst = [_largest(part) for part in ("orientation", "translation")]
    return Judgement(
        None,
        f"largest ratio to the bound in {len(rows)} cases, ideal joints: {listed(worst)} (orientation, position); "
        "what disturbed the robot was not measured",
        ABOUT_THE_ROBOT,
    )


@decides("minimum-control-effort")
def _minimum(evidence: Evidence) -> Judgement:
    """Ask whether the bounds are reached: one that is not would be kept with less gain, and so with less effort."""
    parts = {
        "position, root of squares": "translation",
        "position, sum": "translation_sum",
        "orientation, root of squares": "orientation",
        "orientation, sum": "orientation_sum",
    }
    worst = {name: _largest(part) for name, part in parts.items()}
    found = ", ".join(f"{name} {value:.3f}" for name, value in worst.items())
    return by_cases(
        {name: value > _TIGHT for name, value in worst.items()},
        f"largest ratio to the bound with the least gains of the theorem, {len(attenuations())} cases on ideal joints: "
        f"{found}; with the bound as printed, a sum, equal γ need 1/γ, not √2/γ",
    )


def _largest(part: str) -> float:
    return float(np.nanmax([getattr(row, part) for row in attenuations()]))
