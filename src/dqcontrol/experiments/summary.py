"""The table that compares runs."""

from __future__ import annotations

from collections.abc import Mapping

from dqcontrol.experiments.metrics import Metrics
from dqcontrol.experiments.run import Run
from dqcontrol.experiments.tables import Column, Table

COLUMNS = (
    Column("run"),
    Column("error RMS", "mm", ".3g"),
    Column("error max", "mm", ".3g"),
    Column("error RMS", "°", ".3g"),
    Column("error max", "°", ".3g"),
    Column("mean |e|", "", ".3g"),
    Column("effort", "rad/√s", ".3g"),
    Column("peak |u|", "rad/s", ".3g"),
    Column("peak speed", "m/s", ".3g"),
    Column("peak acc.", "m/s²", ".3g"),
    Column("limit margin", "rad", ".3g"),
    Column("ended by"),
)


def summary(runs: Mapping[str, Run], title: str = "") -> Table:
    """Return one row a run; errors in mm and degrees are those after the start that the spec excludes."""
    return Table(COLUMNS, [_row(label, run.metrics, run.record.stopped) for label, run in runs.items()], title)


def _row(label: str, metrics: Metrics, stopped: str) -> list[str | float | int | None]:
    return [
        label,
        metrics.position.settled_rms,
        metrics.position.settled_peak,
        metrics.orientation.settled_rms,
        metrics.orientation.settled_peak,
        metrics.error.mean,
        metrics.effort,
        metrics.control.peak,
        metrics.hand_speed.peak,
        metrics.hand_acceleration.peak,
        metrics.limit_margin,
        stopped,
    ]
