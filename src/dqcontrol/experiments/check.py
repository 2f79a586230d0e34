"""Predictions about a spec's loops, made before anything moves."""

from __future__ import annotations

import math
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.constraints.constraints import Constraints
from dqcontrol.errors import DivergedError, NoteWarning, StabilityWarning
from dqcontrol.experiments.contact_check import contact_table
from dqcontrol.experiments.feasibility import run_remarks, task_remarks
from dqcontrol.experiments.prepared_experiment import Combination, Names, PreparedExperiment, prepare
from dqcontrol.experiments.spec import AnyPlant, Spec
from dqcontrol.geometry import Hull, distance_kernels as kernels
from dqcontrol.limits import CommandLimits, Compensation
from dqcontrol.measures import stability
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import command_mode
from dqcontrol.robots import Robot
from dqcontrol.tables.number_texts import number_text, percent_text
from dqcontrol.tables.tables import Cell, Column, Table, Tabled, VerdictCell, known

_REPEATS = 20


def mesh_remarks(setting: PreparedExperiment) -> Iterator[str]:
    """Give in one line for each body made of several convex parts that constraints keep clear of what these cost."""
    told: set[str] = set()
    for case in setting.cases:
        kept = case.variant.law.constraints
        if kept is None:
            continue
        for name in kept.obstacles:
            if name not in told and (words := mesh_cost(case.scene.robot, kept, name)):
                told.add(name)
                yield words


def mesh_cost(robot: Robot, constraints: Constraints, name: str) -> str:
    """Return what the convex parts of a body cost a step, where it has several; empty otherwise.

    Parameters
    ----------
    robot
        Whose links are kept clear of it, where they are at rest in all coordinates 0.
    constraints
        That keep them.
    name
        Of the body.
    """
    hulls = [shape for shape in constraints.obstacles[name].shapes if isinstance(shape, Hull)]
    if robot.shapes is None or len(hulls) < 2:
        return ""
    rows = np.array([shape.row for shape in robot.shapes.moved(robot, np.zeros(robot.configuration_size))])
    found, spent = np.empty((len(rows), kernels.FOUND)), 0.0
    for hull in hulls:
        parts = np.tile(hull.row, (len(rows), 1))
        kernels.distances(rows, parts, found)
        begin = time.process_time()
        for _ in range(_REPEATS):
            kernels.distances(rows, parts, found)
        spent += (time.process_time() - begin) / _REPEATS
    corners = sum(len(hull.points) for hull in hulls)
    return (
        f"constraints.clear_of.{name}: {len(hulls)} convex parts with {corners} corners; all their distances from "
        f"{len(rows)} links take {1e6 * spent:.2g} µs here, each time that a step looks at them; far ones are left out"
    )


_FREE = CommandLimits(velocity=False)
_HORIZON = 2.0  # s, in which what matters of an observer is seen
LEAST_OVERSHOOT = 0.05  # %; less is none

# by direction, integral share and lag of the gain
Known = dict[tuple[complex, float, float], stability.GainLimits]

_WORST_FIRST: tuple[stability.Verdict, ...] = (
    "unstable",
    "unstable for large errors",
    "oscillatory",
    "drifts",
    "good",
)


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

    gain: stability.LoopGain
    limits: stability.GainLimits
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
    def verdict(self) -> stability.Verdict:
        """What becomes of errors."""
        return self.limits.verdict(self.product)

    @property
    def overshoot(self) -> float:
        """By how much of it the loop passes a step, 0 or more; infinite if it is unstable."""
        if self.gain.integral_share or self.gain.value.imag:
            return stability.damped_overshoot(self.model.poles(self.gain.value))
        return stability.overshoot(self.model, self.gain.value.real)

    @property
    def radius(self) -> float:
        """Factor by which the loop's errors shrink a period, in the long run."""
        return stability.spectral_radius(self.model.poles(self.gain.value))


@dataclass(frozen=True)
class LoopCheck:
    """What is to be expected of one law on one plant, about a target at rest.

    It holds for small errors: up to `largest_error` where commands are limited on their way.

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
    acceleration
        Least limit of acceleration on the commands' way to the plant, rad/s² or m/s²; infinite without.
    numeric
        Instead of loops, where the law's gains are unknown: the law as finite differences at the start see it.
    observed
        Whether a disturbance observer stands between law and plant.
    fails
        Whether the law has no command at the start.
    """

    names: Names
    period: float
    loops: tuple[Loop, ...]
    unknown: str = ""
    acceleration: float = math.inf
    numeric: stability.NumericLoop | None = None
    observed: bool = False
    fails: bool = False

    def __repr__(self) -> str:
        return f"LoopCheck({self.names.label!r}, {self.verdict})"

    @property
    def worst(self) -> Loop:
        """The loop nearest to its limit."""
        return min(self.loops, key=lambda loop: loop.margin)

    @property
    def verdict(self) -> stability.Verdict:
        """What becomes of errors in the worst of the loops."""
        if self.unknown:
            return "cannot be decided"
        if self.numeric:
            return "drifts" if self.numeric.drifts else "stable" if self.numeric.is_stable else "unstable"
        verdicts = {loop.verdict for loop in self.loops}
        return next(verdict for verdict in _WORST_FIRST if verdict in verdicts)

    @property
    def time_constant(self) -> float:
        """Seconds in which the slowest loop's errors shrink to 1/e; infinite if they do not."""
        slowest = self.numeric.radius if self.numeric else max(loop.radius for loop in self.loops)
        if slowest >= 1:
            return math.inf
        return -self.period / math.log(slowest) if slowest > 0 else 0.0

    @property
    def overshoot(self) -> float:
        """The largest of the loops', as a share of a step; infinite if one is unstable."""
        return max(loop.overshoot for loop in self.loops)

    @property
    def largest_error(self) -> float:
        """About the error of a joint from which on limits of acceleration act, a/k², rad or m."""
        fastest = max((abs(loop.gain.value) for loop in self.loops), default=0.0)
        return self.acceleration / fastest / fastest if fastest else math.inf  # a square could overflow

    @property
    def remark(self) -> str:
        """What to do about it, in one line; empty if nothing need be done."""
        if self.unknown:
            return f"{self.names.label}: cannot be decided: {self.unknown}"
        if self.verdict == "drifts":
            return f"{self.names.label}: drifts: nothing corrects its errors"
        if self.numeric:
            return f"{self.names.label}: {self._at_the_start(self.numeric)}"
        loop, verdict = self.worst, self.verdict
        limits, when = loop.limits, f" at {loop.gain.time:g} s" if loop.gain.time is not None else ""
        if verdict == "good":
            return self._small_only
        if loop.gain.lag * self.period >= 2:
            limit = number_text(2 / self.period)
            return f"{self.names.label}: unstable: k_v = {number_text(loop.gain.lag)} 1/s, limit {limit} 1/s"
        if limits.stable == 0:
            cure = "; give limits.compensation a longer observer, or a truer lag and delay"
            what = ("the plant with its observer", cure) if self.observed else ("the plant", "")
            return f"{self.names.label}: {loop.gain.loop} unstable: so is {what[0]}, with any gain{what[1]}"
        gain, limit = number_text(abs(loop.gain.value)), number_text(limits.stable / self.period)
        facts = f"k = {gain} 1/s{when}, limit {limit} 1/s"
        if verdict == "oscillatory":
            facts += f", overshoot {percent_text(loop.overshoot)}"
        if verdict == "unstable for large errors":
            beyond = f"; beyond errors of about {self.largest_error:.2g} rad (or m) in a joint"
            facts += f"{beyond} the supervisor's limit of acceleration may keep it oscillating"
        return f"{self.names.label}: {loop.gain.loop} {verdict}: {facts}; {self._advice(loop)}"

    def _at_the_start(self, loop: stability.NumericLoop) -> str:
        factor, how = loop.margin, "by numeric linearisation at the start only"
        if not math.isfinite(factor):
            return f"stable with any factor on its command, {how}"
        if not factor:
            return f"unstable with any factor on its command, {how}"
        return f"{self.verdict} {how}: its command turns the loop unstable from {factor:.3g} times as much on"

    @property
    def _small_only(self) -> str:
        if not math.isfinite(self.largest_error):
            return ""
        return (
            f"{self.names.label}: valid for errors up to about {self.largest_error:.2g} rad (or m) in a joint: from "
            "there on the supervisor's limit of acceleration acts"
        )

    def _advice(self, loop: Loop) -> str:
        recommended = loop.limits.recommended / self.period
        gain = abs(loop.gain.value)  # its square as a product, infinite where ** would raise
        if not recommended:
            if loop.gain.integral_share:
                return f"choose k_I ≤ k²/2 = {gain * gain / 2:.3g} 1/s²"
            return "no gain makes it good: its errors turn as they shrink; take weights that are nearer to a diagonal"
        if loop.gain.lag and loop.gain.loop != "null space":
            return f"choose k̄ ≤ {4 * loop.gain.lag * recommended:.3g} 1/s²"
        as_well = " and k_I ∝ k²" if loop.gain.integral_share else ""
        return f"largest recommended k = {recommended:.3g} 1/s{as_well}"


@dataclass(frozen=True)
class Checks(Tabled, Sequence[LoopCheck]):
    """The checks of a spec, one a law, parameter set and plant.

    Attributes
    ----------
    name
        Of the spec.
    rows
        The loops of each combination.
    tasks
        What speaks against its doing what is asked: joints that are too few, velocities beyond their limits;
        and what meshes cost.
    contact
        What the knobs of its contact loops mean; None without contact.
    """

    name: str
    rows: tuple[LoopCheck, ...]
    tasks: tuple[str, ...] = ()
    contact: Table | None = None

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, i: Any) -> Any:
        return self.rows[i]

    def __repr__(self) -> str:
        counts = Counter(row.verdict for row in self.rows).items()
        return f"Checks({self.name!r}, {', '.join(f'{count} {verdict}' for verdict, count in counts)})"

    def __str__(self) -> str:
        """Return the table, and what to do."""
        contact = [] if self.contact is None else ["", str(self.contact)]
        return "\n".join([super().__str__(), *contact])

    @property
    def unstable(self) -> bool:
        """Whether one of them is expected to be unstable."""
        return any(row.verdict == "unstable" for row in self.rows)

    def remarks(self) -> Iterator[str]:
        """Give what to do about each that asks for it, in one line."""
        yield from (row.remark for row in self.rows if row.remark)
        yield from self.tasks

    def table(self) -> Table:
        """Return one row a law, parameter set and plant: gains at their largest, limits of the worst of its loops."""
        places = [field for field in Names._fields if any(getattr(row.names, field) for row in self.rows)]
        return Table.of((_cells(row, places) for row in self.rows), self.name)


def _cells(row: LoopCheck, places: list[str]) -> list[tuple[Column, Cell]]:
    gains = {loop.gain.loop: abs(loop.gain.value) for loop in row.loops}
    limit = margin = advised = passed = constant = None
    if row.loops:
        worst, limits = row.worst, row.worst.limits
        advised = limits.recommended / row.period or None
        percent = 100 * row.overshoot
        passed = percent if percent >= LEAST_OVERSHOOT else 0.0
        limit, margin, constant = limits.stable / row.period, worst.margin, row.time_constant
    elif row.numeric:
        margin, constant = row.numeric.margin, row.time_constant
    return [
        *((Column(place), getattr(row.names, place)) for place in places),
        (Column("verdict"), judged(row)),
        (Column("margin", "", ".3g"), known(margin)),
        (Column("largest recommended k", "1/s", ".3g"), known(advised)),
        (Column("limit", "1/s", ".3g"), known(limit)),
        (Column("k position", "1/s", ".3g"), known(gains.get("position"))),
        (Column("k orientation", "1/s", ".3g"), known(gains.get("orientation"))),
        (Column("T", "ms", ".4g"), 1e3 * row.period),
        (Column("overshoot", "%", ".2g"), known(passed)),
        (Column("time constant", "s", ".3g"), known(constant)),
    ]


def judged(row: LoopCheck) -> VerdictCell:
    """Return the verdict as a cell of a table."""
    good = {"good": True, "stable": True, "unstable": False, "unstable for large errors": False}
    return VerdictCell(row.verdict, good.get(row.verdict))


def check(source: str | Path | dict[str, Any]) -> Checks:
    """Check a spec as `run` does before anything moves, and say what is to be expected of its loops.

    Each loop of a law (position, orientation, posture in the null space) is judged as a scalar one: its gain k is known
    from the law's parameters, the largest over time; plant and supervisor from commands to measured positions are
    linear, with delay and smoothing, in steps of a period. Where the gains are unknown, as those of own laws, the law
    is linearised by finite differences at the start, and all joints are judged together. The verdict holds for small
    errors about a target at rest; what is known of large ones under a supervisor's limit of acceleration is said.

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
    proportional · servo: position unstable: k = 60 1/s, limit 50 1/s; largest recommended k = 7.2 1/s
    """
    setting = prepare(source, leaving_out=("tune", "learn"))
    rows, contact = tuple(loop_checks(setting)), contact_table(setting.spec, setting.cases)
    return Checks(setting.spec.name, rows, (*task_remarks(setting), *mesh_remarks(setting)), contact)


def warn_unstable(setting: PreparedExperiment, *, stacklevel: int) -> list[LoopCheck]:
    """Return what is to be expected of a prepared spec's loops; warn, once, where some are unstable.

    What nothing limits, and errors that depend on the origin of the inertial frame, are noted.
    """
    for line in run_remarks(setting):
        warnings.warn(line, NoteWarning, stacklevel=stacklevel + 1)
    checks = list(loop_checks(setting))
    unstable = [row for row in checks if row.verdict.startswith("unstable")]
    if unstable:
        more = f" (and {len(unstable) - 1} more: dqcontrol check lists them)" if len(unstable) > 1 else ""
        warnings.warn(unstable[0].remark + more, StabilityWarning, stacklevel=stacklevel + 1)
    return checks


def loop_checks(setting: PreparedExperiment) -> Iterator[LoopCheck]:
    """Give what is to be expected of each combination of a prepared spec."""
    period = setting.spec.period
    plants: dict[tuple[str, str], tuple[LinearModel | None, float, Known]] = {}
    for case in setting.cases:
        place = case.names.robot, case.names.plant
        if place not in plants:
            plants[place] = *driven_model(setting.spec, case.plant, case.scene.robot, case.scene.start), {}
        model, acceleration, limits = plants[place]
        if model is None:
            yield LoopCheck(case.names, period, (), "the plant has no linear model")
        elif len(model.transition) > stability.MOST_STATES:
            size = len(model.transition)
            many = f"plant and supervisor have a model of {size} states; {stability.MOST_STATES} at most are judged"
            yield LoopCheck(case.names, period, (), many)
        elif case.gains is None:
            yield _numeric_check(setting, case, model)
        else:
            compensation = case.limits.compensation
            if compensation is not None:
                model = with_observer(model, compensation, case.scene.robot, period)
            observed = compensation is not None and bool(compensation.observer)
            limited = math.isfinite(acceleration) and command_mode(case.plant) == "integrated"
            loops = tuple(_loop(gain, model, period, limited, limits) for gain in case.gains)
            yield LoopCheck(case.names, period, loops, "", acceleration, observed=observed)


def _numeric_check(setting: PreparedExperiment, case: Combination, model: LinearModel) -> LoopCheck:
    """Return what is to be expected of a law whose gains are unknown, as it is at the start."""
    period, loop, unknown, fails = setting.spec.period, None, "", False
    try:
        law = stability.linearise_law(case.prepare_law(setting.spec).with_limits(_FREE), case.scene.start)
    except DivergedError as error:
        law, fails = None, True
        unknown = f"the law's loop gains are unknown, and it fails at the start: {error}"
    if law is not None:
        loop = stability.NumericLoop(law, model)
        if loop.size > stability.MOST_STATES:
            unknown = f"law, plant and supervisor have {loop.size} states; {stability.MOST_STATES} at most are judged"
    elif not unknown:
        unknown = "the law's loop gains are unknown, and its command jumps or bends at the start"
    return LoopCheck(case.names, period, (), unknown, numeric=None if unknown else loop, fails=fails)


def driven_model(spec: Spec, plant: AnyPlant, robot: Robot, start: Array) -> tuple[LinearModel | None, float]:
    """Return what a law drives, plant and supervisor, and the least acceleration that the latter allows."""
    period = spec.period
    model = plant.linear_model(robot, start, period)
    supervisor = spec.supervisor_of(plant)
    if model is None or supervisor is None:
        return model, math.inf
    mode = command_mode(plant)
    prepared = supervisor.prepare(robot, period, mode)
    behind = stability.with_mean(model, prepared.window, period, from_measured=mode == "measured")
    return behind, float(prepared.acceleration.min())


def with_observer(model: LinearModel, compensation: Compensation, robot: Robot, period: float) -> LinearModel:
    """Return a plant behind what compensates for its joints; the same without an observer."""
    found = compensation.behind(model.transition, model.inputs, robot.configuration_size, period)
    if found is None:
        return model
    whole = LinearModel(*found)
    return whole.reduced(round(_HORIZON / period)) or whole


def _loop(gain: stability.LoopGain, model: LinearModel, period: float, limited: bool, known: Known) -> Loop:
    """Return a loop with the limits of its gain's direction, integral and lag, which are found once for each."""
    way = gain.value / abs(gain.value) if gain.value.imag else 1.0
    share, model = gain.integral_share, stability.with_lag(model, gain.lag, period)
    kind = way, share, gain.lag
    if kind not in known:
        known[kind] = stability.gain_limits(model, period, way, share, accelerations_limited=limited)
    return Loop(gain, known[kind], stability.with_integral(model, share * abs(gain.value), period), period)
