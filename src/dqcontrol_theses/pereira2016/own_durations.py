"""Integrals of the linear quadratic laws over the durations that their runs had on the robot.

Their commands took longer than the period, and so did their runs: "their numerical performance ... was done based on
their own duration" [P16 5.7], and Table 61 prints the mean period of each law. The program multiplied commands by the
nominal period all the same, as far as the numbers tell: then the mean of each criterion over the samples stays what it
was (within 1 %, `dqcontrol reproduce pereira2016/spiral`, duration-does-not-matter), and its integral grows by the
printed period over the nominal one. No number is fitted. In physics they also run so: see `own_periods`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dqcontrol.experiments import PreparedExperiment
from dqcontrol.tables import Cell, Column, Ratio, Table
from dqcontrol_theses.pereira2016.own_periods import LateLaw, LateRun, stretch
from dqcontrol_theses.printed import PublishedCell
from dqcontrol_theses.printed_comparison import NAMES
from dqcontrol_theses.results import Results

_LATE = 1.01  # times the nominal period, from which a law is listed
_OVER_TIME = ("error", "control", "joint_step")  # the hand's path is as long however long it takes


def late_laws(
    cells: Sequence[PublishedCell], settings: Mapping[str, PreparedExperiment], specs: Mapping[str, str]
) -> list[LateLaw]:
    """Return the laws and sets of the cells that did not keep their period; ``specs`` by the experiment's name."""
    found = (
        LateLaw(specs[cell.experiment], cell.law, cell.set)
        for cell in cells
        if cell.metric in _OVER_TIME and _lateness(cell, settings) > _LATE
    )
    return list(dict.fromkeys(found))


def _lateness(cell: PublishedCell, settings: Mapping[str, PreparedExperiment]) -> float:
    return stretch(cell.law, settings[cell.experiment].spec.period)


def own_durations_table(
    cells: Sequence[PublishedCell],
    ours: Results,
    settings: Mapping[str, PreparedExperiment],
    title: str = "",
    runs: Mapping[LateLaw, LateRun] | None = None,
) -> Table | None:
    """Return the cells of laws that did not keep their period, ours over the printed duration; None without any.

    Parameters
    ----------
    cells
        The published ones.
    ours
        Our results, at the nominal period.
    settings
        The specs made ready, by the experiment's name in the published tables.
    title
        Appended to the caption.
    runs
        Of the `late_laws`, at their printed periods; None where there are none.
    """
    rows: list[list[Cell]] = []
    late = {(run.law, run.set): each.criteria for run, each in (runs or {}).items()}
    for cell in cells:
        factor = _lateness(cell, settings)
        if cell.metric in NAMES and factor > _LATE:
            mean = ours.mean(cell.law, cell.set, cell.metric, cell.experiment)
            longer = factor * mean if cell.metric in _OVER_TIME else mean
            rows.append(
                [
                    cell.law,
                    cell.set,
                    NAMES[cell.metric],
                    cell.mean,
                    mean,
                    Ratio(mean / cell.mean),
                    factor,
                    longer,
                    Ratio(longer / cell.mean),
                    *([late[cell.law, cell.set][cell.metric]] if late else []),
                    *([Ratio(late[cell.law, cell.set][cell.metric] / cell.mean)] if late else []),
                ]
            )
    if not rows:
        return None
    columns = [
        Column("Law"),
        Column("Set"),
        Column("Metric"),
        Column("Published"),
        Column("Ours"),
        Column("Ratio", "", ".3g"),
        Column("Period, printed over nominal", "", ".4g"),
        Column("Ours over that duration"),
        Column("Ratio", "", ".3g"),
        *([Column("Ours, run at that period"), Column("Ratio", "", ".3g")] if late else []),
    ]
    caption = "Over the durations of Table 61, of laws whose commands took longer than their period"
    return Table(columns, rows, " · ".join(filter(None, (caption, title))))
