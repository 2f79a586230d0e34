"""Printed numbers and claims of [P16], read from the files in ``pereira2016``; its README says how they were checked.

All metrics but ``period`` are integral norms ∫|·| dt over a run [P16 5.3], in the units of `Metrics` times s.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, TypeVar, get_args

import msgspec

from dqcontrol.errors import unknown_name
from dqcontrol.yaml_file import read_yaml

Reproduction = Literal[
    "lqr", "h-infinity", "circle", "spiral", "sampling-time", "circle-and-square", "lqr-surface"
]
REPRODUCTIONS: tuple[str, ...] = get_args(Reproduction)
"""Names of the published experiments; ``lqr-surface`` is printed as pictures only and has no cells."""

_FOLDER = Path(__file__).parent / "pereira2016"
_LINEAR_QUADRATIC = ("LQR-R8", "LQR-DQ")

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class PublishedCell:
    """One cell of a printed table of means.

    Attributes
    ----------
    reproduction
        One of `REPRODUCTIONS`.
    table
        Number of the table in [P16].
    experiment
        Robot and shape, where a table holds several; otherwise empty.
    law
        ``K``, ``K+FF``, ``LQR-R8``, ``LQR-DQ``, ``HIR`` or ``HIRT``.
    set
        Gain set or sampling time; empty for laws of which a table has one set only.
    metric
        ``error``, ``control`` (rad), ``joint_step`` (rad s), ``hand_speed`` (m), ``hand_acceleration`` (m/s) or
        ``period`` (s).
    mean, deviation
        As printed; deviation None where none is printed.
    """

    reproduction: str
    table: str
    experiment: str = ""
    law: str
    set: str = ""
    metric: str
    mean: float
    deviation: float | None = None


@dataclass(frozen=True, kw_only=True)
class PublishedRun:
    """One number of one run [P16 Appendix E].

    Attributes
    ----------
    table
        Number of the table; the second page of a table of fifty runs has the next one.
    reproduction, law, metric
        As in `PublishedCell`.
    set
        Gain set. Laws whose gains never change on the circle, K, K+FF, HIR and HIRT, were run again beside each
        set of the linear quadratic laws: there it names that series.
    repeat
        From 1, in the order of the table.
    value
        As printed.
    """

    table: str
    reproduction: str
    law: str
    set: str
    repeat: int
    metric: str
    value: float


@dataclass(frozen=True, kw_only=True)
class Disagreement:
    """A printed mean or deviation that the printed runs do not give.

    Attributes
    ----------
    reproduction, table, law, set, metric
        The cell, as in `PublishedCell`.
    statistic
        ``mean`` or ``deviation``.
    printed, from_runs
        The printed number and the one of the runs.
    reason
        What we think of it.
    """

    reproduction: str
    table: str
    law: str
    set: str
    metric: str
    statistic: str
    printed: float
    from_runs: float
    reason: str


class Claim(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A sentence of [P16] about its results, and what would decide it.

    Attributes
    ----------
    id
        Unique name in kebab case.
    reproduction
        The experiment that can decide it, one of `REPRODUCTIONS`.
    source
        Section or table of [P16].
    quotation
        The sentence, shortened to at most 25 words.
    measure
        Which number decides it, and the criterion.
    note
        What [P16]'s own numbers say, where they contradict the claim or cannot decide it.
    """

    id: Annotated[str, msgspec.Meta(pattern="^[a-z0-9]+(-[a-z0-9]+)*$", description="a name in kebab case")]
    reproduction: Reproduction
    source: str
    quotation: str
    measure: str
    note: str = ""


def published_cells(reproduction: str) -> list[PublishedCell]:
    """Return the cells of all tables of means of one experiment, in printed order.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.

    Examples
    --------
    >>> from dqcontrol.experiments.published import published_cells
    >>> cell = published_cells("spiral")[0]
    >>> cell.law, cell.set, cell.metric, cell.mean, cell.deviation
    ('K', 'ln2²', 'error', 2.43, 0.052)
    """
    return _of(reproduction, _read("tables.csv", PublishedCell))


def published_runs(reproduction: str) -> list[PublishedRun]:
    """Return the numbers of all single runs of one experiment; empty where [P16] prints none.

    The runs of ``lqr`` are those of ``circle`` under the two linear quadratic laws.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.
    """
    runs = _read("runs.csv", PublishedRun)
    if reproduction == "lqr":
        circles = _of("circle", runs)
        return [replace(run, reproduction="lqr") for run in circles if run.law in _LINEAR_QUADRATIC]
    return _of(reproduction, runs)


def disagreements(reproduction: str) -> list[Disagreement]:
    """Return where the printed means and deviations of one experiment are not those of its printed runs.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.
    """
    return _of(reproduction, _read("disagreements.csv", Disagreement))


def claims(reproduction: str) -> list[Claim]:
    """Return what [P16] claims about one experiment.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.
    """
    return _of(reproduction, _read_claims())


@cache
def _read(name: str, kind: type[T]) -> tuple[T, ...]:
    """Read a table of text into dataclasses; an empty field takes its default."""
    with (_FOLDER / name).open(encoding="utf-8", newline="") as file:
        rows = [{key: text for key, text in row.items() if text} for row in csv.DictReader(file)]
    return msgspec.convert(rows, tuple[kind, ...], strict=False)


@cache
def _read_claims() -> tuple[Claim, ...]:
    return read_yaml(_FOLDER / "claims.yaml", tuple[Claim, ...])


def _of(reproduction: str, entries: tuple[T, ...]) -> list[T]:
    if reproduction not in REPRODUCTIONS:
        raise unknown_name("reproduction", reproduction, REPRODUCTIONS)
    return [entry for entry in entries if getattr(entry, "reproduction") == reproduction]  # noqa: B009
