"""The block ``tune`` of a spec, typed, bounded and described."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import msgspec
from msgspec import Meta

from dqcontrol.errors import FileFormatError, ShapeError, ValueRangeError, error_prefix, unknown_name
from dqcontrol.experiments.spec import Spec, as_spec, read_data
from dqcontrol.experiments.spec.key_types import kinds_of, numbers_for_quantities
from dqcontrol.experiments.spec.reference_spec import AnyReference, Part
from dqcontrol.experiments.spec.spec_files import locate_files
from dqcontrol.files.yaml_file import convert
from dqcontrol.measures.metric_tables import LARGE_IS_GOOD, NUMBERS
from dqcontrol.measures.stability import GOOD_DAMPING, GOOD_MARGIN
from dqcontrol.tuning.robustness import Robustness, identified_file

Block = TypeVar("Block")


@dataclass(frozen=True)
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
    margin: Annotated[float, Meta(ge=0, le=1000)] = GOOD_MARGIN
    damping: Annotated[float, Meta(ge=0, le=1)] = GOOD_DAMPING
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

    def total(self, values: dict[str, float]) -> float:
        """Return the weighted sum of the objectives."""
        return math.fsum(weight * values[name] for name, weight in self.objectives.items())


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
    block = _block(where, numbers_for_quantities(where, block_data, list(kinds_of(_WithTune))))
    locate_files(plain, folder)
    identified = identified_file(plain, folder)
    spec = as_spec(where, plain, folder)
    if spec.start is None:
        raise FileFormatError(f"{where}: robots: a search takes one; give 'robot' and 'start'")
    several = {
        "plants": len(spec.plant_by_label),
        "repeats": spec.repeats,
    }
    for what, count in several.items():
        if count > 1:
            more = "; for noise give tune.seeds" if what == "repeats" else ""
            raise FileFormatError(f"{where}: {what}: a search takes one, got {count}{more}")
    if spec.parameter_sets or spec.grids:
        key = "parameter_sets" if spec.parameter_sets else "grids"
        raise FileFormatError(f"{where}: {key}: is not for searches; say in tune.free what varies")
    for label in block.free:
        if label not in spec.law_by_label:
            raise FileFormatError(f"{where}: {unknown_name('tune.free', label, spec.law_by_label)}")
    return TuneProblem(where, plain, folder, spec, block, identified)


def _block(where: str, data: Any) -> TuneBlock:
    with error_prefix(where):
        block = convert(where, data, _WithTune).tune
        block.check()
    return block
