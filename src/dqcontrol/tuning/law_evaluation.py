"""Evaluation of a law: all numbers of its runs on all motions, starts, seeds and plants."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace as changed

from dqcontrol.arrays import Array
from dqcontrol.controller import Controller
from dqcontrol.errors import Error, ValueRangeError
from dqcontrol.experiments.contacts import contacts_of
from dqcontrol.experiments.feasibility import path_demand
from dqcontrol.experiments.outcome import judge
from dqcontrol.experiments.prepared_experiment import PreparedRobot, prepare_spec
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws import Law
from dqcontrol.loop.record import Record
from dqcontrol.loop.replanning import refuse_replanning
from dqcontrol.loop.simulate import RepeatedLoop, RolloutView, share_records
from dqcontrol.measures.metric_tables import NUMBERS, RunMeasure, of_all_runs
from dqcontrol.measures.metrics import AT_LIMIT
from dqcontrol.plants.plant import Plant, command_mode, lagging_mode
from dqcontrol.references.sample import TIME
from dqcontrol.robots import TreeRobot
from dqcontrol.robots.robot import CommandMode
from dqcontrol.tuning.spec_blocks import PlantFamily, Slack, StabilityJudge, TuneProblem

_UNSTABLE, _DIVERGED = 1e3, 1e6  # violations, beside which those of numbers are small
_NEARLY = 1e-3  # of a margin
_OTHER_START = 0.1  # rad or m, as far are held-out starts from the spec's
_HELD_OUT_STARTS, _TRIES = 2, 20  # of ten drawn near a start that runs, one is to run as well
_FIRST_HELD_OUT = 1_000_003  # seed, counted from the spec's


class Evaluated(NamedTuple):
    """What came of a law.

    Attributes
    ----------
    total
        Weighted sum of the objectives, of the worst plant; infinite where there is none.
    violation
        By how much constraints are violated, and what of the spec's ``outcome`` is not so; 0 if all is kept.
    numbers
        All `NUMBERS` of the worst plant's runs together, see `of_all_runs`.
    """

    total: float
    violation: float
    numbers: Array

    @property
    def rank(self) -> tuple[float, float]:
        """What is better comes first: fewer violations, then a smaller total."""
        return self.violation, self.total

    def value(self, name: str) -> float:
        """Return one number."""
        return float(self.numbers[NUMBERS.index(name)])


class LawEvaluation:
    """Runs laws on scenes, seeds and plants; one a process, as its memory is used again and again.

    Parameters
    ----------
    problem
        The spec and what is searched for.
    scenes
        Robots at their starts with their motions.
    family
        Of plants.
    seeds
        Of the noise.
    judge
        Of stability; None: that is not asked.
    """

    def __init__(
        self,
        problem: TuneProblem,
        scenes: Sequence[PreparedRobot],
        family: PlantFamily,
        seeds: Sequence[int],
        judge: StabilityJudge | None,
    ) -> None:
        spec = problem.spec
        self._block, self._spec, self._judge = problem.block, spec, judge
        self._scenes, self._family, self._seeds = list(scenes), family, list(seeds)
        robot, plant = scenes[0].robot, family.plants[0]
        self._limits = spec.limits_of(plant, robot)
        self._mode: CommandMode = lagging_mode(plant)
        self._lag = plant.lag(robot)
        limits = robot.limits
        if command_mode(plant) == "measured":  # its commands are no velocities of joints
            limits = replace(limits, velocity=np.full_like(limits.velocity, np.inf))
        self._measures = [RunMeasure(scene.robot, limits) for scene in scenes]
        self._skipped = math.ceil(spec.skip_initial / spec.period * (1 - 1e-12))
        self._objectives = np.array([NUMBERS.index(name) for name in self._block.objectives])
        self._weights = np.array(list(self._block.objectives.values()))
        self._bounds = [(NUMBERS.index(name), each) for name, each in self._block.constraints.items()]
        self._followed: dict[bool, tuple[list[PreparedRobot], list[list[RepeatedLoop]]]] = {}
        self._last: tuple[Law, list[Controller]] | None = None

    def _as_followed(self, law: Law) -> tuple[list[PreparedRobot], list[list[RepeatedLoop]]]:
        """Return the scenes as a law follows them, and for each plant its loops with them; made once."""
        leads = bool(law.lag_at)
        if leads not in self._followed:
            scenes = [scene.as_followed(law, self._lag) for scene in self._scenes]
            loops = [
                [self._loop(scene, plant, seed) for seed in self._seeds for scene in scenes]
                for plant in self._family.plants
            ]
            share_records([loop for of_plant in loops for loop in of_plant])
            self._followed[leads] = scenes, loops
        return self._followed[leads]

    def _loop(self, scene: PreparedRobot, plant: Plant, seed: int) -> RepeatedLoop:
        spec = self._spec
        return RepeatedLoop(
            self._scenes[0].robot,
            plant,
            scene.start,
            spec.period,
            scene.samples,
            seed=seed,
            supervisor=spec.supervisor_of(plant),
            disturbance=spec.disturbance,
        )

    @property
    def steps(self) -> int:
        """How many steps an evaluation takes."""
        runs = len(self._family.plants) * len(self._seeds)
        return runs * sum(len(scene.samples) for scene in self._scenes)

    def prepared(self, law: Law) -> list[Controller]:
        """Return a law made ready for each scene; once for all, if it asks for no horizon and nothing for the start."""
        if self._last is not None and self._last[0] is law:  # judged a moment ago
            return self._last[1]
        scenes, _ = self._as_followed(law)
        first, *others = scenes
        depends = law.horizon(first.reference) > 0.0 or isinstance(first.robot, TreeRobot)
        made = [self._prepared(law, scene) for scene in (first, *(others if depends else ()))]
        self._last = law, made if depends else made * len(scenes)
        return self._last[1]

    def _prepared(self, law: Law, scene: PreparedRobot) -> Controller:
        period, limits = self._spec.period, self._limits
        given = period, limits, self._mode, scene.tasks, self._lag
        made = law.prepare(scene.robot, scene.reference, *given)
        refuse_replanning(made, scene.reference, "which runs that are only judged do not")
        return made

    def slack(self, law: Law) -> Slack:
        """Return how far a law is from the stability that is asked for, over all scenes."""
        if self._judge is None:
            return Slack(0.0, math.inf, math.inf)
        found = [self._judge.slack(law, each) for each in dict.fromkeys(self.prepared(law))]
        products, *shares = zip(*found, strict=True)
        return Slack(max(products), *map(min, shares))

    def __call__(self, law: Law, *, damped: bool = True) -> Evaluated:
        """Run a law everywhere; one that is not stable enough, or not as ``damped`` as asked, does not run at all."""
        nothing = np.full(len(NUMBERS), math.nan)
        try:
            prepared = self.prepared(law)
        except Error:  # parameters that the law does not take
            return Evaluated(math.inf, 2 * _DIVERGED, nothing)
        if self._judge is not None:
            slack = self.slack(law)
            share = slack.share if damped else slack.of_margin
            if share < 1 - _NEARLY:
                return Evaluated(math.inf, _UNSTABLE * (2 - share), nothing)
        worst, violation = Evaluated(-math.inf, 0.0, nothing), 0.0
        for loops in self._as_followed(law)[1]:
            rows = np.empty((len(loops), len(NUMBERS)))
            for i, loop in enumerate(loops):
                scene = i % len(self._scenes)
                passed = loop.run(prepared[scene])
                if passed.failed or len(passed.q) < 3:
                    left = 1 - len(passed.q) / len(loop.samples)
                    return Evaluated(math.inf, _DIVERGED * (1 + left), nothing)
                q = passed.measured if self._spec.metrics_from == "measured" else passed.q
                rows[i] = self._measures[scene](passed.samples, q, passed.command, self._skipped)
                violation += self._unmet(law, self._scenes[scene], loop.plant, passed)
            for place, bounds in self._bounds:
                violation += max(bounds.violation(float(value)) for value in rows[:, place])
            numbers = of_all_runs(rows)
            total = float(self._weights @ numbers[self._objectives])
            if not math.isfinite(total):
                return Evaluated(math.inf, _UNSTABLE, numbers)
            if total > worst.total:
                worst = Evaluated(total, 0.0, numbers)
        return worst._replace(violation=violation)

    def _unmet(self, law: Law, scene: PreparedRobot, plant: Plant, passed: RolloutView) -> int:
        """Return how much of what the spec's ``outcome`` says is not true of a run."""
        spec = self._spec
        if not spec.outcome:
            return 0
        desired, robot = passed.samples, scene.robot
        record = Record(
            desired[:, TIME],
            passed.q,
            passed.measured,
            passed.command,
            row_by_row(robot.fkm, passed.q),
            desired,
            robot.joint_names,
            readings=dict(passed.readings),
        )
        world = spec.surroundings
        through = [each.words for each in contacts_of(robot, law.constraints, plant, world).of_run(record)]
        judged = [judge(each, record, robot, world, spec.period, through) for each in spec.outcome]
        return sum(not each.holds for each in judged)


def searched_scenes(problem: TuneProblem) -> list[PreparedRobot]:
    """Return what a search runs on: each start with each motion.

    Raises
    ------
    Error
        If a motion or start does not fit or is out of reach.
    """
    spec, block = problem.spec, problem.block
    found = []
    for i, start in enumerate([spec.start, *block.starts]):
        for k, reference in enumerate([spec.reference, *block.references]):
            place = [f"tune.starts[{i - 1}]"] * bool(i) + [f"tune.references[{k - 1}]"] * bool(k)
            found.append(_scene(problem, start, reference, ", ".join(place)))
    return found


def held_out_scenes(problem: TuneProblem) -> list[PreparedRobot]:
    """Return what winners are judged on: as the spec says, or the searched motions from two other starts nearby.

    Raises
    ------
    Error
        If a motion or start does not fit or is out of reach.
    """
    spec, held_out = problem.spec, problem.block.held_out
    if held_out.references is None and held_out.starts is None:
        return list(_nearby(problem))
    references = held_out.references or [spec.reference]
    starts = held_out.starts or [spec.start]
    return [
        _scene(problem, start, reference, f"tune.held_out, motion {k + 1}, start {i + 1}")
        for i, start in enumerate(starts)
        for k, reference in enumerate(references)
    ]


def held_out_seeds(problem: TuneProblem) -> range:
    """Return the seeds that the search does not see."""
    first = problem.spec.seed + _FIRST_HELD_OUT
    return range(first, first + problem.block.held_out.seeds)


def _nearby(problem: TuneProblem) -> Iterator[PreparedRobot]:
    """Give all searched motions from other starts where no joint comes to its limit; from its own, if nowhere else.

    They are the same motions, so that errors here are comparable with those of the search; where a joint stops at its
    limit, they are not.
    """
    spec = problem.spec
    references = [spec.reference, *problem.block.references]

    def scenes(start: Any) -> list[PreparedRobot]:
        return [_scene(problem, start, each) for each in references]

    home = scenes(spec.start)
    limits, draw, found = home[0].robot.limits, np.random.default_rng(spec.seed), 0
    for _ in range(_TRIES):
        moved = home[0].start + draw.uniform(-_OTHER_START, _OTHER_START, len(home[0].start))
        moved = np.clip(moved, limits.lower, limits.upper)
        with warnings.catch_warnings(record=True) as of_others:
            warnings.simplefilter("always")
            try:
                others = scenes(moved.tolist())
            except Error:
                continue
            if not all(map(_has_room, others)):
                continue
        for each in of_others:
            warnings.warn(each.message, stacklevel=2)
        yield from others
        found += 1
        if found == _HELD_OUT_STARTS:
            return
    if not found:
        yield from home


def _has_room(scene: PreparedRobot) -> bool:
    """Return whether joints that follow the motion as well as can be stay away from their position limits."""
    demand = path_demand(scene)
    return demand is not None and demand.limit_margin > AT_LIMIT


def _scene(problem: TuneProblem, start: Any, reference: Any, place: str = "") -> PreparedRobot:
    spec = changed(problem.spec, start=start, reference=reference)
    try:
        scene = prepare_spec(spec, problem.folder, {}).scene
    except Error as error:
        raise type(error)(": ".join(filter(None, (problem.where, place, str(error))))) from None
    if len(scene.samples) < 3:
        raise ValueRangeError(
            f"{problem.where}: duration: takes {len(scene.samples)} samples; a search needs 3"
        )
    return scene
