"""Tables of repeated runs: means, differences on the same seeds, repeatability.

Their input are the rows of a study, see `dqcontrol.measures.repeats`. A run that diverged or faulted is counted
as failed, and left out of everything else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from dqcontrol.measures.metric_tables import PUBLISHED, number_column
from dqcontrol.measures.repeats import Repeats, Row
from dqcontrol.measures.statistics import LEVEL, Mean, paired_difference, spread_ratio
from dqcontrol.tables.tables import Cell, Column, PlusMinus, Table


def means_table(rows: Sequence[Row], keys: Sequence[str] = PUBLISHED, title: str = "") -> Table:
    """Return mean ± sample standard deviation over the repeats, one row a group of the same labels.

    Parameters
    ----------
    rows
        Of a study.
    keys
        Names of numbers as in `Metrics.flat`. A mean that one of its runs lacks a number for is missing.
    title
        Caption.

    Raises
    ------
    ShapeError
        If there are no rows.
    UnknownNameError
        If a key does not exist or is no number.

    Examples
    --------
    >>> rows = [{"law": "K", "seed": i, "error.integral": 1.0 + 0.1 * i} for i in range(3)]
    >>> print(means_table(rows, ["error.integral"]).markdown(), end="")
    | Law | Runs | Failed | Pose error integral [s] |
    |:----|-----:|-------:|------------------------:|
    | K   |    3 |      0 |             1.10 ± 0.10 |
    """
    return _means(Repeats(rows), keys, title, lambda mean: mean.deviation)


def confidence_table(
    rows: Sequence[Row], keys: Sequence[str] = PUBLISHED, title: str = "", *, level: float = LEVEL
) -> Table:
    """Return mean ± half of its confidence interval by Student's t, one row a group of the same labels.

    Parameters
    ----------
    rows, keys, title
        As for `means_table`.
    level
        Confidence of the intervals.

    Raises
    ------
    ShapeError, UnknownNameError
        As for `means_table`.

    Examples
    --------
    >>> rows = [{"law": "K", "seed": i, "error.integral": 1.0 + 0.1 * i} for i in range(3)]
    >>> print(confidence_table(rows, ["error.integral"]).markdown().splitlines()[-1])
    | K   |    3 |      0 |             1.10 ± 0.25 |
    """
    caption = title or f"means ± half of their {100 * level:g} % intervals"
    return _means(Repeats(rows), keys, caption, lambda mean: mean.half_width(level))


def _means(study: Repeats, keys: Sequence[str], title: str, spread: Callable[[Mean], float | None]) -> Table:
    columns = [number_column(key) for key in keys]
    body: list[list[Cell]] = []
    judged = any(row.get("failure") is not None for rows in study.groups.values() for row in rows)
    for group in study.groups:
        means = [study.mean(group, key) for key in keys]
        cells = [mean and PlusMinus(mean.mean, spread(mean)) for mean in means]
        counts: list[Cell] = [len(study.finished(group)), study.failed(group)]
        if judged:
            counts.append(sum(row.get("failure") == "" for row in study.groups[group]))
        body.append([*study.labels(group), *counts, *cells])
    heads = [Column("Runs"), Column("Failed"), *([Column("Good")] if judged else [])]
    return Table([*study.columns, *heads, *columns], body, study.caption(title))


def differences_table(
    rows: Sequence[Row],
    key: str = "error.integral",
    baseline: str | None = None,
    title: str = "",
    *,
    level: float = LEVEL,
) -> Table:
    """Return how every law differs from a baseline on the same seeds of the same robot, set and plant.

    Parameters
    ----------
    rows
        Of a study.
    key
        Name of a number as in `Metrics.flat`.
    baseline
        Label of a law; the first if omitted.
    title
        Caption.
    level
        Confidence of each interval, which ± gives half of.

    Raises
    ------
    ShapeError
        If there are no rows, or two runs of one group have the same seed.
    UnknownNameError
        If the key or the baseline does not exist.

    Examples
    --------
    >>> print(differences_table(study.rows, "position.rms", "K").markdown())  # doctest: +SKIP
    """
    column = number_column(key)
    study = Repeats(rows)
    baseline = study.baseline(baseline)
    body: list[list[Cell]] = []
    for group in study.groups:
        other = study.beside(group, baseline)
        if other == group:
            continue
        found = paired_difference(study.by_seed(group, key), study.by_seed(other, key), level)
        base = study.mean(other, key)
        relative = 100 * found.mean / abs(base.mean) if base and base.mean else math.nan
        verdict = "–" if math.isnan(found.half_width) else "yes" if found.excludes_zero else "no"
        interval = PlusMinus(found.mean, found.half_width)
        body.append([*study.labels(group), found.pairs, interval, relative, found.p_value, verdict])
    columns = [
        *study.columns,
        Column("Pairs"),
        Column(f"Law − {baseline} (± {100 * level:g} %)", column.unit),
        Column("Relative", "%", ".3g"),
        Column("p", "", ".2g"),
        Column("Excludes 0"),
    ]
    return Table(columns, body, study.caption(title or f"{column.title}: paired differences from {baseline}"))


def repeatability_table(
    rows: Sequence[Row],
    keys: Sequence[str] = PUBLISHED,
    noise: str = "",
    *,
    baseline: str | None = None,
    level: float = LEVEL,
) -> Table:
    """Return how far repeats of the same run spread, one row a number and group.

    Parameters
    ----------
    rows
        Of a study.
    keys
        Names of numbers as in `Metrics.flat`.
    noise
        What made the repeats differ, for the caption, as ``"encoder noise 0.1 mrad"``.
    baseline
        Label of a law; the first if omitted. Standard deviations are compared with its.
    level
        Confidence of the intervals of these ratios.

    Raises
    ------
    ShapeError
        If there are no rows.
    UnknownNameError
        If a key or the baseline does not exist.

    Examples
    --------
    >>> print(repeatability_table(study.rows, noise="encoder noise 0.1 mrad").latex())  # doctest: +SKIP
    """
    metrics = {key: number_column(key) for key in keys}
    study = Repeats(rows)
    baseline = study.baseline(baseline)
    body: list[list[Cell]] = []
    for key, column in metrics.items():
        for group in study.groups:
            mine, its = study.mean(group, key), study.mean(study.beside(group, baseline), key)
            cells: list[Cell] = [None] * 5
            if mine is not None:
                cells[:2] = mine.deviation, 100 * mine.variation
            if mine is not None and its is not None and study.beside(group, baseline) != group:
                ratio = spread_ratio(mine, its, level)
                cells[2:] = ratio.ratio, ratio.low, ratio.high
            body.append([column.heading, *study.labels(group), len(study.finished(group)), *cells])
    columns = [
        Column("Metric"),
        *study.columns,
        Column("Runs"),
        Column("Std. dev.", "", ".3g"),
        Column("Variation", "%", ".3g"),
        Column(f"Ratio to {baseline}", "", ".3g"),
        Column(f"{100 * level:g} % low", "", ".3g"),
        Column("high", "", ".3g"),
    ]
    caption = f"Spread of repeated runs under {noise}" if noise else "Spread of repeated runs"
    return Table(columns, body, study.caption(caption))
