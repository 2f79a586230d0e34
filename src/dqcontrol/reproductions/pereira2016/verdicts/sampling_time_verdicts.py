"""Verdict on what [P16] says of its control period (5.8)."""

from __future__ import annotations

from dqcontrol.experiments.sampling_time import BARE
from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.pereira2016.verdicts.evidence import LAWS, Evidence, decides

PERIODS = {"8 ms": 0.008, "20 ms": 0.02}  # s
_OFF, _SPREAD = 0.01, 0.1  # of the period: means and deviations within them are kept


@decides("rate-is-kept")
def _kept(evidence: Evidence) -> Judgement:
    """Judge ours by what a bare loop does: a machine that cannot keep the period says nothing about a controller."""
    ours, bare = _worst(evidence, LAWS), _worst(evidence, (BARE,))
    kept, possible = (off <= _OFF and spread <= _SPREAD for off, spread in (ours, bare))
    text = "; ".join(
        f"{name}: means within {100 * off:.2g} %, deviations within {100 * spread:.2g} % of the period"
        for name, (off, spread) in (("ours", ours), ("a bare loop on this machine", bare))
    )
    if kept or possible:
        return Judgement(kept, text)
    return Judgement(None, text, "this machine does not keep it either")


def _worst(evidence: Evidence, laws: tuple[str, ...]) -> tuple[float, float]:
    """Return by how much the mean is off at worst, and the largest deviation, as shares of the period."""
    cases = [(law, each, period) for law in laws for each, period in PERIODS.items()]
    off = max(abs(evidence.mean(law, each, "period") / period - 1) for law, each, period in cases)
    spread = max(evidence.ours.deviation(law, each, "period") / period for law, each, period in cases)
    return off, spread
