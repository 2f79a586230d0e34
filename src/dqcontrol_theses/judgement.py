"""Verdicts on the claims of the sources, each with the number that decides it.

One rule gives them all:

1. A sentence has cases: the laws, sets of gains, paths, robots and criteria that it names; where it names none, those
   of its experiment.
2. A case is not tested where the law did not follow its path here. It depends on what the source does not tell where it
   holds with one choice of that and fails with another.
3. Supported: all cases hold. Not supported: none holds, and one fails. Partly supported: some hold, and others do not;
   the verdict names them. Depends on: none holds or fails whatever is chosen. Cannot be decided: none was tested.
4. A difference that a sentence speaks of has to be larger than what the same law shows again: sets of weights that are
   one controller differ in nothing.
5. A cause that a sentence names holds only if the effect is missing without it.
6. What only the source's robot or its program could tell cannot be decided here, whatever our numbers are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from dqcontrol.tables import Cell, Column, Table, VerdictCell
from dqcontrol_theses.printed import Claim

DID_NOT_FOLLOW = "the law did not follow"
ABOUT_THE_ROBOT = "it is about the robot"
ABOUT_THE_PROGRAM = "it is about the source's program"

Case = bool | str | None
"""Whether a sentence holds of a case; None where that was not tested, a text where it depends on what that names."""


@dataclass(frozen=True)
class Judgement:
    """Whether a claim holds in our numbers, and the numbers.

    Attributes
    ----------
    holds
        None if our numbers cannot decide it, if it holds in part, or if what the source does not print decides it.
    number
        What was found.
    why_not
        Of what cannot be decided: why, as `DID_NOT_FOLLOW`, `ABOUT_THE_ROBOT` or `ABOUT_THE_PROGRAM`; empty if the
        number says it.
    partly
        Of what holds in part: which cases hold, and which do not.
    depends_on
        Of what holds with some values of something that the source does not print and with others not: what that is.
    """

    holds: bool | None
    number: str
    why_not: str = ""
    partly: str = ""
    depends_on: str = ""

    @property
    def verdict(self) -> VerdictCell:
        """In words."""
        if self.partly:
            return VerdictCell(f"partly supported: {self.partly}", None)
        if self.depends_on:
            return VerdictCell(f"depends on {self.depends_on}", None)
        words = {True: "supported", False: "not supported", None: "cannot be decided"}[self.holds]
        return VerdictCell(f"{words}: {self.why_not}" if self.why_not else words, self.holds)


def by_cases(cases: Mapping[str, Case], number: str) -> Judgement:
    """Return the verdict that the cases of a sentence give.

    Parameters
    ----------
    cases
        By what they are of.
    number
        What was found.

    Examples
    --------
    >>> str(by_cases({"K": True, "LQR-DQ": False, "HIR": None}, "").verdict)
    'partly supported: K; not LQR-DQ; not tested HIR, the law did not follow'
    >>> str(by_cases({"LQR-DQ": False, "HIR": None}, "").verdict)
    'not supported'
    >>> str(by_cases({"LQR-R8": "the solver"}, "").verdict)
    'depends on the solver'
    """
    named: dict[Case, list[str]] = {}
    for name, case in cases.items():
        named.setdefault(case, []).append(name)
    hold, fail, untested = (", ".join(named.pop(each, [])) for each in (True, False, None))
    if not hold and fail:
        return Judgement(False, number)
    if not hold:
        choices = " and ".join(map(str, named))
        return Judgement(None, number, "" if choices else DID_NOT_FOLLOW, depends_on=choices)
    if not fail and not untested and not named:
        return Judgement(True, number)
    parts = [hold, f"not {fail}" if fail else ""]
    parts += [
        f"{', '.join(names)} {'depends' if len(names) == 1 else 'depend'} on {choice}"
        for choice, names in named.items()
    ]
    parts += [f"not tested {untested}, {DID_NOT_FOLLOW}"] if untested else []
    return Judgement(None, number, partly="; ".join(filter(None, parts)))


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


def listed(values: Iterable[float], form: str = ".3f") -> str:
    """Return numbers as text."""
    return ", ".join(format(value, form) for value in values)
