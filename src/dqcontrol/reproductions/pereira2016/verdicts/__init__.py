"""Verdicts on the claims of the published experiments, each with the number that decides it."""

from __future__ import annotations

from dqcontrol.reproductions.judgement import Judgement
from dqcontrol.reproductions.pereira2016.published_numbers import claims
from dqcontrol.reproductions.pereira2016.verdicts import (
    appendices,
    circle,
    further_runs,
    h_infinity,
    sampling_time,
    spiral,
)
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
