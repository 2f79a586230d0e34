"""The rows of a study in groups of repeats, what they tell, and their tables.

A row is one run: a mapping of the labels ``robot``, ``law``, ``set`` and ``plant``, perhaps ``parameter.X`` and
``study``, of ``seed``, ``stopped`` and of all numbers of `Metrics.flat`. Runs of the same labels are repeats of each
other. A run that diverged or faulted is counted as failed, and left out of everything else.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Container, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, unknown_name
from dqcontrol.loop.record import has_failed
from dqcontrol.measures.metric_tables import PUBLISHED, number_column
from dqcontrol.tables.tables import Cell, Column, PlusMinus, Table, known

# All intervals and p values take the repeats to be independent and normally distributed; those of spreads
# depend on it most.

LEVEL = 0.95  # the usual confidence


@dataclass(frozen=True)
class Mean:
    """Mean of repeats.

    Attributes
    ----------
    count
        n, number of repeats.
    mean
        x̄.
    deviation
        Sample standard deviation s, with n − 1; NaN for one repeat.
    """

    count: int
    mean: float
    deviation: float

    @property
    def variation(self) -> float:
        """Coefficient of variation s / |x̄|, no unit; NaN for a mean of 0."""
        return self.deviation / abs(self.mean) if self.mean else math.nan

    def half_width(self, level: float = LEVEL) -> float:
        """Return t s / √n: the interval x̄ ± half_width holds the true mean with this confidence (Student 1908).

        Raises
        ------
        ValueRangeError
            If the level is not between 0 and 1.

        Examples
        --------
        >>> round(mean_of([1.0, 2.0, 3.0]).half_width(), 4)
        2.4841
        """
        _check_level(level)
        if self.count < 2:
            return math.nan
        from scipy import special  # half of Numba's import: only where it is used

        quantile = float(special.stdtrit(self.count - 1, (1 + level) / 2))
        return quantile * self.deviation / math.sqrt(self.count)


@dataclass(frozen=True)
class Difference:
    """Mean difference of two groups of runs on the same seeds.

    Attributes
    ----------
    pairs
        Number of seeds that both have.
    mean
        Mean of first − second; NaN without a pair.
    half_width
        Its confidence interval is mean ± half_width; NaN with fewer than two pairs.
    p_value
        Of the two-sided paired t test that the true mean difference is 0; 1 if all differences are 0.
    """

    pairs: int
    mean: float
    half_width: float
    p_value: float

    @property
    def excludes_zero(self) -> bool:
        """Whether 0 lies outside the interval."""
        return abs(self.mean) > self.half_width


@dataclass(frozen=True)
class SpreadRatio:
    """Ratio of the standard deviations of two groups of runs.

    Attributes
    ----------
    ratio
        First over second; NaN if one of them has fewer than two runs, or the second no spread.
    low, high
        Ends of its confidence interval.
    p_value
        Of the two-sided F test that the true ratio is 1.
    """

    ratio: float
    low: float
    high: float
    p_value: float

    @property
    def excludes_one(self) -> bool:
        """Whether 1 lies outside the interval."""
        return self.low > 1 or self.high < 1


def mean_of(values: ArrayLike) -> Mean:
    """Return mean and sample standard deviation; equal values have exactly no spread.

    Raises
    ------
    ShapeError, ValueRangeError
        If there is no value, or one is not finite.

    Examples
    --------
    >>> mean_of([1.0, 2.0, 3.0])
    Mean(count=3, mean=2.0, deviation=1.0)
    """
    numbers = as_array("values", values, (None,)).tolist()
    if not numbers:
        raise ShapeError("values: expected at least one, got none")
    deviation = statistics.stdev(numbers) if len(numbers) > 1 else math.nan
    return Mean(len(numbers), statistics.mean(numbers), deviation)


def paired_difference(
    first: Mapping[Hashable, float], second: Mapping[Hashable, float], level: float = LEVEL
) -> Difference:
    """Compare two groups of runs seed by seed: what the same noise does to both cancels.

    Parameters
    ----------
    first, second
        A number of each run by the run's seed. Seeds that only one group has are left out.
    level
        Of confidence.

    Raises
    ------
    ValueRangeError
        If a number is not finite or the level not between 0 and 1.

    Examples
    --------
    >>> found = paired_difference({1: 2.0, 2: 3.1, 3: 4.2}, {1: 1.0, 2: 2.0, 3: 3.0})
    >>> found.pairs, round(found.mean, 3), found.excludes_zero
    (3, 1.1, True)
    """
    from scipy import special

    _check_level(level)
    differences = [value - second[seed] for seed, value in first.items() if seed in second]
    if not differences:
        return Difference(0, math.nan, math.nan, math.nan)
    found = mean_of(differences)
    if found.count < 2:
        p_value = math.nan
    elif found.deviation == 0:
        p_value = 0.0 if found.mean else 1.0
    else:
        t = abs(found.mean) / (found.deviation / math.sqrt(found.count))
        p_value = 2 * float(special.stdtr(found.count - 1, -t))
    return Difference(found.count, found.mean, found.half_width(level), p_value)


def spread_ratio(first: Mean, second: Mean, level: float = LEVEL) -> SpreadRatio:
    """Compare how well two groups of runs repeat, by the F distribution of s₁²/s₂².

    Parameters
    ----------
    first, second
        Groups of independent runs.
    level
        Of confidence.

    Raises
    ------
    ValueRangeError
        If the level is not between 0 and 1.

    Examples
    --------
    >>> spread_ratio(mean_of([1.0, 5.0, 9.0]), mean_of([1.0, 2.0, 3.0])).ratio
    4.0
    """
    from scipy import special

    _check_level(level)
    if first.count < 2 or second.count < 2 or second.deviation == 0:
        return SpreadRatio(math.nan, math.nan, math.nan, math.nan)
    ratio = first.deviation / second.deviation
    freedom = first.count - 1, second.count - 1
    upper, lower = (float(special.fdtri(*freedom, (1 + sign * level) / 2)) for sign in (1, -1))
    tails = float(special.fdtr(*freedom, ratio**2)), float(special.fdtrc(*freedom, ratio**2))
    return SpreadRatio(ratio, ratio / math.sqrt(upper), ratio / math.sqrt(lower), min(1.0, 2 * min(tails)))


def _check_level(level: float) -> None:
    if not 0 < level < 1:
        raise ValueRangeError(f"level: must be between 0 and 1, got {level:g}")


Row = Mapping[str, Any]
Group = tuple[str | float, ...]  # the labels of runs that are repeats of each other

LABELS = ("study", "robot", "law", "set", "plant")
_LAW, _SET = LABELS.index("law"), LABELS.index("set")
_PARAMETER = "parameter."


class Repeats:
    """The rows of a study in groups of repeats, what they tell, and their tables.

    Parameters
    ----------
    rows
        Of a study.

    Raises
    ------
    ShapeError
        If there are none.
    """

    def __init__(self, rows: Sequence[Row]) -> None:
        if not rows:
            raise ShapeError("rows: expected at least one run, got none")
        every = dict.fromkeys(name for row in rows for name in row)
        self.parameters: list[str] = [name for name in every if name.startswith(_PARAMETER)]
        self.names: tuple[str, ...] = (*LABELS, *self.parameters)
        self.groups: dict[Group, list[Row]] = {}
        for row in rows:
            self.groups.setdefault(tuple(_known(row.get(name)) for name in self.names), []).append(row)
        self._shown = [i for i in range(len(self.names)) if len({group[i] for group in self.groups}) > 1]
        without_set = {(*group[:_SET], *group[_SET + 1 :]) for group in self.groups}
        if _SET in self._shown and len(without_set) == len(self.groups) and self.parameters:
            self._shown.remove(_SET)  # its label repeats the parameters of a grid
        self._shown = self._shown or [_LAW]

    @property
    def columns(self) -> list[Column]:
        """Headings of the labels that differ."""
        shown = [self.names[i] for i in self._shown]
        return [Column(name.capitalize() if name in LABELS else name[len(_PARAMETER) :]) for name in shown]

    def label(self, group: Group, name: str) -> str | float:
        """Return one label of a group."""
        return group[self.names.index(name)]

    def labels(self, group: Group) -> list[str | float]:
        """Return the labels of a group that differ."""
        return [group[i] for i in self._shown]

    def describe(self, group: Group, names: Container[str]) -> str:
        """Return those of the named labels that differ, as ``"K · gain 5"``."""
        texts = []
        for i in self._shown:
            if self.names[i] in names and group[i] != "":
                value = group[i] if isinstance(group[i], str) else f"{group[i]:g}"
                is_label = i < len(LABELS)
                texts.append(value if is_label else f"{self.names[i].removeprefix(_PARAMETER)} {value}")
        return " · ".join(texts)

    def caption(self, title: str) -> str:
        """Return the title, with a note if runs are left out."""
        left_out = sum(map(self.failed, self.groups))
        note = f"{left_out} failed {'run' if left_out == 1 else 'runs'} left out" if left_out else ""
        return "; ".join(filter(None, (title, note)))

    def finished(self, group: Group) -> list[Row]:
        """Return the runs of a group that did not fail."""
        return [row for row in self.groups.get(group, ()) if not _failed(row)]

    def failed(self, group: Group) -> int:
        """Return how many runs of a group diverged or faulted."""
        return sum(map(_failed, self.groups[group]))

    def values(self, group: Group, key: str) -> list[float]:
        """Return a number of all runs of a group that did not fail, empty if one of them lacks it."""
        finished = self.finished(group)
        values = [value for row in finished if (value := known(row.get(key))) is not None]
        return values if len(values) == len(finished) else []

    def mean(self, group: Group, key: str) -> Mean | None:
        """Return mean and spread of a number, or None where there are none."""
        values = self.values(group, key)
        return mean_of(values) if values else None

    def by_seed(self, group: Group, key: str) -> dict[Any, float]:
        """Return a number of each run by its seed, without those that failed or lack it."""
        values: dict[Any, float] = {}
        for row in self.finished(group):
            if row["seed"] in values:
                raise ShapeError(f"rows: two runs of law '{row['law']}' have the seed {row['seed']}")
            if (value := known(row.get(key))) is not None:
                values[row["seed"]] = value
        return values

    def baseline(self, law: str | None) -> str:
        """Return the label of the law to compare with."""
        laws = list(dict.fromkeys(str(group[_LAW]) for group in self.groups))
        if law is not None and law not in laws:
            raise unknown_name("baseline", law, laws)
        return laws[0] if law is None else law

    def beside(self, group: Group, law: str) -> Group:
        """Return the group of another law with otherwise the same labels."""
        return (*group[:_LAW], law, *group[_LAW + 1 :])


def _known(label: str | float | None) -> str | float:
    """Return a label, empty for a parameter that a run does not have."""
    label = known(label)
    return "" if label is None else label


def _failed(row: Row) -> bool:
    return has_failed(str(row.get("stopped", "")))


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
