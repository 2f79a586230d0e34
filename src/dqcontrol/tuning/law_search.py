"""The search for one law's best parameters: a task that runs anywhere and can be resumed."""

from __future__ import annotations

import math
import time
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import structs

from dqcontrol.errors import Error, error_prefix
from dqcontrol.experiments.prepared_experiment import PreparedRobot, program
from dqcontrol.experiments.row_file import Row, parquet, read_rows, write_whole
from dqcontrol.files.plain_data import finite_or_none
from dqcontrol.laws import Law
from dqcontrol.measures.metric_tables import LARGE_IS_GOOD, NUMBERS
from dqcontrol.tuning.law_evaluation import (
    Evaluated,
    LawEvaluation,
    held_out_scenes,
    held_out_seeds,
    searched_scenes,
)
from dqcontrol.tuning.robustness import PlantFamily, StabilityJudge, plant_family
from dqcontrol.tuning.search_space import SearchSpace
from dqcontrol.tuning.searches import Point, SimplexSearch, nondominated, search_front
from dqcontrol.tuning.tune_spec import TuneProblem

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

    problem: TuneProblem
    label: str
    part: int
    program: str
    file: Path | None = field(default=None)

    def run(self) -> tuple[int, LawResult]:
        """Return its number and what was found.

        Raises
        ------
        Error
            If another version of dqcontrol, or of the libraries that trials depend on, is installed here.
        """
        if program() != self.program:
            raise Error("a worker has another version of dqcontrol, NumPy or MuJoCo; give all the same")
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
    evaluations: int
    at_side: list[str]
    front: list[tuple[dict[str, Any], float, float]]
    rows: list[dict[str, Any]]
    seconds: tuple[float, float]
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

    def __init__(self, problem: TuneProblem, label: str, file: Path | None = None) -> None:
        self._problem, self._file = problem, file
        self.label = label
        ready = ready_problem(problem)
        self.law: Law = _law(problem, label)
        self._evaluate, self._held_out = ready.searched, ready.held_out
        with error_prefix(problem.where):
            self.space: SearchSpace = SearchSpace(
                label, self.law, problem.block.free.get(label), self._evaluate.slack
            )
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
        search = SimplexSearch(
            lambda point: self.evaluate(point).rank, size, block.budget, self._problem.spec.seed
        )
        search.run()
        return search

    def run(self) -> LawResult:
        """Search, judge the best on what the search did not see, and return it."""
        begun = time.perf_counter()
        search = self.search()
        best = search.best
        law, found = self._confirmed(best)
        seconds = time.perf_counter() - begun, self._running
        front = self._front()
        self._write()
        result = self._result(law, found)
        return structs.replace(
            result,
            evaluations=len(search.points),
            at_side=self._at_side(best),
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
            evaluations=0,
            at_side=[],
            front=[],
            rows=[],
            seconds=(0.0, 0.0),
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
        return structs.replace(self._result(*best), evaluations=len(tried))

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
            by_margin = name == "loop_gain" and self.space.ranges[name] is None
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
            if found.violation:
                return None
            first, second = (
                sign * found.value(name) for sign, name in zip(signs, front.objectives, strict=True)
            )
            return first, second

        found = search_front(pair, len(self.space.names), front.budget, self._problem.spec.seed)
        points, values = list(found), list(found.values())
        best = nondominated(values) if values else []
        return [
            (
                self.space.parameters(self.space.law_at(points[i])),
                signs[0] * values[i][0],
                signs[1] * values[i][1],
            )
            for i in best
        ]


@dataclass(frozen=True)
class ReadyProblem:
    """What all laws of a problem share in one process."""

    scenes: list[PreparedRobot]
    family: PlantFamily
    searched: LawEvaluation
    held_out: LawEvaluation


_ready: dict[int, tuple[TuneProblem, ReadyProblem]] = {}


def ready_problem(problem: TuneProblem) -> ReadyProblem:
    """Return scenes, plants and loops of a problem, made once in each process.

    Raises
    ------
    Error
        If something does not fit or is out of reach.
    """
    key = id(problem)
    if key not in _ready or _ready[key][0] is not problem:
        _ready.clear()
        _ready[key] = problem, _made_ready(problem)
    return _ready[key][1]


def _made_ready(problem: TuneProblem) -> ReadyProblem:
    spec, block = problem.spec, problem.block
    scenes = searched_scenes(problem)
    plant = next(iter(spec.plant_by_label.values()))
    with error_prefix(problem.where):
        family = plant_family(plant, block.robust, block.margin, spec.period, problem.identified)
        judge = StabilityJudge(spec, scenes[0], family, block.damping)
    seeds = range(spec.seed, spec.seed + block.seeds)
    return ReadyProblem(
        scenes,
        family,
        LawEvaluation(problem, scenes, family, seeds, judge),
        LawEvaluation(problem, held_out_scenes(problem), family, held_out_seeds(problem), None),
    )


def _law(problem: TuneProblem, label: str) -> Law:
    return next(variant.law for variant in problem.spec.variants if variant.label == label)
