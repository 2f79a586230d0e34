"""Runs side by side: their table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqcontrol.loop.record import Record
from dqcontrol.measures.metric_tables import fitting_unit
from dqcontrol.measures.metrics import evaluate
from dqcontrol.robots import Robot
from dqcontrol.tables.tables import Column, Table

if TYPE_CHECKING:
    from dqcontrol.experiments.run import Run

COMPARED = {  # keys of `Metrics.flat`; errors without the start that the spec excludes
    "position.settled_mean": Column("pos. error mean", "mm", ".3g"),
    "position.settled_rms": Column("pos. error RMS", "mm", ".3g"),
    "position.settled_peak": Column("pos. error max", "mm", ".3g"),
    "orientation.settled_rms": Column("rot. error RMS", "°", ".3g"),
    "orientation.settled_peak": Column("rot. error max", "°", ".3g"),
    "effort": Column("effort", "rad/√s or m/√s", ".3g"),
    "control.peak": Column("peak |u|", "rad/s or m/s", ".3g"),
    "hand_speed.peak": Column("peak speed", "m/s", ".3g"),
    "hand_acceleration.peak": Column("peak acc.", "m/s²", ".3g"),
    "limit_margin": Column("limit margin", "rad or m", ".3g"),
}

TOUCHED = {  # shown where an obstacle is
    "peak_contact": Column("peak contact", "N", ".3g"),
    "recovery_time": Column("recovery", "s", ".3g"),
}

DRIVEN = {"outside_range": Column("outside range of J", "", ".2g")}  # shown where a differential drive is

SATURATED = {"saturation": Column("at velocity limits", "of time", ".2g")}  # shown where some command was
VERDICT = {"verdict": Column("verdict")}

MEANS = (
    "position.settled_rms",
    "position.settled_peak",
    "orientation.settled_rms",
    "error.integral",
    "control.integral",
    "effort",
)
"""What tables of means show."""

MOST_CURVES = 12  # in one figure


def summary(runs: Mapping[str, Run | Record], title: str = "") -> Table:
    """Return one row a run or record; errors in mm and degrees are those after the start that a run's spec excludes.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), [0, 0.6, 0, 1.6, 0, 0.6, 0]
    >>> rest = dqc.references.SetPoint(arm.fkm(q), duration=0.1)
    >>> record = dqc.simulate(arm, rest, dqc.laws.Proportional(gain=4), dqc.plants.Integrator(), q, period=0.01)
    >>> print(summary({"mine": record}).csv().splitlines()[1].split(",")[0])
    mine
    """
    rows = []
    for label, run in runs.items():
        record, metrics = (run, evaluate(run)) if isinstance(run, Record) else (run.record, run.metrics)
        rows.append((label, {**metrics.flat(), "stopped": record.stopped}))
    robots = [run.robot for run in runs.values() if not isinstance(run, Record)]
    return summary_of(rows, title, unit_of_way(robots) if len(robots) == len(runs) else "rad or m")


def summary_of(
    rows: Iterable[tuple[str, Mapping[str, Any]]], title: str = "", unit: str = "rad or m"
) -> Table:
    """Return the same of labels with rows as of `Study.rows`; ``unit`` is that of what the inputs move."""
    rows = list(rows)
    columns = VERDICT | {
        key: replace(column, unit=fitting_unit(column.unit, unit)) for key, column in COMPARED.items()
    }
    for some in (TOUCHED, DRIVEN):
        if any(row.get(key) is not None for key in some for _, row in rows):
            columns |= some
    if any(row.get("saturation") for _, row in rows):
        columns |= SATURATED
    lines = [[label, *(row.get(key) for key in columns), row["stopped"]] for label, row in rows]
    return Table([Column("run"), *columns.values(), Column("ended by")], lines, title)


def unit_of_way(robots: Iterable[Robot]) -> str:
    """Return the unit of what the inputs of all robots move: ``"rad"``, ``"m"``, or ``"rad or m"`` if they differ."""
    kinds = {kind for robot in robots for kind in robot.input_types}
    return {frozenset({"revolute"}): "rad", frozenset({"prismatic"}): "m"}.get(frozenset(kinds), "rad or m")


def write_table(table: Table, folder: Path, name: str) -> None:
    """Write a table as Markdown, CSV and LaTeX."""
    for suffix in (".md", ".csv", ".tex"):
        table.write(folder / f"{name}{suffix}")
