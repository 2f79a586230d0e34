"""Verdicts on the claims of the sources, each with the number that decides it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from dqcontrol.measures.table_cells import VerdictCell
from dqcontrol.measures.tables import Cell, Column, Table
from dqcontrol.reproductions.printed import Claim

DID_NOT_FOLLOW = "the law did not follow"
ABOUT_THE_ROBOT = "it is about the robot"
ABOUT_THE_PROGRAM = "it is about the source's program"


@dataclass(frozen=True)
class Judgement:
    """Whether a claim holds in our numbers, and the numbers.

    Attributes
    ----------
    holds
        None if our numbers cannot decide it, or decide it by what the source does not print.
    number
        What was found.
    why_not
        Of what cannot be decided: why, as `DID_NOT_FOLLOW`, `ABOUT_THE_ROBOT` or `ABOUT_THE_PROGRAM`; empty if the
        number says it.
    depends_on
        Of what holds with some values of something that the source does not print and with others not: what that is.
    """

    holds: bool | None
    number: str
    why_not: str = ""
    depends_on: str = ""

    @property
    def verdict(self) -> VerdictCell:
        """In words."""
        if self.depends_on:
            return VerdictCell(f"depends on {self.depends_on}", None)
        words = {True: "supported", False: "not supported", None: "cannot be decided"}[self.holds]
        return VerdictCell(f"{words}: {self.why_not}" if self.why_not else words, self.holds)


def verdict_table(
    claims: Sequence[Claim],
    judgements: Mapping[str, Judgement],
    source: str,
    title: str,
    ours: Mapping[str, Judgement] | None = None,
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
    ours
        Judgements on what our own law does in place of the source's, as two more columns.
    """
    rows: list[list[Cell]] = []
    for claim in claims:
        if claim.id in judgements:
            found = judgements[claim.id]
            row: list[Cell] = [_place(claim), claim.quotation, found.verdict, found.number]
            if ours is not None:
                second = ours.get(claim.id)
                row += [second.verdict, second.number] if second else ["", ""]
            rows.append([*row, claim.note])
    columns = [Column(f"Where in {source}"), Column("Claim"), Column("Verdict"), Column("Our number")]
    if ours is not None:
        columns[2:] = [
            Column(f"Verdict, {source}'s law and stop"),
            Column("Number"),
            Column("Verdict, our law and stop"),
            Column("Number"),
        ]
    return Table([*columns, Column(f"{source}'s own numbers")], rows, title)


def _place(claim: Claim) -> str:
    """Return where a claim stands; a bare number would pass for that of a table."""
    is_number = claim.source[0].isdigit()
    return f"{'Section' if '.' in claim.source else 'Chapter'} {claim.source}" if is_number else claim.source


def listed(values: Sequence[float], form: str = ".3f") -> str:
    """Return numbers as text."""
    return ", ".join(format(value, form) for value in values)
