"""The blocks ``tune`` and ``learn`` of a spec, and how far from instability over a family of plants a law stays."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, NamedTuple, TypeVar

import msgspec
from msgspec import Meta

from dqcontrol.controller import Controller
from dqcontrol.errors import (
    DivergedError,
    FileFormatError,
    ShapeError,
    ValueRangeError,
    error_prefix,
    unknown_name,
)
from dqcontrol.experiments.check import driven_model, with_observer
from dqcontrol.experiments.prepared_experiment import PreparedRobot
from dqcontrol.experiments.spec import AnyPlant, Spec, as_spec, read_data
from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.experiments.spec.reference_spec import AnyReference, Part
from dqcontrol.experiments.spec.spec_files import complete_plants, locate_files
from dqcontrol.files.yaml_file import convert
from dqcontrol.laws import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.measures import stability
from dqcontrol.measures.metric_tables import LARGE_IS_GOOD, NUMBERS
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import Plant

_LAG = 0.2  # of itself, where `identify` has not said by how much it may be wrong
_INTERVALS = "identification.json"  # beside a plant file


class Robustness(Part, frozen=True, kw_only=True):
    """How much of a plant is uncertain, and the margin that all of its family keep.

    Parameters
    ----------
    lag
        Share of the time constants; default: 0.2, or more where the intervals of an identified plant are wider.
    delay
        s; default: one period, or more where the intervals are wider.
    margin
        By how much the gain could at least be multiplied with each plant of the family.
    """

    lag: Annotated[float, Meta(ge=0, lt=1)] | None = None
    delay: Annotated[float, Meta(ge=0, description="s")] | None = None
    margin: Annotated[float, Meta(ge=1, le=1000)] = 1.5


@dataclass(frozen=True)
class PlantFamily:
    """A plant, others that it may be as well, and the stability margin that each must keep.

    Attributes
    ----------
    plants
        The nominal one first.
    margins
        Of each.
    lag, delay
        How far they differ: share of the time constants, and s; 0 with one plant.
    """

    plants: tuple[Plant, ...]
    margins: tuple[float, ...]
    lag: float = 0.0
    delay: float = 0.0

    def __len__(self) -> int:
        return len(self.plants)


def plant_family(
    plant: Plant,
    given: Robustness | bool | None,
    margin: float,
    period: float,
    identified: Path | None,
    field: str = "tune.robust",
) -> PlantFamily:
    """Return the family of a plant.

    Parameters
    ----------
    plant
        The nominal one.
    given
        What the spec says; None: a family if the plant was identified.
    margin
        Of the nominal plant.
    period
        T, s.
    identified
        The plant file that ``dqcontrol identify`` wrote, if the plant is from one.
    field
        For messages.

    Raises
    ------
    ValueRangeError
        If a family is asked for of a plant without lag and delay.
    """
    if given is False or (given is None and identified is None):
        return PlantFamily((plant,), (margin,))
    asked = given if isinstance(given, Robustness) else Robustness()
    known_lag, known_delay = _intervals(identified) if identified else (0.0, 0.0)
    lag = max(_LAG, known_lag) if asked.lag is None else asked.lag
    delay = max(period, known_delay) if asked.delay is None else asked.delay
    corners = [(lag, delay), (lag, -delay), (-lag, delay), (-lag, -delay)]
    others = [other for each in corners if (other := plant.varied(*each)) is not None]
    if not others:
        raise ValueRangeError(
            f"{field}: {type(plant).__name__} has no lag and delay that could vary; leave it out"
        )
    least = min(asked.margin, margin) if margin else 0.0
    return PlantFamily((plant, *others), (margin, *[least] * len(others)), lag, delay)


def identified_file(data: dict[str, Any], folder: Path) -> Path | None:
    """Return the plant file of a spec's plain data, if an identification lies beside it or in it."""
    for plant in [data.get("plant"), *((data.get("plants") or {}).values())]:
        if isinstance(plant, dict) and isinstance(plant.get("file"), str):
            return folder / plant["file"]
    return None


def _intervals(file: Path) -> tuple[float, float]:
    """Return the widest half intervals of lags, as shares, and of delays, s, of an identification beside a file."""
    lag = delay = 0.0
    with suppress(OSError, ValueError, KeyError, TypeError):
        for joint in json.loads((file.parent / _INTERVALS).read_text(encoding="utf-8"))["joints"]:
            if joint["status"] != "fitted":
                continue
            low, high = joint["lag_interval"]
            lag = max(lag, (high - low) / 2 / joint["lag"]) if joint["lag"] else lag
            low, high = joint["delay_interval"]
            delay = max(delay, (high - low) / 2)
    return (lag if math.isfinite(lag) else 0.0), (delay if math.isfinite(delay) else 0.0)


_GRID = 0.02  # of the logarithm of integral shares and lags that limits are found for


class Slack(NamedTuple):
    """Of a law.

    Attributes
    ----------
    product
        k T of its fastest loop of position or orientation; 0 if it is unknown.
    share
        By how much its gain could be multiplied with margin and damping as asked for; infinite if neither is.
    of_margin
        The same with the margins alone.
    of_null_space
        By how much the gain in the null space, which is not the law's, could be multiplied likewise.
    """

    product: float
    share: float
    of_margin: float
    of_null_space: float = math.inf


class StabilityJudge:
    """Judges laws on a family of plants: as ``check`` does, each limit once.

    Parameters
    ----------
    spec, scene, family
        Whose period, supervisor and compensation, at which start, on which plants.
    damping
        Least damping ratio of the slowest poles with the nominal plant.

    Raises
    ------
    ShapeError
        If a margin is asked for, and a plant has no linear model.
    """

    def __init__(self, spec: Spec, scene: PreparedRobot, family: PlantFamily, damping: float) -> None:
        self._damping = damping
        self._period, self._scene = spec.period, scene
        self._margins = family.margins
        self._models = [self._model(spec, plant) for plant in family.plants] if any(family.margins) else []
        self._damped_limits: dict[tuple[int | None, int | None], float] = {}
        self._limits: dict[tuple[int, complex, int | None, int | None], float] = {}

    def _model(self, spec: Spec, plant: Plant) -> LinearModel:
        model, _ = driven_model(spec, plant, self._scene.robot, self._scene.start)
        if model is None or len(model.transition) > stability.MOST_STATES:
            reason = "no linear model" if model is None else f"more than {stability.MOST_STATES} states"
            raise ShapeError(
                f"tune.margin: cannot be judged, as the plant has {reason}; give margin: 0 to search without it"
            )
        if spec.limits.compensation is not None:
            return with_observer(model, spec.limits.compensation, self._scene.robot, spec.period)
        return model

    def slack(self, law: Law, prepared: Controller) -> Slack:
        """Return how far a prepared law is from its limits."""
        gains = stability.loop_gains(law, prepared)
        moving = [abs(gain.value) for gain in gains or () if gain.loop != "null space"]
        product = max(moving, default=0.0) * self._period
        if not self._models:
            return Slack(product, math.inf, math.inf)
        if gains is None:
            numeric = self._numeric(prepared)
            return Slack(product, numeric, numeric)
        of_margin = share = of_null_space = math.inf
        for gain in gains:
            if not gain.value:
                continue
            own = abs(gain.value) * self._period
            margin = min(self._limit(i, gain) / own / asked for i, asked in enumerate(self._margins))
            damped = min(margin, self._damped(gain) / own)
            of_margin, share = min(of_margin, margin), min(share, damped)
            if gain.loop == "null space":
                of_null_space = damped
        return Slack(product, share, of_margin, of_null_space)

    def _limit(self, plant: int, gain: stability.LoopGain) -> float:
        direction = gain.value / abs(gain.value) if gain.value.imag else 1.0
        share, lag = _on_grid(gain.integral_share), _on_grid(gain.lag)
        key = plant, direction, share, lag
        if key not in self._limits:
            behind = stability.with_lag(self._models[plant], _off_grid(lag), self._period)
            self._limits[key] = stability.stability_limit(behind, self._period, direction, _off_grid(share))
        return self._limits[key]

    def _damped(self, gain: stability.LoopGain) -> float:
        """Return the product from which on the nominal plant is not damped as asked; complex gains oscillate anyway."""
        if not self._damping or gain.value.imag:
            return math.inf
        key = _on_grid(gain.integral_share), _on_grid(gain.lag)
        if key not in self._damped_limits:
            share, lag = map(_off_grid, key)
            behind = stability.with_lag(self._models[0], lag, self._period)
            self._damped_limits[key] = stability.damping_limit(behind, self._period, self._damping, share)
        return self._damped_limits[key]

    def _numeric(self, prepared: Controller) -> float:
        """Return the slack of a law whose loop gains are unknown, as it is at the start."""
        try:
            unlimited = prepared.with_limits(CommandLimits(velocity=False))
            law = stability.linearise_law(unlimited, self._scene.start)
        except DivergedError:
            return 0.0
        if law is None:
            return 0.0
        loops = [stability.NumericLoop(law, model) for model in self._models]
        return min(loop.margin / margin for loop, margin in zip(loops, self._margins, strict=True))


def _on_grid(value: float) -> int | None:
    return round(math.log(value) / _GRID) if value > 0 else None


def _off_grid(place: int | None) -> float:
    return 0.0 if place is None else math.exp(place * _GRID)


Block = TypeVar("Block")


@dataclass(frozen=True, eq=False)
class SpecWithBlock(Generic[Block]):
    """A spec with a block of its own.

    Attributes
    ----------
    where
        Name for messages.
    data
        The spec as plain data with absolute file names, without the block.
    folder
        Where its relative file names start.
    spec, block
        The same, typed.
    identified
        The plant file that the spec names, or the block for its model, if one does.
    """

    where: str
    data: dict[str, Any]
    folder: Path
    spec: Spec
    block: Block
    identified: Path | None


DEFAULT_OBJECTIVES = {"position.settled_rms": 1.0, "orientation.settled_rms": 10.0, "command_jerk": 5e-4}

Names = Annotated[list[str], Meta(min_length=1)]
Configuration = Annotated[list[float], Meta(min_length=1, description="rad or m")]


class SearchRange(Part, frozen=True, kw_only=True):
    """An interval that a free parameter is searched in.

    Parameters
    ----------
    low, high
        Its ends.
    scale
        ``"log"``: equal factors count alike, as for gains; or ``"linear"``.
    """

    low: float
    high: float
    scale: Literal["log", "linear"] = "log"

    def check(self, field: str) -> None:
        """Raise if it is empty, or logarithmic with an end at 0 or below."""
        if not self.low < self.high:
            raise ValueRangeError(f"{field}: low must be < high, got {self.low:g} and {self.high:g}")
        if self.scale == "log" and self.low <= 0:
            raise ValueRangeError(
                f"{field}: a log range needs low > 0, got {self.low:g}; give a small number, or scale: linear"
            )

    def at(self, share: float) -> float:
        """Return the value at a share of the interval, 0 to 1."""
        if self.scale == "log":
            return math.exp((1 - share) * math.log(self.low) + share * math.log(self.high))
        return (1 - share) * self.low + share * self.high


class MetricBounds(Part, frozen=True, kw_only=True):
    """Between which numbers a metric must lie."""

    low: float | None = None
    high: float | None = None

    def violation(self, value: float) -> float:
        """Return by how much a value lies outside, as a share of the bound (or as it is where that is 0)."""
        if not math.isfinite(value):
            return 1.0
        below = 0.0 if self.low is None else (self.low - value) / (abs(self.low) or 1.0)
        above = 0.0 if self.high is None else (value - self.high) / (abs(self.high) or 1.0)
        return max(below, above, 0.0)


class HeldOut(Part, frozen=True, kw_only=True):
    """What winners are judged on, and the search does not see.

    Parameters
    ----------
    references
        Other motions; without them and ``starts`` the same one from other starts.
    starts
        Other start configurations, each with all held-out references.
    seeds
        How many seeds of the noise, all others than those of the search.
    """

    references: Annotated[list[AnyReference], Meta(min_length=1)] | None = None
    starts: Annotated[list[Configuration], Meta(min_length=1)] | None = None
    seeds: Annotated[int, Meta(ge=1, le=1000)] = 2


class Front(Part, frozen=True, kw_only=True):
    """Two objectives of which the best compromises are wanted.

    Parameters
    ----------
    objectives
        Two numbers, as in ``tune.objectives``.
    budget
        Evaluations of each law.
    """

    objectives: Annotated[list[str], Meta(min_length=2, max_length=2)]
    budget: Annotated[int, Meta(ge=20, le=100_000)] = 80


class TuneBlock(Part, frozen=True, kw_only=True):
    """A search for the best parameters of laws.

    Parameters
    ----------
    objectives
        By name of a number its weight: their weighted sum is to be as small as possible, in mm, degrees, and the units
        of tables. A negative weight asks for a large number.
    constraints
        By name of a number the bounds that it must keep.
    margin
        By how much the loop's gain could at least be multiplied, of those that ``check`` judges; 0: is not judged, and
        damping neither.
    damping
        Least damping ratio of the slowest poles with the nominal plant; by default that which ``check`` calls good. 0:
        is not judged.
    free
        By label of a law its parameters that are searched for: ``loop_gain`` (kT of the fastest loop),
        ``integral_share`` (k_I/k²), or keys of the law as ``orientation_gain`` or ``inverse.damping``. Default of each
        law: its loop gain up to where the margin ends, and the integral's share, if it has an integral.
    references, starts, seeds
        What is searched on besides the spec's ``reference`` and ``start``; every law on all of it. Each start
        has all references.
    held_out
        What winners are judged on.
    robust
        The worst of a family of plants counts; ``true``: of what is not known of identified servos.
    budget
        How many parameter sets of each law are tried.
    front
        Two objectives of which the best compromises are wanted besides.
    """

    objectives: Annotated[dict[str, float], Meta(min_length=1)] = msgspec.field(
        default_factory=DEFAULT_OBJECTIVES.copy
    )
    constraints: dict[str, MetricBounds] = {}
    margin: Annotated[float, Meta(ge=0, le=1000)] = stability.GOOD_MARGIN
    damping: Annotated[float, Meta(ge=0, le=1)] = stability.GOOD_DAMPING
    free: dict[str, Annotated[dict[str, SearchRange], Meta(min_length=1)]] = {}
    references: list[AnyReference] = []
    starts: list[Configuration] = []
    seeds: Annotated[int, Meta(ge=1, le=1000)] = 1
    held_out: HeldOut = HeldOut()
    robust: Robustness | bool | None = None
    budget: Annotated[int, Meta(ge=1, le=1_000_000)] = 60
    front: Front | None = None

    def check(self) -> None:
        """Raise if a number has no such name, a range is empty, or nothing is asked for.

        Raises
        ------
        UnknownNameError, ValueRangeError
            Naming the key.
        """
        for field, names in (
            ("objectives", self.objectives),
            ("constraints", self.constraints),
            ("front.objectives", self.front.objectives if self.front else ()),
        ):
            for name in names:
                if name not in NUMBERS:
                    raise unknown_name(f"tune.{field}", name, NUMBERS)
        for name in LARGE_IS_GOOD:
            if (weight := self.objectives.get(name, 0.0)) > 0:
                raise ValueRangeError(
                    f"tune.objectives.{name}: a weight of {weight:g} asks for as little of it as can be; "
                    f"give {-weight:g} for as much"
                )
        if not any(self.objectives.values()):
            raise ValueRangeError("tune.objectives: all weights are 0; nothing would be searched for")
        for name, bounds in self.constraints.items():
            if bounds.low is None and bounds.high is None:
                raise ShapeError(f"tune.constraints.{name}: give 'low', 'high' or both")
        for label, ranges in self.free.items():
            for key, span in ranges.items():
                span.check(f"tune.free.{label}.{key}")


class _WithTune(msgspec.Struct):
    tune: TuneBlock = TuneBlock()


class TuneProblem(SpecWithBlock[TuneBlock]):
    """A spec with its block ``tune``."""


def read_tune(source: str | Path | dict[str, Any], **changes: Any) -> TuneProblem:
    """Return what a spec with the key ``tune`` asks for; without it, a search with all defaults.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    **changes
        Keys of the block that differ.

    Raises
    ------
    Error
        If it is missing or malformed, or describes several robots, plants, sets or repeats.
    """
    where, data, folder = read_data(source)
    plain = dict(data)
    block_data = {"tune": {**(plain.pop("tune", None) or {}), **changes}}
    plain.pop("learn", None)
    with error_prefix(where):
        whole = numbers_for_quantities(where, block_data, list(kinds_of(_WithTune)))
        block = convert(where, whole, _WithTune).tune
        block.check()
    locate_files(plain, folder)
    identified = identified_file(plain, folder)
    spec = as_spec(where, plain, folder)
    if spec.start is None:
        raise FileFormatError(f"{where}: robots: a search takes one; give 'robot' and 'start'")
    for what, count, more in (
        ("plants", len(spec.plant_by_label), ""),
        ("repeats", spec.repeats, "; for noise give tune.seeds"),
    ):
        if count > 1:
            raise FileFormatError(f"{where}: {what}: a search takes one, got {count}{more}")
    if spec.parameter_sets or spec.grids:
        key = "parameter_sets" if spec.parameter_sets else "grids"
        raise FileFormatError(f"{where}: {key}: is not for searches; say in tune.free what varies")
    for label in block.free:
        if label not in spec.law_by_label:
            raise FileFormatError(f"{where}: {unknown_name('tune.free', label, spec.law_by_label)}")
    return TuneProblem(where, plain, folder, spec, block, identified)


class Tracker(Part, frozen=True, kw_only=True):
    """What measures the pose of the end effector from outside.

    Parameters
    ----------
    position_noise, orientation_noise
        Standard deviations of each coordinate of a sample, white, m and rad, where it is simulated.
    topic
        Of its poses of the hand in the robot's base frame, ``geometry_msgs/PoseStamped``, for a robot over ROS 2.
    """

    position_noise: Annotated[float, Meta(ge=0, description="m")] = 0.0
    orientation_noise: Annotated[float, Meta(ge=0, description="rad")] = 0.0
    topic: Annotated[str, Meta(min_length=1)] = "/hand_tracker/pose"


class LearnBlock(Part, frozen=True, kw_only=True):
    """Learning from repetition.

    Parameters
    ----------
    repeats
        Most repeats after the first run.
    measured_by
        ``"encoders"``: the end effector's pose follows from the measured joints; ``"tracker"``: it is measured itself.
    tracker
        Its noise.
    sensor_delay
        By how much what is measured is late, s, as of encoders behind a filter.
    cutoff
        Up to which frequency is learnt, Hz; default: as far as the model is sure, 8 Hz at most.
    caution
        ρ: larger values learn slower and take in less noise.
    model
        What the plant is taken for; default: the plant itself, without its noise and what is not linear.
    uncertainty
        What is not known of the model, for which learning must converge as well; ``true``: 20 % of the lag and a
        period, or the intervals of an identified plant; default: that of identified plants and models only.
    skip
        Start of each repeat from which nothing is learnt, s, twice as long until all counts: for motions that begin
        with a jump.
    return_time
        In which the end effector goes back where a motion ends elsewhere than it starts, s.
    """

    repeats: Annotated[int, Meta(ge=1, le=1000)] = 5
    measured_by: Literal["encoders", "tracker"] = "encoders"
    tracker: Tracker = Tracker()
    sensor_delay: Annotated[float, Meta(ge=0, le=1, description="s")] = 0.0
    cutoff: Annotated[float, Meta(gt=0, description="Hz")] | None = None
    caution: Annotated[float, Meta(gt=0, le=1000)] = 0.4
    model: AnyPlant | None = None
    uncertainty: Robustness | bool | None = None
    skip: Annotated[float, Meta(ge=0, description="s")] = 0.0
    return_time: Annotated[float, Meta(gt=0, description="s")] | None = None


class _WithLearn(msgspec.Struct):
    learn: LearnBlock = LearnBlock()


class LearnProblem(SpecWithBlock[LearnBlock]):
    """A spec with its block ``learn``."""

    def points(self, file: str | Path) -> dict[str, Any]:
        """Return the reference of a spec that runs a motion from a file, with the preview that this spec has."""
        preview = self.spec.reference.preview
        more = {} if preview is None else {"preview": msgspec.to_builtins(preview)}
        return {"kind": "points", "file": str(file), **more}


def read_learn(source: str | Path | dict[str, Any], **changes: Any) -> LearnProblem:
    """Return what a spec with the key ``learn`` asks for; without it, learning with all defaults.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    **changes
        Keys of the block that differ; None for none.

    Raises
    ------
    Error
        If it is missing or malformed, or describes several runs.
    """
    where, data, folder = read_data(source)
    plain = dict(data)
    given = {key: value for key, value in changes.items() if value is not None}
    block_data = {**(plain.pop("learn", None) or {}), **given}
    plain.pop("tune", None)
    locate_files(plain, folder)
    identified = identified_file({"plant": block_data.get("model")}, folder) or identified_file(plain, folder)
    if isinstance(block_data.get("model"), dict):
        of_model = {"plant": dict(block_data["model"])}
        complete_plants(of_model, folder)
        block_data["model"] = of_model["plant"]
    whole = numbers_for_quantities(where, {"learn": block_data}, list(kinds_of(_WithLearn)))
    block = convert(where, whole, _WithLearn).learn
    spec = as_spec(where, plain, folder)
    if not spec.is_single:
        raise FileFormatError(f"{where}: describes several runs ({spec.several}); learning takes one")
    return LearnProblem(where, plain, folder, spec, block, identified)
