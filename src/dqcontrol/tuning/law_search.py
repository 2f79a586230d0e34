"""The search for one law's best parameters: its free parameters, and a task that runs anywhere and can be resumed."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from dqcontrol.errors import ShapeError, ValueRangeError, error_prefix, unknown_name
from dqcontrol.experiments.prepared_experiment import check_program
from dqcontrol.experiments.results_folder import Row, parquet, read_rows, write_whole
from dqcontrol.files.output_file import finite_or_none
from dqcontrol.laws import Law
from dqcontrol.measures.metric_tables import LARGE_IS_GOOD, NUMBERS
from dqcontrol.named_fields import check_fields
from dqcontrol.tuning import spec_blocks
from dqcontrol.tuning.law_evaluation import (
    Evaluated,
    LawEvaluation,
    held_out_scenes,
    held_out_seeds,
    searched_scenes,
)
from dqcontrol.tuning.searches import Point, SimplexSearch, nondominated, search_front

LOOP_GAIN, INTEGRAL_SHARE = "loop_gain", "integral_share"
_SLOWEST = 50.0  # times the gain at the side where the margin ends
_SHARES = spec_blocks.SearchRange(low=2e-3, high=0.25)
_INTEGRAL = "integral_gain"
_MARGIN_TOLERANCE = 1e-3  # relative error of a margin that is asked for
# with these alone a margin goes exactly with one over the gain: not with lags of a law's own, nor over a horizon
_SCALING = {"gain", "integral_gain"} | {
    f"{part}_{kind}" for part in ("orientation", "translation") for kind in ("gain", "gamma")
}
_MOST_STEPS = 4  # rescalings; they end by themselves within `_MARGIN_TOLERANCE`

Judge = Callable[[Law], spec_blocks.Slack]


class SearchSpace:
    """The free parameters of one law.

    A free loop gain without a range goes from the 50th part of the gain at which the margin ends up to that gain,
    whatever the other parameters are: the hard constraint is a side of the cube, and no point is lost to it.

    Parameters
    ----------
    label
        Of the law, for messages.
    law
        As the spec has it; what is not free stays so.
    ranges
        By name what is free; None for the defaults.
    judge
        Returns the gain and slack of a law.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the law has no such parameter, or it cannot be stable.
    """

    def __init__(
        self, label: str, law: Law, ranges: Mapping[str, spec_blocks.SearchRange] | None, judge: Judge
    ) -> None:
        self.label = label
        self.law = law
        self._judge = judge
        self._known: dict[str, spec_blocks.Slack] = {}
        self.ranges: dict[str, spec_blocks.SearchRange | None] = dict(ranges) if ranges else self._defaults()
        for key in self.ranges:
            self._check_key(key)
        if LOOP_GAIN in self.ranges and (taken := set(law.gain_powers) & set(self.ranges)) == {"gain"}:
            raise ShapeError(f"{self._field('gain')}: {taken.pop()} and loop_gain are one; leave one out")
        self._check_stable()

    def _field(self, key: str) -> str:
        return f"tune.free.{self.label}.{key}"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters, in the order of coordinates."""
        return tuple(self.ranges)

    def _defaults(self) -> dict[str, spec_blocks.SearchRange | None]:
        if not self.law.gain_powers:
            raise ShapeError(
                f"tune.free.{self.label}: the law's loop gain is unknown; say which of its keys are free"
            )
        found: dict[str, spec_blocks.SearchRange | None] = {LOOP_GAIN: None}
        if getattr(self.law, _INTEGRAL, 0.0):
            found[INTEGRAL_SHARE] = _SHARES
        return found

    def _check_key(self, key: str) -> None:
        if key in (LOOP_GAIN, INTEGRAL_SHARE):
            needed = self.law.gain_powers if key == LOOP_GAIN else _INTEGRAL in self.law.gain_powers
            if not needed:
                raise ShapeError(f"{self._field(key)}: {type(self.law).__struct_config__.tag} has none")
            return
        inner: Any = self.law
        *path, last = key.split(".")
        for name in path:
            inner = getattr(inner, name) if name in _fields(inner) else None
        if last not in _fields(inner):
            known = [LOOP_GAIN, *([INTEGRAL_SHARE] if _INTEGRAL in self.law.gain_powers else [])]
            raise unknown_name(f"tune.free.{self.label}", key, [*known, *_fields(self.law)])
        if not isinstance(getattr(inner, last), int | float | None):
            raise ShapeError(f"{self._field(key)}: is no single number in this law; give it as one")
        span = self.ranges[key]
        for end in () if span is None else (span.low, span.high):
            with error_prefix(f"tune.free.{self.label}"):
                check_fields(type(inner), {last: end})

    def _check_stable(self) -> None:
        """Raise if no gain of the range is stable enough."""
        size = len(self.ranges)
        corners = [np.zeros(size), *(np.eye(size)), np.ones(size), np.full(size, 0.5)]
        if any(self.slack(self.law_at(corner)).share >= 1 - _MARGIN_TOLERANCE for corner in corners):
            return
        slowest = self.slack(self.law_at(corners[0]))
        if slowest.of_null_space < 1 - _MARGIN_TOLERANCE:
            raise ValueRangeError(
                f"null_space.gain: too high for any law: margin and damping as asked allow "
                f"{slowest.of_null_space:.3g} times as much"
            )
        given = [(key, span) for key, span in self.ranges.items() if span is not None]
        spans = " and ".join(f"{key} in {span.low:g} … {span.high:g}" for key, span in given)
        product = slowest.product
        ends = f"; it ends at kT = {slowest.share * product:.3g}, and the slowest law has {product:.3g}"
        raise ValueRangeError(
            f"tune.free.{self.label}: no law with {spans or 'any loop_gain'} keeps margin and damping as "
            f"asked{ends if product else ''}"
        )

    def slack(self, law: Law) -> spec_blocks.Slack:
        """Return gain and slack of a law, found once."""
        key = repr(law)
        if key not in self._known:
            self._known[key] = self._judge(law)
        return self._known[key]

    def law_at(self, shares: Sequence[float] | np.ndarray) -> Law:
        """Return the law at a point of the unit cube."""
        law, at = self.law, dict(zip(self.ranges, map(float, shares), strict=True))
        for key, span in self.ranges.items():
            if key not in (LOOP_GAIN, INTEGRAL_SHARE) and span is not None:
                law = _with_value(law, key.split("."), span.at(at[key]))
        share = self.ranges.get(INTEGRAL_SHARE)
        if share is not None:
            gain = self._gain(law)
            law = replace(law, **{_INTEGRAL: share.at(at[INTEGRAL_SHARE]) * gain * gain})
        if LOOP_GAIN not in self.ranges:
            return law
        span = self.ranges[LOOP_GAIN]
        if span is not None:
            return law.scaled(span.at(at[LOOP_GAIN]) / (self.slack(law).product or 1.0))
        return self._at_slack(law, _SLOWEST ** (1 - at[LOOP_GAIN]))

    def _gain(self, law: Law) -> float:
        """Return the gain of which the integral is a share, 1/s."""
        gain = getattr(law, "gain", None)
        if not isinstance(gain, int | float):
            raise ShapeError(f"{self._field(INTEGRAL_SHARE)}: needs a law whose gain is one number")
        return float(gain)

    def _at_slack(self, law: Law, wanted: float) -> Law:
        """Return a law scaled so that its margin is so many times what is asked for."""
        found, scaled, factor = self.slack(law).share, law, 1.0
        if not 0 < found < math.inf:
            return law
        for _ in range(_MOST_STEPS):
            factor *= found / wanted
            scaled = law.scaled(factor)
            if set(law.gain_powers) <= _SCALING:
                break
            found = self.slack(scaled).share
            if not 0 < found < math.inf or abs(found / wanted - 1) < _MARGIN_TOLERANCE:
                break
        return scaled

    def parameters(self, law: Law) -> dict[str, Any]:
        """Return those of its keys that differ from the spec's law."""
        before, after = msgspec.to_builtins(self.law), msgspec.to_builtins(law)
        changed = {key for key, value in after.items() if value != before.get(key)} - {"kind"}
        searched = set(self.law.gain_powers) & set(before) | {key.partition(".")[0] for key in self.ranges}
        return {key: value for key, value in after.items() if key in changed or (key in searched and value)}


def _fields(part: Any) -> tuple[str, ...]:
    return getattr(type(part), "__struct_fields__", ())


def _with_value(part: Any, path: Sequence[str], value: float) -> Any:
    if len(path) == 1:
        return replace(part, **{path[0]: value})
    return replace(part, **{path[0]: _with_value(getattr(part, path[0]), path[1:], value)})


_EVERY = 2.0  # s between writings of what was evaluated
_GRID_TOLERANCE = 1e-3  # of a margin or range: limits are found on a grid
_MORE = 0.02  # of a gain: less is no room
_FASTER = 4  # higher gains that are tried beside the best damped one


@dataclass(frozen=True)
class LawTask:
    """The search for one law, to be run anywhere.

    Attributes
    ----------
    problem
        What is searched for.
    label
        Of the law.
    part
        Its number.
    program
        Versions that it must run with.
    file
        Where what was evaluated is kept while it runs, on this machine, and beside it what was found; None: nowhere.
    """

    problem: spec_blocks.TuneProblem
    label: str
    part: int
    program: str
    file: Path | None = None

    def run(self) -> tuple[int, LawResult]:
        """Return its number and what was found.

        Raises
        ------
        Error
            If another version of dqcontrol, or of the libraries that trials depend on, is installed here.
        """
        check_program(self.program)
        found = self.file.with_suffix(".found") if self.file else None
        if found and found.exists():
            return self.part, msgspec.msgpack.decode(found.read_bytes(), type=LawResult)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # hundreds of laws; what is chosen is checked
            result = LawSearch(self.problem, self.label, self.file).run()
        if found:
            write_whole(found, msgspec.msgpack.encode(result))
        return self.part, result


class LawResult(msgspec.Struct, frozen=True):
    """What was found for one law; plain numbers, as it comes from other processes.

    Attributes
    ----------
    label, law
        Its label, and its best parameters with their kind.
    parameters
        Those of them that were searched for.
    searched, held_out
        All numbers on what was searched on, and on what was not.
    total, held_out_total
        Weighted sums of the objectives; infinite where a run failed.
    violation, held_out_violation
        By how much constraints are violated.
    evaluations
        How many parameter sets were run or refused.
    at_side
        Free parameters that are at an end of their range.
    front
        Laws' parameters and both objectives of the best compromises, if they are wanted.
    rows
        All that was evaluated.
    faster
        The same law with a higher gain, where a smaller total costs damping that is asked for.
    seconds
        That it took, resumed parts not counted; of these, in runs.
    """

    label: str
    law: dict[str, Any]
    parameters: dict[str, Any]
    searched: dict[str, float]
    held_out: dict[str, float]
    total: float
    held_out_total: float
    violation: float
    held_out_violation: float
    evaluations: int = 0
    at_side: list[str] = []
    front: list[tuple[dict[str, Any], float, float]] = []
    rows: list[dict[str, Any]] = []
    seconds: tuple[float, float] = (0.0, 0.0)
    faster: LawResult | None = None


class LawSearch:
    """Evaluates points of a law's search space, and remembers all of them.

    Parameters
    ----------
    problem
        What is searched for.
    label
        Of the law.
    file
        Where what was evaluated is kept; what it holds is not repeated.
    """

    def __init__(self, problem: spec_blocks.TuneProblem, label: str, file: Path | None = None) -> None:
        self._problem, self._file = problem, file
        self.label = label
        ready = ready_problem(problem)
        self.law: Law = next(each.law for each in problem.spec.variants if each.label == label)
        self._evaluate, self._held_out = ready.searched, ready.held_out
        with error_prefix(problem.where):
            ranges = problem.block.free.get(label)
            self.space: SearchSpace = SearchSpace(label, self.law, ranges, self._evaluate.slack)
        self._known: dict[Point, Evaluated] = {}
        self._written, self._running = time.monotonic(), 0.0
        if file is not None and file.exists():
            self._take_over(read_rows(file))

    def _take_over(self, rows: list[Row]) -> None:
        for row in rows:
            point = tuple(float(str(row[f"share.{name}"])) for name in self.space.names)
            values = [math.nan if row[name] is None else float(str(row[name])) for name in NUMBERS]
            total = math.inf if row["total"] is None else float(str(row["total"]))
            self._known[point] = Evaluated(total, float(str(row["violation"])), np.array(values))

    def evaluate(self, point: Point) -> Evaluated:
        """Return what a point is worth; each runs once."""
        if point not in self._known:
            self._known[point] = self._evaluated(point)
            if time.monotonic() - self._written > _EVERY:
                self._write()
        return self._known[point]

    def _evaluated(self, point: Point) -> Evaluated:
        begun = time.perf_counter()
        found = self._evaluate(self.space.law_at(point))
        self._running += time.perf_counter() - begun
        return found

    def _rows(self) -> list[Row]:
        """Return all that was evaluated."""
        return [
            {f"share.{name}": share for name, share in zip(self.space.names, point, strict=True)}
            | {"total": finite_or_none(found.total), "violation": found.violation}
            | dict(zip(NUMBERS, finite_or_none(found.numbers.tolist()), strict=True))
            for point, found in self._known.items()
        ]

    def _write(self) -> None:
        if self._file is not None and self._known:
            write_whole(self._file, parquet(self._rows(), {}))
        self._written = time.monotonic()

    def search(self) -> SimplexSearch:
        """Spend the budget, and return what was asked for."""
        size, block = len(self.space.names), self._problem.block
        seed = self._problem.spec.seed
        search = SimplexSearch(lambda point: self.evaluate(point).rank, size, block.budget, seed)
        search.run()
        return search

    def run(self) -> LawResult:
        """Search, judge the best on what the search did not see, and return it."""
        begun = time.perf_counter()
        search = self.search()
        law, found = self._confirmed(search.best)
        seconds = time.perf_counter() - begun, self._running
        front = self._front()
        self._write()
        return replace(
            self._result(law, found),
            evaluations=len(search.points),
            at_side=self._at_side(search.best),
            front=front,
            rows=self._rows(),
            seconds=seconds,
            faster=self._faster(law, found),
        )

    def _result(self, law: Law, found: Evaluated) -> LawResult:
        """Return what was found of a law, judged on what the search did not see."""
        judged = self._held_out(law)
        return LawResult(
            label=self.label,
            law=msgspec.to_builtins(law),
            parameters=self.space.parameters(law),
            searched=dict(zip(NUMBERS, found.numbers.tolist(), strict=True)),
            held_out=dict(zip(NUMBERS, judged.numbers.tolist(), strict=True)),
            total=found.total,
            held_out_total=judged.total,
            violation=found.violation,
            held_out_violation=judged.violation,
        )

    def _faster(self, law: Law, found: Evaluated) -> LawResult | None:
        """Return the best of some higher gains that keep the margin, if it is better than what is damped as asked."""
        slack = self._evaluate.slack(law)
        if not law.gain_powers or not slack.share < (1 + _MORE) or not math.isfinite(slack.of_margin):
            return None
        factors = np.geomspace(1.0, slack.of_margin * (1 - _GRID_TOLERANCE), _FASTER + 1)[1:].tolist()
        laws = [law.scaled(factor) for factor in factors]
        tried = [(each, self._evaluate(each, damped=False)) for each in laws if slack.of_margin > 1 + _MORE]
        best = min(tried, key=lambda each: each[1].rank, default=None)
        if best is None or best[1].violation > found.violation or not best[1].total < found.total:
            return None
        return replace(self._result(*best), evaluations=len(tried))

    def _confirmed(self, point: Point) -> tuple[Law, Evaluated]:
        """Return the law of a point, slower by the little that its margin is short of what is asked for."""
        law, found = self.space.law_at(point), self.evaluate(point)
        share = self._evaluate.slack(law).share
        if 1 - 2 * _GRID_TOLERANCE < share < 1 + _GRID_TOLERANCE and law.gain_powers:
            law = law.scaled(share * (1 - 2 * _GRID_TOLERANCE))  # limits were found on a grid
            found = self._evaluate(law)
        return law, found

    def _at_side(self, point: Point) -> list[str]:
        """Return what lies at a side of the cube, but for gains at the margin: that is their end by intention."""
        sides = []
        for name, share in zip(self.space.names, point, strict=True):
            by_margin = name == LOOP_GAIN and self.space.ranges[name] is None
            if share < 2 * _GRID_TOLERANCE or share > 1 - 2 * _GRID_TOLERANCE:
                sides.append(f"{name} (margin)" if by_margin and share > 0.5 else name)
        return sides

    def _front(self) -> list[tuple[dict[str, Any], float, float]]:
        front = self._problem.block.front
        if front is None:
            return []
        signs = [-1.0 if name in LARGE_IS_GOOD else 1.0 for name in front.objectives]

        def pair(point: Point) -> tuple[float, float] | None:
            found = self.evaluate(point)
            first, second = map(found.value, front.objectives)
            return None if found.violation else (signs[0] * first, signs[1] * second)

        found = search_front(pair, len(self.space.names), front.budget, self._problem.spec.seed)
        compromises = list(found.items())
        best = nondominated(list(found.values())) if found else []
        return [
            (self.space.parameters(self.space.law_at(point)), signs[0] * first, signs[1] * second)
            for point, (first, second) in (compromises[i] for i in best)
        ]


class ReadyProblem(NamedTuple):
    """What all laws of a problem share in one process."""

    searched: LawEvaluation
    held_out: LawEvaluation


@lru_cache(maxsize=1)
def ready_problem(problem: spec_blocks.TuneProblem) -> ReadyProblem:
    """Return plants and loops of a problem, made once in each process.

    Raises
    ------
    Error
        If something does not fit or is out of reach.
    """
    spec, block = problem.spec, problem.block
    scenes = searched_scenes(problem)
    plant = next(iter(spec.plant_by_label.values()))
    with error_prefix(problem.where):
        family = spec_blocks.plant_family(plant, block.robust, block.margin, spec.period, problem.identified)
        judge = spec_blocks.StabilityJudge(spec, scenes[0], family, block.damping)
    seeds = range(spec.seed, spec.seed + block.seeds)
    return ReadyProblem(
        LawEvaluation(problem, scenes, family, seeds, judge),
        LawEvaluation(problem, held_out_scenes(problem), family, held_out_seeds(problem), None),
    )
