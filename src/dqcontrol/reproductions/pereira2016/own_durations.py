"""What the linear quadratic laws' integrals are over the durations that their runs had on the robot.

Their commands took longer than the period, and so did their runs: "their numerical performance ... was done based on
their own duration" [P16 5.7], and Table 61 prints the mean period of each law. The program multiplied commands by the
nominal period all the same, as far as the numbers tell: then the mean of each criterion over the samples stays what it
was (within 1 %, `dqcontrol reproduce pereira2016/spiral`, duration-does-not-matter), and its integral grows by the
printed period over the nominal one. No number is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dqcontrol.experiments.prepared_experiment import PreparedExperiment
from dqcontrol.measures.table_cells import Ratio
from dqcontrol.measures.tables import Cell, Column, Table
from dqcontrol.reproductions.pereira2016.published_numbers import published_cells
from dqcontrol.reproductions.printed import PublishedCell
from dqcontrol.reproductions.printed_comparison import NAMES
from dqcontrol.reproductions.results import Results

_LATE = 1.01  # times the nominal period, from which a law is listed
_OVER_TIME = ("error", "control", "joint_step")  # the hand's path is as long however long it takes


def stretch(law: str, period: float) -> float:
    """Return the mean period that Table 61 prints of a law over the nominal one, s; 1 where it prints none.

    Examples
    --------
    >>> round(stretch("LQR-DQ", 0.02), 4), stretch("LQR-DQ", 0.025)
    (1.0587, 1.0)
    """
    label = f"{1e3 * period:g} ms"
    means = [c.mean for c in published_cells("sampling-time") if (c.law, c.set) == (law, label)]
    return means[0] / period if means else 1.0


def own_durations_table(
    cells: Sequence[PublishedCell],
    ours: Results,
    settings: Mapping[str, PreparedExperiment],
    title: str = "",
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
    """
    rows: list[list[Cell]] = []
    for cell in cells:
        factor = stretch(cell.law, settings[cell.experiment].spec.period)
        if cell.metric in _OVER_TIME and factor > _LATE:
            mean = ours.mean(cell.law, cell.set, cell.metric, cell.experiment)
            longer = factor * mean
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
    ]
    caption = "Over the durations of Table 61, of laws whose commands took longer than their period"
    return Table(columns, rows, " · ".join(filter(None, (caption, title))))
