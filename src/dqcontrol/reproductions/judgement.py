"""Verdicts on the claims of the sources, each with the number that decides it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dqcontrol.measures.table_cells import VerdictCell
from dqcontrol.measures.tables import Column, Table
from dqcontrol.reproductions.printed import Claim


@dataclass(frozen=True)
class Judgement:
    """Whether a claim holds in our numbers, and the numbers.

    Attributes
    ----------
    holds
        None if our numbers cannot decide it.
    number
        What was found.
    """

    holds: bool | None
    number: str

    @property
    def verdict(self) -> VerdictCell:
        """In words."""
        words = {True: "supported", False: "not supported", None: "cannot be decided"}
        return VerdictCell(words[self.holds], self.holds)


def verdict_table(
    claims: Sequence[Claim], judgements: Mapping[str, Judgement], source: str, title: str
) -> Table:
    """Return one row a claim: where it stands, what it says, the verdict, our number, and the source's own.

    Parameters
    ----------
    claims
        Those without a judgement are left out.
    judgements
        By the claims' ids.
    source
        Short name, as ``"P16"``.
    title
        Caption.
    """
    rows = [
        [claim.source, claim.quotation, judgements[claim.id].verdict, judgements[claim.id].number, claim.note]
        for claim in claims
        if claim.id in judgements
    ]
    columns = [
        Column(source),
        Column("Claim"),
        Column("Verdict"),
        Column("Our number"),
        Column(f"{source}'s own numbers"),
    ]
    return Table(columns, rows, title)


def listed(values: Sequence[float], form: str = ".3f") -> str:
    """Return numbers as text."""
    return ", ".join(format(value, form) for value in values)
