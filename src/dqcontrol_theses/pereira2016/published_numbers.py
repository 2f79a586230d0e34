"""Printed numbers and claims of [P16], read from the files beside this one; their README says how they were checked.

All metrics but ``period`` are integral norms ∫|·| dt over a run [P16 5.3], in the units of `Metrics` times s.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, TypeVar

from dqcontrol.errors import unknown_name
from dqcontrol_theses.printed import Claim, PublishedCell, read_claims, read_table

REPRODUCTIONS = ("lqr", "h-infinity", "circle", "spiral", "sampling-time", "circle-and-square", "lqr-surface")
"""Names of the published experiments; ``lqr-surface`` is printed as pictures only and has no cells."""

FIXED = "fixed"
"""Of specs, the set of laws that have one only; printed cells name none."""

_FOLDER = Path(__file__).parent
_LINEAR_QUADRATIC = ("LQR-R8", "LQR-DQ")


class _Printed(Protocol):
    """Something that is printed of an experiment."""

    @property
    def reproduction(self) -> str: ...


T = TypeVar("T", bound=_Printed)


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


def published_cells(reproduction: str) -> list[PublishedCell]:
    """Return the cells of all tables of means of one experiment, in printed order.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.

    Examples
    --------
    >>> from dqcontrol_theses.pereira2016 import published_cells
    >>> cell = published_cells("spiral")[0]
    >>> cell.law, cell.set, cell.metric, cell.mean, cell.deviation
    ('K', 'ln2²', 'error', 2.43, 0.052)
    """
    return _of(reproduction, read_table(_FOLDER / "tables.csv", PublishedCell))


def published_mean(
    reproduction: str, law: str, label: str, metric: str = "error", experiment: str = ""
) -> float:
    """Return a printed mean of a law with one of its sets.

    Raises
    ------
    LookupError
        If none is printed.
    """
    wanted = (law, "" if label == FIXED else label, metric, experiment)
    for cell in published_cells(reproduction):
        if (cell.law, cell.set, cell.metric, cell.experiment) == wanted:
            return cell.mean
    raise LookupError(f"{reproduction}: {wanted}")


def published_runs(reproduction: str) -> list[PublishedRun]:
    """Return the numbers of all single runs of one experiment; empty where [P16] prints none.

    The runs of ``lqr`` are those of ``circle`` under the two linear quadratic laws.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.
    """
    runs = read_table(_FOLDER / "runs.csv", PublishedRun)
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
    return _of(reproduction, read_table(_FOLDER / "disagreements.csv", Disagreement))


def claims(reproduction: str) -> list[Claim]:
    """Return what [P16] claims about one experiment.

    Raises
    ------
    UnknownNameError
        If there is no such experiment.
    """
    return _of(reproduction, read_claims(_FOLDER / "claims.yaml"))


def _of(reproduction: str, entries: tuple[T, ...]) -> list[T]:
    if reproduction not in REPRODUCTIONS:
        raise unknown_name("reproduction", reproduction, REPRODUCTIONS)
    return [entry for entry in entries if entry.reproduction == reproduction]
