"""Verdict on what [P16] says of its control period (5.8)."""

from __future__ import annotations

from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.pereira2016.verdicts.evidence import LAWS, Evidence, decides

PERIODS = {"8 ms": 0.008, "20 ms": 0.02}  # s


@decides("rate-is-kept")
def _kept(evidence: Evidence) -> Judgement:
    off = [
        abs(evidence.mean(law, each, "period") / period - 1)
        for law in LAWS
        for each, period in PERIODS.items()
    ]
    spread = [
        evidence.ours.deviation(law, each, "period") / period
        for law in LAWS
        for each, period in PERIODS.items()
    ]
    return Judgement(
        max(off) <= 0.01 and max(spread) <= 0.1,
        f"means within {100 * max(off):.2g} %, deviations within {100 * max(spread):.2g} % of the period",
    )
