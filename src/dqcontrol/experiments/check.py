"""What is to be expected of a spec's loops, said before anything moves."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dqcontrol.errors import StabilityWarning
from dqcontrol.experiments.prepared_experiment import Names, Setting, prepare
from dqcontrol.measures.stability import (
    MOST_STATES,
    GainLimits,
    LoopGain,
    Verdict,
    gain_limits,
    spectral_radius,
    with_integral,
    with_lag,
)
from dqcontrol.measures.table_cells import Verdict as Words
from dqcontrol.measures.tables import Column, Table
from dqcontrol.plants.linear_model import LinearModel

Known = dict[tuple[complex, float, float], GainLimits]  # by direction, integral share and lag of the gain

_WORST_FIRST: tuple[Verdict, ...] = ("unstable", "oscillatory", "drifts", "monotone")


@dataclass(frozen=True)
class Loop:
    """One loop of a law, closed by a plant.

    Attributes
    ----------
    gain
        Of the law.
    limits
        Of the plant.
    model
        Of the plant.
    period
        T, s.
    """

    gain: LoopGain
    limits: GainLimits
    model: LinearModel
    period: float

    @property
    def product(self) -> float:
        """|k| T."""
        return abs(self.gain.value) * self.period

    @property
    def margin(self) -> float:
        """By how much the gain could be multiplied."""
        return self.limits.stable / self.product if self.product else math.inf

    @property
    def verdict(self) -> Verdict:
        """What becomes of small errors."""
        return self.limits.verdict(self.product)

    @property
    def radius(self) -> float:
        """Factor by which the loop's errors shrink a period, in the long run."""
        return spectral_radius(self.model.poles(self.gain.value))


@dataclass(frozen=True)
class LoopCheck:
    """What is to be expected of one law on one plant, for small errors about a target at rest.

    Attributes
    ----------
    names
        Of robot, law, parameter set and plant.
    period
        T, s.
    loops
        Of position, orientation and null space, as far as the law has them.
    unknown
        Why nothing is known; empty if something is.
    """

    names: Names
    period: float
    loops: tuple[Loop, ...]
    unknown: str = ""

    def __repr__(self) -> str:
        return f"LoopCheck({self.names.label!r}, {self.verdict})"

    @property
    def worst(self) -> Loop:
        """The loop nearest to its limit."""
        return min(self.loops, key=lambda loop: loop.margin)

    @property
    def verdict(self) -> Verdict:
        """What becomes of small errors in the worst of the loops."""
        if self.unknown:
            return "cannot be decided"
        verdicts = {loop.verdict for loop in self.loops}
        return next(verdict for verdict in _WORST_FIRST if verdict in verdicts)

    @property
    def time_constant(self) -> float:
        """Seconds in which the slowest loop's errors shrink to 1/e; infinite if they do not."""
        slowest = max(loop.radius for loop in self.loops)
        if slowest >= 1:
            return math.inf
        return -self.period / math.log(slowest) if slowest > 0 else 0.0

    @property
    def remark(self) -> str:
        """What to do about it, in one line; empty if nothing need be done."""
        if self.unknown:
            return f"{self.names.label}: cannot be decided: {self.unknown}"
        if self.verdict == "drifts":
            return f"{self.names.label}: drifts: nothing corrects its errors"
        loop = self.worst
        limits, when = loop.limits, f" at {loop.gain.time:g} s" if loop.gain.time is not None else ""
        if loop.verdict == "monotone" or loop.product <= limits.recommended:
            return ""
        if loop.gain.lag * self.period >= 2:
            return f"{self.names.label}: unstable: k_v T = {loop.gain.lag * self.period:.3g}, limit 2"
        if limits.stable == 0:
            return f"{self.names.label}: {loop.gain.loop} unstable: so is the plant, with any gain"
        facts = f"k T = {loop.product:.3g}{when}, limit {limits.stable:.3g}"
        if loop.verdict == "oscillatory":
            facts += f", spectral radius {loop.radius:.3g}"
        advice = f"choose k ≤ {limits.recommended / self.period:.3g} 1/s"
        if loop.gain.lag and loop.gain.loop != "null space":
            advice = f"choose k̄ ≤ {4 * loop.gain.lag * limits.recommended / self.period:.3g} 1/s²"
        if loop.gain.integral_share:
            half = abs(loop.gain.value) ** 2 / 2
            advice = (
                f"{advice} and k_I ∝ k²" if limits.recommended else f"choose k_I ≤ k²/2 = {half:.3g} 1/s²"
            )
        return f"{self.names.label}: {loop.gain.loop} {loop.verdict}: {facts}; {advice}"


@dataclass(frozen=True)
class Checks(Sequence[LoopCheck]):
    """The checks of a spec, one a law, parameter set and plant."""

    name: str
    rows: tuple[LoopCheck, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, i: Any) -> Any:
        return self.rows[i]

    def __repr__(self) -> str:
        counts = Counter(row.verdict for row in self.rows)
        return (
            f"Checks({self.name!r}, {', '.join(f'{count} {verdict}' for verdict, count in counts.items())})"
        )

    def __str__(self) -> str:
        """Return the table, and what to do."""
        return "\n".join([str(self.table()), *self.remarks()])

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: the same."""
        return "\n".join([self.table().markdown(), *(f"* {remark}" for remark in self.remarks())])

    @property
    def unstable(self) -> bool:
        """Whether one of them is expected to be unstable."""
        return any(row.verdict == "unstable" for row in self.rows)

    def remarks(self) -> Iterator[str]:
        """Give what to do about each that asks for it, in one line."""
        return (row.remark for row in self.rows if row.remark)

    def table(self) -> Table:
        """Return one row a law, parameter set and plant: gains at their largest, limits of the worst of its loops."""
        places = [field for field in Names._fields if any(getattr(row.names, field) for row in self.rows)]
        columns = [
            *map(Column, places),
            Column("k position", "1/s", ".3g"),
            Column("k orientation", "1/s", ".3g"),
            Column("T", "ms", ".4g"),
            Column("k T", "", ".3g"),
            Column("limit", "", ".3g"),
            Column("margin", "", ".3g"),
            Column("choose k ≤", "1/s", ".3g"),
            Column("time constant", "s", ".3g"),
            Column("verdict"),
        ]
        return Table(columns, [_cells(row, places) for row in self.rows], self.name)


def _cells(row: LoopCheck, places: list[str]) -> list[str | float | None]:
    gains = {loop.gain.loop: abs(loop.gain.value) for loop in row.loops}
    numbers: list[float | None] = [None] * 5
    if row.loops:
        worst, limits = row.worst, row.worst.limits
        advised = limits.recommended / row.period
        numbers = [worst.product, limits.stable, worst.margin, advised, row.time_constant]
    return [
        *(getattr(row.names, place) for place in places),
        gains.get("position"),
        gains.get("orientation"),
        1e3 * row.period,
        *(number if number is not None and math.isfinite(number) else None for number in numbers),
        judged(row),
    ]


def judged(row: LoopCheck) -> Words:
    """Return the verdict as a cell of a table."""
    return Words(row.verdict, {"monotone": True, "unstable": False}.get(row.verdict))


def check(source: str | Path | dict[str, Any]) -> Checks:
    """Check a spec as `run` does before anything moves, and say what is to be expected of its loops.

    Each loop of a law (position, orientation, posture in the null space) is judged as a scalar one: its gain k is
    known from the law's parameters, the largest over time; the plant from commands to measured positions is linear,
    with its delay, in steps of a period. The verdict holds for small errors about a target at rest.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary; see `dqcontrol.experiments.Spec`.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> checks = dqc.experiments.check({
    ...     "name": "fast", "robot": "iiwa7", "start": [0, 0.6, 0, 1.6, 0, 0.6, 0], "period": 0.02,
    ...     "reference": {"kind": "set-point", "duration": 1},
    ...     "law": {"kind": "proportional", "gain": 60}, "plant": {"kind": "servo", "delay": 0.02},
    ... })
    >>> [row.verdict for row in checks]
    ['unstable']
    >>> print(*checks.remarks())
    proportional · servo: position unstable: k T = 1.2, limit 1; choose k ≤ 7.2 1/s
    """
    setting = prepare(source)
    return Checks(setting.spec.name, tuple(loop_checks(setting)))


def warn_unstable(setting: Setting, *, stacklevel: int) -> list[LoopCheck]:
    """Return what is to be expected of a prepared spec's loops; warn, once, where some are unstable."""
    checks = list(loop_checks(setting))
    unstable = [row for row in checks if row.verdict == "unstable"]
    if unstable:
        more = f" (and {len(unstable) - 1} more: dqcontrol check lists them)" if len(unstable) > 1 else ""
        warnings.warn(unstable[0].remark + more, StabilityWarning, stacklevel=stacklevel + 1)
    return checks


def loop_checks(setting: Setting) -> Iterator[LoopCheck]:
    """Give what is to be expected of each combination of a prepared spec."""
    period = setting.spec.period
    plants: dict[tuple[str, str], tuple[LinearModel | None, Known]] = {}
    for case in setting.cases:
        place = case.names.robot, case.names.plant
        if place not in plants:
            plants[place] = case.plant.linear_model(case.scene.robot, case.scene.start, period), {}
        model, limits = plants[place]
        if case.gains is None:
            yield LoopCheck(case.names, period, (), "the law's loop gains are unknown")
        elif model is None:
            yield LoopCheck(case.names, period, (), "the plant has no linear model")
        elif len(model.transition) > MOST_STATES:
            many = f"the plant's model has {len(model.transition)} states; {MOST_STATES} at most are judged"
            yield LoopCheck(case.names, period, (), many)
        else:
            yield LoopCheck(
                case.names, period, tuple(_loop(gain, model, period, limits) for gain in case.gains)
            )


def _loop(gain: LoopGain, model: LinearModel, period: float, known: Known) -> Loop:
    """Return a loop with the limits of its gain's direction, integral and lag, which are found once for each."""
    way = gain.value / abs(gain.value) if gain.value.imag else 1.0
    share, model = gain.integral_share, with_lag(model, gain.lag, period)
    kind = way, share, gain.lag
    if kind not in known:
        known[kind] = gain_limits(model, period, way, share)
    return Loop(gain, known[kind], with_integral(model, share * abs(gain.value), period), period)
