"""Verdicts on what [P16] says of its robust laws (5.5)."""

from __future__ import annotations

from functools import cache

import numpy as np

from dqcontrol.experiments.attenuation import Attenuation
from dqcontrol.experiments.attenuation_cases import verify_attenuation
from dqcontrol.experiments.published.verdicts.evidence import ROBUST, Evidence, Judgement, decides, listed

SHARES = {"20 %": 0.2, "40 %": 0.4, "60 %": 0.6, "80 %": 0.8, "100 %": 1.0}


@decides("error-proportional-to-gamma")
def _proportional(evidence: Evidence) -> Judgement:
    holds, texts = True, []
    for law in ROBUST:
        products = np.array([evidence.mean(law, each) * share for each, share in SHARES.items()])
        relative = products / products[-1]
        holds = holds and bool((np.abs(relative - 1) <= 0.1).all())
        texts.append(f"{law} {listed(list(relative), '.2f')}")
    return Judgement(holds, f"Err × gain from 20 to 100 %, relative: {'; '.join(texts)}")


@decides("gain-doubled-error-halved")
def _halved(evidence: Evidence) -> Judgement:
    ratios = [evidence.mean(law, "40 %") / evidence.mean(law, "80 %") for law in ROBUST]
    holds = all(abs(ratio / 2 - 1) <= 0.05 for ratio in ratios)
    return Judgement(holds, f"Err at 40 % over 80 %: {listed(ratios)}")


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
