"""Tables of metrics: one run in full, several runs side by side, repeated runs with their spread."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence

from dqcontrol.errors import ShapeError, unknown_name
from dqcontrol.experiments.metrics import Metrics
from dqcontrol.experiments.tables import Cell, Column, Table

_SIGNALS = {  # title, unit, unit of the integral; in [P16]: Err., control signal, Eff., L.Vel., L.Acc.
    "error": ("Error", "", "s"),
    "control": ("Control", "rad/s", "rad"),
    "joint_step": ("Joint step", "rad", "rad s"),
    "hand_speed": ("Hand speed", "m/s", "m"),
    "hand_acceleration": ("Hand acceleration", "m/s²", "m/s"),
}
_DEVIATIONS = {"position": ("Position error", "mm"), "orientation": ("Orientation error", "°")}
_PARTS = {
    "mean": "mean",
    "rms": "RMS",
    "peak": "peak",
    "final": "final",
    "settled_mean": "mean, settled",
    "settled_rms": "RMS, settled",
    "settled_peak": "peak, settled",
}

METRIC_COLUMNS: dict[str, Column] = {
    "duration": Column("Duration", "s"),
    "samples": Column("Samples"),
    **{
        f"{key}.{part}": Column(f"{title} {part_title}", unit)
        for key, (title, unit) in _DEVIATIONS.items()
        for part, part_title in _PARTS.items()
    },
    "final_error": Column("Error final"),
    **{
        f"{key}.{part}": Column(f"{title} {part_title}", integral_unit if part == "integral" else unit)
        for key, (title, unit, integral_unit) in _SIGNALS.items()
        for part, part_title in (("integral", "integral"), ("mean", "mean"), ("rms", "RMS"), ("peak", "peak"))
    },
    "joint_path_length": Column("Joint path length", "rad"),
    "effort": Column("Effort √∫|u|²", "rad/√s"),
    "settling_time": Column("Settling time", "s"),
    "settling_band": Column("Settling band"),
    "position_overshoot": Column("Position overshoot"),
    "orientation_overshoot": Column("Orientation overshoot"),
    "limit_margin": Column("Limit margin", "rad"),
    "limit_joint": Column("Nearest to limit"),
}
"""Heading, unit and format of every number in `Metrics.flat`."""

PUBLISHED = tuple(f"{key}.integral" for key in _SIGNALS)
"""The five integrals that [P16 5.3] tabulates."""

SHORT = (
    "error.integral",
    "position.rms",
    "position.peak",
    "orientation.rms",
    "orientation.peak",
    "control.integral",
    "control.peak",
    "joint_path_length",
    "effort",
    "settling_time",
)
"""What a comparison shows unless told otherwise."""


def summary_table(metrics: Metrics, title: str = "") -> Table:
    """Return all numbers of one run, one a row.

    Examples
    --------
    >>> print(summary_table(run.metrics).markdown())  # doctest: +SKIP
    """
    flat = metrics.flat()
    rows: list[list[Cell]] = []
    for key, column in METRIC_COLUMNS.items():
        if flat[key] not in (None, ""):
            rows.append([column.title, column.show(flat[key]), column.unit])
    return Table([Column("Metric"), Column("Value"), Column("Unit")], rows, title)


def comparison_table(runs: Mapping[str, Metrics], keys: Sequence[str] = SHORT, title: str = "") -> Table:
    """Return one row a run.

    Parameters
    ----------
    runs
        Metrics by the label of the run.
    keys
        Names as in `Metrics.flat`, as ``"error.integral"``.
    title
        Caption.

    Raises
    ------
    UnknownNameError
        If a key does not exist.

    Examples
    --------
    >>> print(comparison_table({"K": k.metrics, "LQR": lqr.metrics}).latex())  # doctest: +SKIP
    """
    columns = [_column(key) for key in keys]
    rows = [[label, *(metrics.flat()[key] for key in keys)] for label, metrics in runs.items()]
    return Table([Column("Run"), *columns], rows, title)


def repeats_table(
    groups: Mapping[str, Sequence[Metrics]], keys: Sequence[str] = SHORT, title: str = ""
) -> Table:
    """Return mean and sample standard deviation over repeated runs, one row a group.

    Parameters
    ----------
    groups
        Metrics of the repeats by the label of the group. A number that one of the repeats lacks is missing.
    keys, title
        As for `comparison_table`; only numbers.

    Raises
    ------
    UnknownNameError
        If a key does not exist or is no number.
    ShapeError
        If a group is empty.
    """
    columns = [Column("Run"), Column("Repeats")]
    for key in keys:
        column = _column(key)
        if key == "limit_joint":
            raise unknown_name("keys", key, [name for name in METRIC_COLUMNS if name != key])
        columns += [column, Column(f"± {column.title}", column.unit, ".2g")]
    rows: list[list[Cell]] = []
    for label, repeats in groups.items():
        if not repeats:
            raise ShapeError(f"groups: '{label}' has no runs")
        flats = [metrics.flat() for metrics in repeats]
        row: list[Cell] = [label, len(flats)]
        for key in keys:
            values = [float(value) for flat in flats if (value := flat[key]) is not None]
            whole = len(values) == len(flats)
            row.append(statistics.fmean(values) if whole else None)
            row.append(statistics.stdev(values) if whole and len(values) > 1 else None)
        rows.append(row)
    return Table(columns, rows, title)


def _column(key: str) -> Column:
    if key not in METRIC_COLUMNS:
        raise unknown_name("keys", key, METRIC_COLUMNS)
    return METRIC_COLUMNS[key]
