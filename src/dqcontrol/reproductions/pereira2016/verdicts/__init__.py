"""Verdicts on the claims of the published experiments, each with the number that decides it."""

from __future__ import annotations

from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.pereira2016.published_numbers import claims
from dqcontrol.reproductions.pereira2016.verdicts import appendix_verdicts as appendices
from dqcontrol.reproductions.pereira2016.verdicts import circle_verdicts as circle
from dqcontrol.reproductions.pereira2016.verdicts import further_runs_verdicts as further_runs
from dqcontrol.reproductions.pereira2016.verdicts import h_infinity_verdicts as h_infinity
from dqcontrol.reproductions.pereira2016.verdicts import sampling_time_verdicts as sampling_time
from dqcontrol.reproductions.pereira2016.verdicts import spiral_verdicts as spiral
from dqcontrol.reproductions.pereira2016.verdicts.evidence import JUDGES, Evidence

__all__ = ["Evidence", "judge"]

_MODULES = (
    appendices,
    circle,
    further_runs,
    h_infinity,
    sampling_time,
    spiral,
)  # importing them registers their judges


def judge(reproduction: str, evidence: Evidence) -> dict[str, Judgement]:
    """Return a judgement on every claim about one published experiment, by the claim's id."""
    return {claim.id: JUDGES[claim.id](evidence) for claim in claims(reproduction)}
