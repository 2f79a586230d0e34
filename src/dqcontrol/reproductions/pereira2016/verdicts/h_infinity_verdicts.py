"""Verdicts on what [P16] says of its robust laws (5.5)."""

from __future__ import annotations

from functools import cache

import numpy as np

from dqcontrol.measures.attenuation import Attenuation
from dqcontrol.measures.attenuation_cases import verify_attenuation
from dqcontrol.reproductions.judgement import Judgement, listed
from dqcontrol.reproductions.pereira2016.verdicts.evidence import ROBUST, Evidence, decides
from dqcontrol.reproductions.results import Results

SHARES = {"20 %": 0.2, "40 %": 0.4, "60 %": 0.6, "80 %": 0.8, "100 %": 1.0}


@decides("error-proportional-to-gamma")
def _proportional(evidence: Evidence) -> Judgement:
    shares = [_products(evidence.ours, law) for law in ROBUST]
    holds = all(bool((np.abs(products - 1) <= 0.1).all()) for products in shares)
    text = "; ".join(f"{law} {listed(list(p), '.2f')}" for law, p in zip(ROBUST, shares, strict=True))
    if evidence.second is not None:
        text += f"; second fit {listed(list(_products(evidence.second, 'HIR scaled')), '.2f')}"
    return Judgement(holds, f"Err × gain from 20 to 100 %, relative: {text}")


def _products(results: Results, law: str) -> np.ndarray:
    """Return error times share of the gain over that of the full gain."""
    products = np.array([results.mean(law, each) * share for each, share in SHARES.items()])
    return products / products[-1]


@decides("gain-doubled-error-halved")
def _halved(evidence: Evidence) -> Judgement:
    ratios = [evidence.mean(law, "40 %") / evidence.mean(law, "80 %") for law in ROBUST]
    holds = all(abs(ratio / 2 - 1) <= 0.05 for ratio in ratios)
    text = f"Err at 40 % over 80 %: {listed(ratios)}"
    if evidence.second is not None:
        second = [evidence.second.mean("HIR scaled", each) for each in ("40 %", "80 %")]
        text += f"; second fit {second[0] / second[1]:.3f}"
    return Judgement(holds, text)


@cache
def attenuations() -> tuple[Attenuation, ...]:
    """Return the H∞ ratios of 120 random cases on ideal joints."""
    return tuple(verify_attenuation(120))


@decides("h-infinity-attenuates-noise")
def _attenuates(evidence: Evidence) -> Judgement:
    rows = attenuations()
    worst = [np.nanmax([getattr(row, part) for row in rows]) for part in ("orientation", "translation")]
    return Judgement(
        all(row.holds for row in rows),
        f"largest ratio to the bound in {len(rows)} cases, ideal joints: {listed(worst)} (orientation, position)",
    )
