"""Verdicts on what [P16] says of its robust laws (5.5)."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from dqcontrol.measures.attenuation import Attenuation
from dqcontrol.measures.attenuation_cases import verify_attenuation
from dqcontrol.reproductions.judgement import ABOUT_THE_ROBOT, Judgement, listed
from dqcontrol.reproductions.pereira2016.verdicts.evidence import ROBUST, Evidence, decides
from dqcontrol.reproductions.results import Results

SHARES = {"20 %": 0.2, "40 %": 0.4, "60 %": 0.6, "80 %": 0.8, "100 %": 1.0}


@decides("error-proportional-to-gamma")
def _proportional(evidence: Evidence) -> Judgement:
    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        products = [_products(evidence.ours, law) for law in laws]
        holds = all(bool((np.abs(each - 1) <= 0.1).all()) for each in products)
        return holds, "; ".join(
            f"{law} {listed(list(p), '.2f')}" for law, p in zip(ROBUST, products, strict=True)
        )

    found = evidence.of_robust(look, list(SHARES))
    return replace(found, number=f"Err × gain from 20 to 100 %, relative: {found.number}")


def _products(results: Results, law: str) -> np.ndarray:
    """Return error times share of the gain over that of the least gain, with which the arm is steadiest."""
    products = np.array([results.mean(law, each) * share for each, share in SHARES.items()])
    return products / products[0]


@decides("gain-doubled-error-halved")
def _halved(evidence: Evidence) -> Judgement:
    """Look at 20 over 40 % as well, which the arm bears where it shakes at 80 %."""
    results = evidence.ours

    def look(laws: tuple[str, ...]) -> tuple[bool, str]:
        ratios = [results.mean(law, "20 %") / results.mean(law, "40 %") for law in laws]
        higher = [results.mean(law, "40 %") / results.mean(law, "80 %") for law in laws]
        holds = all(abs(ratio / 2 - 1) <= 0.05 for ratio in ratios)
        return holds, f"Err at 20 % over 40 % {listed(ratios)}, at 40 % over 80 % {listed(higher)}"

    return evidence.of_robust(look, ["20 %", "40 %"])


@cache
def attenuations() -> tuple[Attenuation, ...]:
    """Return the H∞ ratios of 120 random cases on ideal joints."""
    return tuple(verify_attenuation(120))


@decides("h-infinity-attenuates-noise")
def _attenuates(evidence: Evidence) -> Judgement:
    rows = attenuations()
    worst = [np.nanmax([getattr(row, part) for row in rows]) for part in ("orientation", "translation")]
    return Judgement(
        None,
        f"largest ratio to the bound in {len(rows)} cases, ideal joints: {listed(worst)} (orientation, position); "
        "what disturbed the robot was not measured",
        ABOUT_THE_ROBOT,
    )
