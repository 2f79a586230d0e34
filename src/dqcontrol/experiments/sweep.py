"""Parameter studies: a spec whose keys vary, each point of which is a study of its own.

They run part by part: in processes here, or on a cluster.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import groupby, islice, product
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import yaml
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.errors import Error, FileFormatError, ShapeError, ValueRangeError, suggest
from dqcontrol.experiments import results_folder
from dqcontrol.experiments.prepared_experiment import PreparedExperiment, check_program, prepare_spec, program
from dqcontrol.experiments.processes import checked_jobs, workers
from dqcontrol.experiments.ranking import BEST_BY, Ranking, rank
from dqcontrol.experiments.result_pages import result_pages
from dqcontrol.experiments.run_comparison import write_table
from dqcontrol.experiments.spec import (
    Spec,
    as_spec,
    in_numbers,
    quantities_at,
    read_data,
    readable_again,
)
from dqcontrol.experiments.spec.reference_spec import ObjectSpec, Part
from dqcontrol.experiments.spec.spec_files import locate_files, write_spec
from dqcontrol.experiments.study import ROWS
from dqcontrol.experiments.trials import Batch, precompile
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.measures.metric_tables import METRIC_COLUMNS, number_column

_MOST_POINTS = 10_000_000  # more are a slip


class Range(Part, frozen=True, kw_only=True):
    """An interval that a key is drawn from.

    Parameters
    ----------
    low, high
        Its ends, in the unit of the key.
    scale
        ``"linear"``, ``"log"`` (uniform in the logarithm) or ``"integer"`` (both ends included).
    count
        Number of equal steps' ends on the scale, for grids only.
    """

    low: float
    high: float
    scale: Literal["linear", "log", "integer"] = "linear"
    count: Annotated[int, Meta(ge=2)] | None = None

    def check(self, field: str, *, grid: bool) -> None:
        """Raise if it is empty, or does not fit the method."""
        if not self.low < self.high:
            raise ValueRangeError(f"{field}: low must be < high, got {self.low:g} and {self.high:g}")
        if self.scale == "log" and self.low <= 0:
            raise ValueRangeError(f"{field}: a log range needs low > 0, got {self.low:g}")
        if self.scale == "integer" and not (self.low.is_integer() and self.high.is_integer()):
            raise ValueRangeError(f"{field}: expected integers, got {self.low:g} and {self.high:g}")
        if grid and self.count is None:
            raise ShapeError(f"{field}: a range in a grid needs 'count', the number of its values")
        if not grid and self.count is not None:
            raise ShapeError(
                f"{field}: 'count' is for grids; say with 'points' how many points there are in all"
            )

    def at(self, share: float) -> float | int:
        """Return the value at a share of the interval, 0 to 1."""
        if self.scale == "integer":
            return int(self.low) + min(int(share * (self.high - self.low + 1)), int(self.high - self.low))
        if share in (0, 1):
            return self.high if share else self.low
        if self.scale == "log":
            return min(max(self.low * (self.high / self.low) ** share, self.low), self.high)
        return self.low + share * (self.high - self.low)

    def steps(self) -> list[float | int]:
        """Return its values in a grid."""
        shares = np.linspace(0, 1, self.count or 2).tolist()
        if self.scale == "integer":  # rounded, not cut into equal shares
            return [round(self.low + share * (self.high - self.low)) for share in shares]
        return [self.at(share) for share in shares]


Values = Annotated[list[Any], Meta(min_length=1)]
Point = dict[str, Any]


class Sampling(Part, frozen=True, kw_only=True):
    """The points of a parameter study.

    Parameters
    ----------
    method
        ``"grid"``: every combination; ``"random"``: uniform and independent; ``"sobol"`` (scrambled) and ``"halton"``
        (scrambled): quasi-random sequences, which fill the space evenly.
    points
        Their number; a grid has its own.
    seed
        Of the points.
    over
        By key of the spec, as ``law.gain``, a list of values or a `Range`.
    """

    method: Literal["grid", "random", "sobol", "halton"] = "grid"
    points: Annotated[int, Meta(ge=1, le=_MOST_POINTS)] | None = None
    seed: Annotated[int, Meta(ge=0, le=2**62)] = 0
    over: Annotated[dict[str, Values | Range], Meta(min_length=1)]

    def check(self) -> None:
        """Raise if the ranges are empty or do not fit the method, or there are too many points.

        Raises
        ------
        ValueRangeError, ShapeError
            Naming the key.
        """
        grid = self.method == "grid"
        for key, values in self.over.items():
            if isinstance(values, Range):
                values.check(f"sweep.over.{key}", grid=grid)
        if grid and self.points is not None:
            raise ShapeError("sweep.points: a grid has as many points as its values combine to; leave it out")
        if not grid and self.points is None:
            raise ShapeError(f"sweep: missing key 'points', which method '{self.method}' needs")
        if self.size > _MOST_POINTS:
            raise ValueRangeError(f"sweep: makes {self.size:,} points; at most {_MOST_POINTS:,}")
        if not grid:
            self._shares(0, 1)

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(map(len, self._grid())) if self.points is None else self.points

    def points_between(self, first: int, last: int) -> Iterator[Point]:
        """Return the points number ``first`` to ``last`` − 1: of each key its value.

        Examples
        --------
        >>> from dqcontrol.experiments.sweep import Range, Sampling
        >>> grid = Sampling(over={"law.gain": Range(low=1.0, high=100.0, scale="log", count=3), "seed": [0, 1]})
        >>> [round(point["law.gain"]) for point in grid.points_between(1, 5)]
        [1, 10, 10, 100]
        """
        if self.method == "grid":
            axes = self._grid()
            for number in range(first, last):
                places = np.unravel_index(number, [len(axis) for axis in axes])
                yield {key: axis[i] for key, axis, i in zip(self.over, axes, places, strict=True)}
            return
        for shares in self._shares(first, last).tolist():
            yield {
                key: values.at(share) if isinstance(values, Range) else values[int(share * len(values))]
                for (key, values), share in zip(self.over.items(), shares, strict=True)
            }

    def ends(self) -> Iterator[Point]:
        """Return the first point, and with every other value, or end of a range, in it."""
        (first,) = self.points_between(0, 1)
        yield first
        for key, values in self.over.items():
            for value in (values.at(0), values.at(1)) if isinstance(values, Range) else values:
                yield first | {key: value}

    def _grid(self) -> list[list[Any]]:
        return [values.steps() if isinstance(values, Range) else values for values in self.over.values()]

    def _shares(self, first: int, last: int) -> NDArray[np.float64]:
        """Return points of the unit cube, (last − first, keys)."""
        count, keys = last - first, len(self.over)
        if self.method == "random":
            return np.random.Generator(np.random.PCG64(self.seed).advance(first * keys)).random((count, keys))
        return quasi_random(self.method, keys, self.seed, first, last)


def quasi_random(method: str, size: int, seed: int, first: int, last: int) -> NDArray[np.float64]:
    """Return the points from ``first`` to before ``last`` of a sequence in the unit cube, shape (points, size).

    Parameters
    ----------
    method
        ``"sobol"`` or ``"halton"``.
    size
        Of a point.
    seed
        Scrambles the sequence.
    first, last
        Numbers of points, counted from 0.
    """
    from scipy.stats import qmc  # takes as long to load as all of ours: only where it is used

    engine = qmc.Sobol if method == "sobol" else qmc.Halton
    sequence = engine(size, rng=np.random.default_rng(seed))
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The balance properties")  # of the whole, not of a part of it
        return sequence.random(last - first)


REFUSED = "refused: "
_FIXED = {"name", "record", "repeats", "laws", "robots", "plants"}  # they make the trials of a point
_MARKED = {"parameter_sets", "grids"}
_DRIVES = {"law", "laws", "plant", "plants"}
_ENDS = ("low", "high")  # of a range
_AT_ONCE = 60_000  # samples of points that are prepared together, 10 MB
_TRIAL = 4e-3  # s, roughly: what a trial takes beside its steps
_PART = 1.0  # s of work in a part
_MOST_IN_PART = 500  # trials


@dataclass(frozen=True)
class Sweep:
    """A spec whose keys vary.

    Attributes
    ----------
    where
        Name for messages.
    data
        The spec as plain data, without ``sweep``.
    folder
        Where its relative file names start.
    sampling
        Its points.
    """

    where: str
    data: dict[str, Any]
    folder: Path
    sampling: Sampling
    _known: dict[bytes, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def name(self) -> str:
        """Name in the spec."""
        return self.first.spec.name

    @property
    def text(self) -> str:
        """Everything as YAML with absolute file names, so that it runs anywhere."""
        data, sampling = copy.deepcopy(self.data), msgspec.to_builtins(self.sampling)
        locate_files(data, self.folder)
        for key, values in sampling["over"].items():
            if isinstance(values, list):
                sampling["over"][key] = [self._located(readable_again(key, value)) for value in values]
            else:
                values.update({end: readable_again(key, values[end]) for end in _ENDS})
        return yaml.safe_dump({**data, "sweep": sampling}, sort_keys=False, allow_unicode=True)

    @cached_property
    def first(self) -> PreparedExperiment:
        """The first point."""
        (point,) = self.sampling.points_between(0, 1)
        with self._at(point):
            return self.setting(point)

    @property
    def runs(self) -> int:
        """How many repeats of points there are, each of all cases."""
        return self.sampling.size * self.first.spec.repeats

    @property
    def trials(self) -> int:
        """How many there are in all."""
        return self.runs * len(self.first.cases)

    @property
    def runs_in_part(self) -> int:
        """How many repeats of points, each of all cases, a part has; the same wherever and in how many jobs it runs."""
        seconds = self.seconds / self.runs
        most = max(_MOST_IN_PART // len(self.first.cases), 1)
        return min(max(math.ceil(_PART / seconds), 1), most)

    @property
    def seconds(self) -> float:
        """How long it takes on one processor, roughly."""
        cases = self.first.cases
        once = sum(Batch(self.first, case, (0,), None).seconds + _TRIAL for case in cases)
        return once * self.sampling.size * self.first.spec.repeats

    @property
    def parts(self) -> int:
        """Number of parts."""
        return math.ceil(self.runs / self.runs_in_part)

    def runs_of(self, part: int) -> range:
        """Return the numbers of a part's runs, which count the repeats of all points one after the other."""
        size = self.runs_in_part
        return range(part * size, min((part + 1) * size, self.runs))

    def trials_in(self, part: int) -> int:
        """Return how many trials a part has."""
        return len(self.runs_of(part)) * len(self.first.cases)

    def setting(self, point: Point) -> PreparedExperiment:
        """Return the study at a point, made ready.

        Raises
        ------
        Error
            If it is malformed, does not fit or is out of reach.
        """
        return prepare_spec(as_spec(self.where, self._data_at(point), self.folder), self.folder, self._known)

    @cached_property
    def _keeps_scenes(self) -> bool:
        """Whether robots and what they follow are those of the first point: its laws and plants alone vary."""
        heads = {key.partition(".")[0] for key in self.sampling.over}
        return heads <= _DRIVES and not self.first.spec.reference.plans_around

    def _spec_at(self, point: Point) -> Spec:
        """Return the spec at a point: of numbers alone with these put into what was read of the first point."""
        if not all(type(value) in (int, float) for value in point.values()):
            return as_spec(self.where, self._data_at(point), self.folder)
        data = dict(self._first_numbers)
        for head in {key.partition(".")[0] for key in point}:
            data[head] = copy.deepcopy(data.get(head))
        for key, value in point.items():
            _put(data, key, value)
        return convert(self.where, data, Spec)

    @cached_property
    def _first_numbers(self) -> dict[str, Any]:
        """The data of the first point, with what files say in their place and numbers in SI units.

        Points of numbers differ from it in their keys alone; others may name another kind or file.
        """
        first = next(self.sampling.points_between(0, 1))
        return in_numbers(self.where, self._data_at(first), self.folder)

    def _data_at(self, point: Point) -> dict[str, Any]:
        """Return the plain data of a point, as a file would have it."""
        data = copy.deepcopy(self.data) | {"record": "metrics"}
        for key, value in point.items():
            _put(data, key, readable_again(key, value))
        return data

    def ends(self) -> Iterator[PreparedExperiment]:
        """Return the studies at the ends of all ranges and at all values of lists, one key at a time.

        Raises
        ------
        Error
            If one is malformed, does not fit or is out of reach.
        """
        for point in self.sampling.ends():
            with self._at(point):
                yield self.setting(point)

    def fingerprint(self) -> str:
        """Return a hash of what trials depend on beside the spec's text."""
        digest = hashlib.sha256()
        for setting in self.ends():
            digest.update(setting.fingerprint().encode())
        return digest.hexdigest()

    def rows(self, runs: range) -> Iterator[results_folder.Row]:
        """Run the trials of some runs, in the order of their points, repeats and cases."""
        repeats = self.first.spec.repeats
        points = self.sampling.points_between(runs[0] // repeats, runs[-1] // repeats + 1)
        by_point = (
            (number, [run % repeats for run in group])
            for number, group in groupby(runs, key=lambda run: run // repeats)
        )
        places = zip(by_point, points, strict=True)
        # What prepares a point is no longer in the processor's caches after a run: several at once take two thirds.
        at_once = max(_AT_ONCE // (len(self.first.scene.samples) * len(self.first.cases)), 1)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # thousands of points; their rows say it
            while some := list(islice(places, at_once)):
                ready = [self._ready(point) for _, point in some]
                for ((number, of_point), point), setting in zip(some, ready, strict=True):
                    yield from self._rows_at(number, point, of_point, setting)

    def _ready(self, point: Point) -> PreparedExperiment | Error:
        """Return the study at a point for runs that follow at once, or why there are none.

        It fails where `setting` does, if in other words.
        """
        try:
            spec = self._spec_at(point)
            if self._keeps_scenes:
                return self.first.with_drives_of(spec)
            return prepare_spec(spec, self.folder, self._known, checked=False)
        except Error as error:
            return error

    def _rows_at(
        self, number: int, point: Point, repeats: list[int], setting: PreparedExperiment | Error
    ) -> Iterator[results_folder.Row]:
        shown = {f"parameter.{key}": self._shown(key, value) for key, value in point.items()}
        place: results_folder.Row = {"point": number} | shown
        try:
            if isinstance(setting, Error):
                raise setting
            outcomes = [list(Batch(setting, case, repeats, None).outcomes()) for case in setting.cases]
        except Error as error:
            why, nothing = self._worded(point, error), dict.fromkeys(METRIC_COLUMNS)
            for repeat, case in product(repeats, self.first.cases):
                trial: results_folder.Row = {"repeat": repeat, "seed": None, "stopped": f"{REFUSED}{why}"}
                yield {**place, **case.names._asdict(), **trial, **nothing}
            return
        for i in range(len(repeats)):
            yield from (place | of_case[i].row for of_case in outcomes)

    def _worded(self, point: Point, error: Error) -> Error:
        """Return an error of a point as it is said before anything moves, if it shows then."""
        try:
            self.setting(point)
        except Error as found:
            return found
        return error

    def _shown(self, key: str, value: Any) -> float | str | None:
        """Return a value as part of a row: numbers as such, if the key has no other values."""
        values = self.sampling.over[key]
        if isinstance(values, Range) or all(isinstance(each, int | float) for each in values):
            return float(value)
        return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)

    def _located(self, value: Any) -> Any:
        """Return the absolute name of a file, or the value itself."""
        near = isinstance(value, str) and (self.folder / value).is_file()
        return str((self.folder / value).resolve()) if near else value

    @contextmanager
    def _at(self, point: Point) -> Iterator[None]:
        try:
            yield
        except Error as error:
            text = str(error).removeprefix(f"{self.where}: ")
            place = ", ".join(f"{key} = {self._shown(key, value)}" for key, value in point.items())
            raise type(error)(f"{self.where}: {text} (at the point {place})") from None


def read_sweep(source: str | Path | dict[str, Any]) -> Sweep:
    """Return the parameter study that a spec with the key ``sweep`` describes.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.

    Raises
    ------
    Error
        If it is missing or malformed, or a key cannot vary.
    """
    where, data, folder = read_data(source)
    return _sweep(where, data, folder)


def sweep_of_text(text: str, folder: Path) -> Sweep:
    """Return the parameter study of which this is the text."""
    return _sweep("spec", parse_yaml("spec", text), folder)


def _sweep(where: str, data: dict[str, Any], folder: Path) -> Sweep:
    data = dict(data)
    if "sweep" not in data:
        raise FileFormatError(f"{where}: missing key 'sweep'; a study without it is run with 'dqcontrol run'")
    try:
        sampling = convert("sweep", {"sweep": _in_si_units(data.pop("sweep"))}, _Whole).sweep
    except FileFormatError as error:
        raise FileFormatError(f"{where}: {str(error).removeprefix('sweep: ')}") from None
    try:
        sampling.check()
        for key in sampling.over:
            head = key.partition(".")[0]
            if key in _FIXED or head in _MARKED:
                raise FileFormatError(f"sweep.over.{key}: cannot vary; vary a key inside it")
    except Error as error:
        raise type(error)(f"{where}: {error}") from None
    return Sweep(where, data, folder, sampling)


def _in_si_units(sampling: Any) -> Any:
    """Return plain data of a sampling with numbers in SI units for texts like ``30 ms``."""
    over = sampling.get("over") if isinstance(sampling, dict) else None
    if not isinstance(over, dict):
        return sampling
    found = {}
    for key, values in over.items():
        field = f"sweep.over.{key}"
        if isinstance(values, dict):
            found[key] = {
                end: quantities_at("sweep", key, value, f"{field}.{end}") if end in _ENDS else value
                for end, value in values.items()
            }
        else:
            found[key] = quantities_at("sweep", key, values, field)
    return {**sampling, "over": found}


class _Whole(msgspec.Struct):
    sweep: Sampling


def _put(data: dict[str, Any], key: str, value: Any) -> None:
    """Set a key with dots, as ``law.gain``, ``start.2`` or, in all laws, ``laws.*.gain``."""
    names = key.split(".")
    places: list[Any] = [data]
    for i, name in enumerate(names):
        last = i == len(names) - 1
        for inner in places:
            if not _has(inner, name, last=last, named=names[i - 1 : i] == ["parameters"]):
                near = suggest(name, inner) if isinstance(inner, dict) else ""
                raise FileFormatError(
                    f"sweep.over.{key}: the spec has no '{'.'.join(names[: i + 1])}' to vary{near}"
                )
        if not last:
            places = [each for inner in places for each in _inside(inner, name)]
    for inner in places:
        inner[int(names[-1]) if isinstance(inner, list) else names[-1]] = copy.deepcopy(value)


def _has(inner: Any, name: str, *, last: bool, named: bool) -> bool:
    """Return whether a part of a spec has a key: any last one, which may be one that is left out of the spec.

    The parameters of own code have to be ``named`` there: they have no defaults, and any further one would be allowed.
    """
    if isinstance(inner, list):
        return name.isdecimal() and int(name) < len(inner)
    if not isinstance(inner, dict):
        return False
    if last:
        return name in inner if named else name != "*"
    return name == "*" or name in inner


def _inside(inner: Any, name: str) -> list[Any]:
    if isinstance(inner, list):
        return [inner[int(name)]]
    return list(inner.values()) if name == "*" else [inner[name]]


SweepProgress = Callable[[int, int], None]  # trials done; trials in all
_ONE_AT_A_TIME = threading.Lock()  # a cluster's worker may have threads, and trials change warning filters


@dataclass(frozen=True)
class Task:
    """A part of a parameter study, to be run anywhere.

    Attributes
    ----------
    text, folder
        Of the study.
    program
        Versions that it must run with.
    part
        Its number.
    runs
        What it consists of; see `Sweep.runs_of`.
    """

    text: str
    folder: Path
    program: str
    part: int
    runs: range

    def run(self) -> tuple[int, int, bytes]:
        """Return the part's number, its number of trials, and its rows in a Parquet file.

        Raises
        ------
        Error
            If another version of dqcontrol, or of the libraries that trials depend on, is installed here.
        """
        check_program(self.program)
        with _ONE_AT_A_TIME:
            rows = list(_known(self.text, self.folder).rows(self.runs))
        return self.part, len(rows), results_folder.parquet(rows, {})


@lru_cache(maxsize=1)
def _known(text: str, folder: Path) -> Sweep:
    return sweep_of_text(text, folder)


def run_sweep_to(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    jobs: int | None = None,
    scheduler: str | None = None,
    by: str = BEST_BY,
    progress: SweepProgress | None = None,
) -> Ranking:
    """Run a parameter study, and write ``spec.yaml``, ``runs.parquet``, a table and a figure of its best points.

    The same spec gives the same rows to the last bit, whatever the number of jobs or workers. Finished parts are kept
    in ``.NAME.part`` beside the folder NAME until all are there: after an interruption the same call resumes it.

    Parameters
    ----------
    source
        Path of a YAML file with the key ``sweep``, or the same as a dictionary.
    folder
        A new folder.
    force
        Replace the folder, if it holds earlier results, and discard finished parts of another spec or version.
    jobs
        Processes on this machine; default: as many as there are processors, or one if there is little to do.
    scheduler
        Address of a Dask scheduler, whose workers run the trials in place of processes here.
    by
        Number, as in `Metrics.flat`, that says which points are best.
    progress
        Called with trials done, and in all.

    Returns
    -------
    The points, the best first.

    Raises
    ------
    Error
        If something is missing, malformed, does not fit or is out of reach, at the first point or with any end of a
        range or value of a list in it; or if the folder must not be written, or nobody answers at the address.
    """
    sweep, target, jobs = read_sweep(source), Path(folder), checked_jobs(jobs)
    if scheduler is not None and jobs is not None:
        raise Error("jobs: is for processes on this machine; leave it out with a scheduler")
    if isinstance(sweep.first.spec.reference, ObjectSpec):
        if scheduler is not None or jobs not in (None, 1):
            raise Error(
                "reference: is an object of this program, which other processes do not have; leave out jobs"
            )
        jobs = 1
    results_folder.check_new(target, force=force)
    number_column(by)
    fingerprint = sweep.fingerprint()
    with (
        results_folder.WorkingFolder(
            results_folder.working_folder(target), sweep.text, fingerprint, force=force
        ) as parts,
        workers(
            Task.run, jobs, scheduler, sweep.seconds, sweep.parts, lambda: _precompile_ends(sweep)
        ) as carry_out,
    ):
        _run(sweep, parts, carry_out, progress or (lambda done, total: None))
        with results_folder.new_folder(target, force=force) as new:
            write_spec(sweep.text, new)
            results_folder.join_files(list(parts.parts().values()), new / ROWS, {"spec": sweep.text})
            ranking = rank([new], by)
            write_table(ranking.table(), new, "best")
            result_pages().write_sweep_report(ranking, sweep.text, new)
        parts.discard()
    return ranking


def _precompile_ends(sweep: Sweep) -> None:
    precompile([Batch(setting, case, (0,), None) for setting in sweep.ends() for case in setting.cases])


def _run(
    sweep: Sweep,
    parts: results_folder.WorkingFolder,
    carry_out: Callable[[Iterable[Task]], Iterator[tuple[int, int, bytes]]],
    report: SweepProgress,
) -> None:
    """Run the parts that are not finished, and write each when it is there."""
    finished = parts.parts()
    done = sum(sweep.trials_in(part) for part in finished)
    report(done, sweep.trials)
    text, version = sweep.text, program()
    left = (part for part in range(sweep.parts) if part not in finished)
    tasks = (Task(text, sweep.folder, version, part, sweep.runs_of(part)) for part in left)
    for part, count, content in carry_out(tasks):
        results_folder.write_whole(parts.part(part), content)
        done += count
        report(done, sweep.trials)
