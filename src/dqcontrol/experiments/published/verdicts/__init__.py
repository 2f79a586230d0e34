"""Verdicts on the claims of the published experiments, each with the number that decides it."""

from __future__ import annotations

from dqcontrol.experiments.published.published_numbers import claims
from dqcontrol.experiments.published.verdicts import (
    appendices,
    circle,
    further_runs,
    h_infinity,
    sampling_time,
    spiral,
)
from dqcontrol.experiments.published.verdicts.evidence import JUDGES, Evidence, Judgement
from dqcontrol.experiments.tables import Column, Table

__all__ = ["Evidence", "Judgement", "judge", "verdict_table"]

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


def verdict_table(reproduction: str, judgements: dict[str, Judgement], plant: str = "") -> Table:
    """Return one row a claim: where it stands, what it says, the verdict, our number, and the source's own.

    A plant is named in the caption.
    """
    rows = [
        [claim.source, claim.quotation, judgements[claim.id].verdict, judgements[claim.id].number, claim.note]
        for claim in claims(reproduction)
        if claim.id in judgements
    ]
    columns = [
        Column("P16"),
        Column("Claim"),
        Column("Verdict"),
        Column("Our number"),
        Column("P16's own numbers"),
    ]
    return Table(columns, rows, " · ".join(filter(None, (f"Claims of P16: {reproduction}", plant))))
