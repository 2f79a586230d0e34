"""Verdicts on the claims of the published experiments, each with the number that decides it."""

from __future__ import annotations

from dqcontrol_theses.judgement import Judgement
from dqcontrol_theses.pereira2016.published_numbers import claims
from dqcontrol_theses.pereira2016.verdicts import (
    appendix_verdicts as appendices,
    circle_verdicts as circle,
    further_runs_verdicts as further_runs,
    h_infinity_verdicts as h_infinity,
    sampling_time_verdicts as sampling_time,
    spiral_verdicts as spiral,
)
from dqcontrol_theses.pereira2016.verdicts.evidence import JUDGES, Evidence

__all__ = ["Evidence", "judge"]

# importing them registers their judges
_MODULES = (appendices, circle, further_runs, h_infinity, sampling_time, spiral)


def judge(reproduction: str, evidence: Evidence) -> dict[str, Judgement]:
    """Return a judgement on every claim about one published experiment, by the claim's id."""
    return {claim.id: JUDGES[claim.id](evidence) for claim in claims(reproduction)}
