"""Parts of a spec that become a library: kernels under their names in C, and the numbers that they work on.

Which of these may be changed while the controller exists is found by trying: each number of the law's and the
supervisor's parameters is changed a little, and both are prepared again. Where what compiled code reads changes in
proportion, C can do the same; where it does not (gains of Riccati equations, windows of smoothing), the number stays as
it was exported.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import linecache
import re
import textwrap
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, get_args, get_type_hints

import llvmlite.binding as llvm
import msgspec
import numpy as np
from msgspec import Meta, Struct
from numba.core.errors import NumbaDebugInfoWarning, NumbaError
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel, numba_used
from dqcontrol.compiled.kernel_cache import source_hash
from dqcontrol.compiled.object_code import TargetProcessor, foreign_symbols, isolated_code, target_named
from dqcontrol.controller import Controller
from dqcontrol.controller.command_kernel import Plan, prepared_memory, sent, step
from dqcontrol.errors import Error, NoteWarning, ShapeError, ValueRangeError, unknown_name
from dqcontrol.experiments.prepared_experiment import Combination, PreparedExperiment, prepare
from dqcontrol.extensions import user_code
from dqcontrol.extensions.user_code import function_at
from dqcontrol.laws import Law, OwnLaw
from dqcontrol.laws.law import LAW
from dqcontrol.laws.own_law import finite_checked
from dqcontrol.loop.replanning import refuse_replanning
from dqcontrol.loop.target_motion import move_by_twist, move_to_pose
from dqcontrol.loop.targets import SampledTarget, Target
from dqcontrol.plants.integrator import Integrator
from dqcontrol.plants.plant import CompiledPlant, RunningPlant, command_mode, running_plant
from dqcontrol.references.computed_path import computed_path, path_parameters
from dqcontrol.references.sample import SAMPLE_SIZE, TIME
from dqcontrol.robots import Robot
from dqcontrol.robots.kinematics.kinematics_kernels import given, twist_kinematics
from dqcontrol.supervisor import PreparedSupervisor, Supervisor, supervisor_layout as layout
from dqcontrol.supervisor.supervisor_step import check_start, supervise

_ADVICE = "write loops over plain numbers, and take 'scratch' for arrays of your own"


class _OwnKernel(Kernel):
    """A user's function without reference counts and without the guard that catches what it raises."""

    def __init__(self, function: Callable[..., Any], *, as_in_python: bool = False) -> None:
        inner = numba_used.jit(function, False, ours=not as_in_python, kept=False, located=as_in_python)
        super().__init__(finite_checked(inner), LAW, strict=True, cached=False)
        self.__name__, self._as_in_python = function.__name__, as_in_python

    def bitcode(self, *, portable: bool = False) -> tuple[bytes, str]:
        """Return LLVM's code; it has no vectors: its sums keep their order."""
        with numba_used.scalar_code(), numba_used.quick_compilation():
            as_it_is = self._as_in_python
            dispatcher = numba_used.jit(self.function, False, ours=not as_it_is, kept=False, located=as_it_is)
            dispatcher.compile(self.signature)
            return numba_used.bitcode_of(dispatcher, self.signature)


def own_law_kernel(law: OwnLaw) -> Kernel:
    """Return the kernel of a user's law for C.

    Raises
    ------
    Error
        If it raises, or needs what only Python has; it says what, and which line.
    """
    function = function_at("function", law.function)
    _check_raises_nothing(function)
    native = target_named("native")
    try:
        kernel = _OwnKernel(function)
        foreign = foreign_symbols(isolated_code(*kernel.bitcode(), "own", native))
    except NumbaError:  # an array that is made needs reference counts
        foreign = []
    else:
        if not foreign:
            return kernel
    with warnings.catch_warnings():
        # of expressions that Numba makes into functions
        warnings.simplefilter("ignore", NumbaDebugInfoWarning)
        code, name = _OwnKernel(function, as_in_python=True).bitcode()
    symbols = [
        symbol
        for symbol in foreign_symbols(isolated_code(code, name, "own", native))
        if symbol != "_Py_NoneStruct"
    ]
    where, symbol = _line_of(code, symbols or foreign, function)
    raise Error(f"law: {where} needs {symbol}, which only Python has: {_ADVICE}")


def _check_raises_nothing(function: Callable[..., Any]) -> None:
    """Raise an `Error` at a statement that raises: C would go on with what the law wrote before it."""
    file = inspect.getsourcefile(function) or ""
    lines, first = inspect.getsourcelines(function)
    for node in ast.walk(ast.parse(textwrap.dedent("".join(lines)))):
        if isinstance(node, ast.Raise | ast.Assert):
            line = first + node.lineno - 1
            raise Error(
                f"law: {file}:{line}: '{linecache.getline(file, line).strip()}' raises, which C does not; "
                "write NaN into 'out' there: the controller then says so, and its supervisor stops"
            )


def _line_of(code: bytes, symbols: list[str], function: Callable[..., Any]) -> tuple[str, str]:
    """Return the line of a function that first needs one of these symbols, and which."""
    file = inspect.getsourcefile(function) or ""
    lines, first = inspect.getsourcelines(function)
    text = str(llvm.parse_bitcode(code))
    places = dict(re.findall(r"^(!\d+) = (?:distinct )?!DILocation\((.*)\)$", text, re.MULTILINE))
    found: list[tuple[int, str]] = []
    for symbol in symbols:
        for place in re.findall(rf'@"?{re.escape(symbol)}"?\(.*!dbg (!\d+)', text):
            line = _own_line(places, place, range(first, first + len(lines)))
            if line:
                found.append((line, symbol))
    if not found:
        return f"{file}:{first}: {function.__name__}", ", ".join(symbols) or "memory from Python"
    line, symbol = min(found)
    return f"{file}:{line}: '{linecache.getline(file, line).strip()}'", symbol


def _own_line(places: dict[str, str], place: str, allowed: range) -> int:
    """Return the line that a place belongs to, or what it was inlined into, within the user's function; 0 if none."""
    while place:
        about = places.get(place, "")
        line = re.search(r"line: (\d+)", about)
        if line and int(line[1]) in allowed:
            return int(line[1])
        outer = re.search(r"inlinedAt: (!\d+)", about)
        place = outer[1] if outer else ""
    return 0


def stage_symbol(name: str) -> str:
    """Return the name in C of what a prepared law calls by a name of its `Plan`."""
    return f"dqc_kernel_{name}"


@dataclass(frozen=True)
class ControllerParts:
    """A spec's law, supervisor, reference and plant, ready to be written in C.

    Attributes
    ----------
    setting, case
        The spec, and the combination of it that is exported.
    law
        Along the spec's reference.
    supervisor
        What stands behind it, and the same made ready; None without.
    samples
        Of the reference, one row a period, shape (N, 21).
    path
        What `computed_path` takes where the reference is computed; None where its samples are kept.
    """

    setting: PreparedExperiment
    case: Combination
    law: Controller
    supervisor: tuple[Supervisor, PreparedSupervisor] | None
    samples: Array
    path: Array | None = None

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.case.scene.robot

    @property
    def period(self) -> float:
        """Control period, s."""
        return self.setting.spec.period

    @property
    def law_spec(self) -> Law:
        """The law with its parameters, as the spec has it."""
        return self.case.variant.law

    @property
    def takes_streams(self) -> bool:
        """Whether the target may come from outside: the law's parameters do not depend on time along a reference."""
        return len(self.law.parameters) == 1

    @property
    def shares_kinematics(self) -> bool:
        """Whether kinematics are found once for law and supervisor; constraints ask for them elsewhere too."""
        stages = self.law.stages
        is_chain = stages["kinematics"] is twist_kinematics and stages["constraint"] is None
        return is_chain and self.supervisor is not None and self.supervisor[1].bounds.head[layout.SLOW] > 0.0

    @property
    def wrench_at(self) -> int:
        """Where the law's memory takes the measured wrench from; −1 for a law without contact."""
        wrench, memory = self.law.wrench, self.law.memory
        return (wrench.ctypes.data - memory.ctypes.data) // memory.itemsize if wrench.size else -1

    @property
    def looks_at_start(self) -> bool:
        """Whether the supervisor judges a start by more than the joints."""
        return self.supervisor is not None and self.supervisor[1].looks_at_start

    @property
    def is_at_rest(self) -> bool:
        """Whether all samples of the reference are the same but for their time."""
        return bool((self.samples[:, :TIME] == self.samples[0, :TIME]).all())

    def target(self) -> Target:
        """Return what gives the controller's desired motion in Python."""
        return SampledTarget(self.samples, self.period) if self.path is None else _ComputedTarget(self)

    def plan_field(self, name: str) -> int:
        """Return a number of the law's plan by its name."""
        return int(self.plan[Plan._fields.index(name)])

    def started_plant(self, steps: int) -> RunningPlant:
        """Return the plant where the spec starts, with noise for some steps; in place of a real robot ideal joints."""
        plant = Integrator() if self.case.plant.is_robot else self.case.plant
        start, seed = self.case.scene.start, self.setting.spec.seed
        return running_plant(plant.start(self.robot, start, self.period, steps, seed))

    @cached_property
    def plant(self) -> CompiledPlant | None:
        """The plant where the spec starts, if it is compiled; the noise of its first period is left out."""
        found = None if self.case.plant.is_robot else self.started_plant(1).compiled()
        if found is None or not isinstance(found.kernel, Kernel):
            return None
        return found if found.kernel.function.__module__.startswith("dqcontrol.plants.") else None

    @cached_property
    def kernels(self) -> dict[str, Kernel]:
        """Kernels of the controller by their names in C."""
        found: dict[str, Any] = {"dqc_kernel_step": step, "dqc_kernel_sent": sent}
        found |= {stage_symbol(name): stage for name, stage in self.law.stages.items() if stage is not None}
        if isinstance(self.law_spec, OwnLaw):
            found["dqc_kernel_law"] = own_law_kernel(self.law_spec)
        if self.supervisor:
            found["dqc_kernel_supervise"] = supervise
        if self.looks_at_start:
            found["dqc_kernel_check_start"] = check_start
        if self.shares_kinematics:
            found["dqc_kernel_given"] = given
        if self.path is not None and not self.is_at_rest:
            found["dqc_kernel_reference"] = computed_path
        if self.takes_streams:
            found |= {
                "dqc_kernel_forward": self.robot.kernels.forward,
                "dqc_kernel_to_pose": move_to_pose,
                "dqc_kernel_by_twist": move_by_twist,
            }
        return found

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Constant arrays of the controller by their names in C."""
        found = {
            "dqc_law_memory": self.law.memory,
            "dqc_law_state": self.law.initial_state(self.case.scene.start),
            "dqc_reference": self._reference,
        }
        if self.supervisor:
            found["dqc_supervisor_memory"] = self.supervisor[1].memory
        return found

    @property
    def _reference(self) -> Array:
        if self.is_at_rest:
            return self.samples[0]
        return self.samples.ravel() if self.path is None else self.path

    @cached_property
    def plan(self) -> NDArray[np.intp]:
        """The law's plan without addresses."""
        plan = self.law.plan.copy()
        plan[: len(self.law.stages)] = 0
        return plan

    @cached_property
    def starts(self) -> list[tuple[int, int]]:
        """Which numbers of the law's first state are which coordinates.

        Raises
        ------
        Error
            If the first state depends on the configuration in another way.
        """
        start, rng = self.case.scene.start, np.random.default_rng(0)
        q, other = start + 1e-6 * rng.uniform(-1.0, 1.0, (2, len(start)))
        first, second = self.law.initial_state(q), self.law.initial_state(other)
        found = []
        for i in np.flatnonzero(first != second):
            sources = np.flatnonzero((q == first[i]) & (other == second[i]))
            if len(sources) != 1:
                raise Error(
                    f"law: {self.case.names.law} computes its first state from the configuration; it cannot be exported"
                )
            found.append((int(i), int(sources[0])))
        return found

    def law_hash(self, target: TargetProcessor) -> str:
        """Return a hash of all that the library computes with."""
        digest = hashlib.sha256(target.name.encode())
        for symbol, kernel in self.kernels.items():
            module = kernel.function.__module__
            digest.update(f"{symbol} {module}.{kernel.__name__}".encode())
            digest.update(source_hash(module).encode())
        for name, array in self.numbers.items():
            digest.update(name.encode() + np.ascontiguousarray(array).tobytes())
        digest.update(self.plan.tobytes())
        for content in user_code.sources(msgspec.to_builtins(self.law_spec)):
            digest.update(content)
        return digest.hexdigest()[:16]


class _ComputedTarget(SampledTarget):
    """A reference that is computed once a period."""

    def __init__(self, parts: ControllerParts) -> None:
        super().__init__(parts.samples, parts.period)
        self._path, self._row = parts.path, np.zeros(SAMPLE_SIZE)

    def sample(self, time: float, pose: Array) -> Array:
        """Return the nearest sample."""
        row = min(max(self._index(time), 0), len(self._samples) - 1)
        computed_path(self._path, row * self._period, self._row)
        return self._row


def controller_parts(
    source: str | Path | dict[str, Any], law: str | None = None, *, computes: bool = False
) -> ControllerParts:
    """Return the parts of the controller that a spec describes; one that ``computes`` its reference where it can.

    Raises
    ------
    Error
        If something is missing, malformed or does not fit, or the spec describes several controllers and ``law`` does
        not say which.
    """
    setting = prepare(source)
    case = _chosen(setting, law)
    spec, robot = setting.spec, case.scene.robot
    if getattr(case.plant, "impedance", None) is not None:
        raise ValueRangeError(
            "plant.impedance: its torques are the plant's, and an exported controller gives none; leave it out for an "
            "arm with an impedance of its own, or give 'contact', which is exported, for one that follows positions"
        )
    prepared = case.prepare_law(spec).with_limits(case.limits)  # its own, with clean scratch memory
    refuse_replanning(prepared, case.scene.reference, "which no exported controller does")
    if not isinstance(prepared.kernel, Kernel):
        raise Error(
            f"law: {case.names.law or 'it'} does not compile, so it cannot be exported: {prepared.kernel.reason}"
        )
    for field in ("disturbance", "stop"):
        if getattr(spec, field) is not None:
            warnings.warn(
                f"{field}: belongs to simulation; the controller is exported without it",
                NoteWarning,
                stacklevel=3,
            )
    given = spec.supervisor_of(case.plant)
    supervisor = given.prepare(robot, spec.period, command_mode(case.plant)) if given else None
    both = (given, supervisor) if given and supervisor else None
    path = path_parameters(case.scene.reference) if computes else None
    return ControllerParts(setting, case, prepared, both, case.scene.samples, path)


def _label(setting: PreparedExperiment, case: Combination) -> str:
    """Return the law's label, with those of set, robot and plant where there are several."""
    spec, names = setting.spec, case.names
    plant = names.plant if len(spec.plant_by_label) > 1 else ""
    return " · ".join(name for name in (names.robot, names.law, names.set, plant) if name)


def _chosen(setting: PreparedExperiment, law: str | None) -> Combination:
    """Return the combination that a label names: of the law, or whole where that is not enough."""
    cases = setting.cases
    labels = [_label(setting, case) for case in cases]
    if law is None:
        if len(cases) > 1:
            raise ShapeError(
                f"law: {setting.spec.name} describes {len(cases)} controllers; choose one with --law: "
                f"{', '.join(map(repr, labels))}"
            )
        return next(iter(cases))
    chosen = [case for case, label in zip(cases, labels, strict=True) if law in (label, case.names.law)]
    if not chosen:
        raise unknown_name("law", law, {*labels, *(case.names.law for case in cases if case.names.law)})
    if len(chosen) > 1:
        several = ", ".join(repr(_label(setting, case)) for case in chosen)
        raise ValueRangeError(
            f"law: '{law}' has several parameter sets, robots or plants; choose one of {several}"
        )
    return chosen[0]


_MOST_GAIN = 1e6  # 1/s; at a period of 1 µs it is unstable already
_TRIED = (1.0, 0.75, 0.5)  # times the value, which the structure allows where it allows the value
_PROPORTIONAL = 1e-12  # rounding of a product of some factors
_OF_SUPERVISOR = ("velocity", "acceleration", "tracking_error")  # `Bounds` leave out "_error"


@dataclass(frozen=True)
class ChangedNumber:
    """A number that compiled code reads: offset + slope · value."""

    index: int
    offset: float
    slope: float


@dataclass(frozen=True)
class Changeable:
    """A parameter.

    Attributes
    ----------
    name
        As the spec has it.
    value
        As exported.
    least, most
        Bounds: of gains those of their keys; limits may only become tighter.
    of_supervisor
        Whether its numbers are the supervisor's, and so change only at rest.
    places
        What it changes.
    """

    name: str
    value: float
    least: float
    most: float
    of_supervisor: bool
    places: list[ChangedNumber]


def changeable_parameters(parts: ControllerParts) -> list[Changeable]:
    """Return all parameters of a controller that may be changed."""
    return [*_of_law(parts), *_of_supervisor(parts)]


def _of_law(parts: ControllerParts) -> Iterator[Changeable]:
    if not parts.takes_streams:  # its parameters depend on time
        return
    law, robot, period = parts.law_spec, parts.robot, parts.period
    sizes = [parts.plan_field(name) for name in prepared_memory.sizes]

    def rows(changed: Any) -> Array:
        return np.ravel(changed.rows(robot, parts.case.scene.reference, period))

    yield from _fields("law", law, rows, prepared_memory.place("parameters", *sizes), period)
    if law.null_space is not None:
        at = prepared_memory.place("preferring", *sizes)
        yield from _fields(
            "law.null_space", law.null_space, lambda changed: changed.parameters(robot), at, period
        )


def _fields(
    prefix: str, struct: Struct, numbers: Callable[[Any], Array], at: int, period: float
) -> Iterator[Changeable]:
    """Yield the numbers of a structure that stand alone in it and change what is prepared in proportion.

    A gain k (1/s) may be so large that k T = 1, where errors on ideal joints are gone after a period.
    """
    hints = get_type_hints(type(struct), include_extras=True)
    for field in struct.__struct_fields__:
        value = getattr(struct, field)
        if type(value) not in (float, int) or not value:
            continue
        places = _places(struct, field, float(value), numbers, at)
        if places:
            least, most = _bounds(hints[field])
            if field == "gain":
                most = max(min(most, 1.0 / period), float(value))
            yield Changeable(f"{prefix}.{field}", float(value), least, most, False, places)


def _places(
    struct: Struct, field: str, value: float, numbers: Callable[[Any], Array], at: int
) -> list[ChangedNumber]:
    try:
        tried = [numbers(msgspec.structs.replace(struct, **{field: share * value})) for share in _TRIED]
    except Error:
        return []
    first, second, third = tried
    if len({each.size for each in tried}) > 1:
        return []
    places = []
    for i in np.flatnonzero((first != second) | (first != third)):
        slope = (first[i] - second[i]) / (value * (_TRIED[0] - _TRIED[1]))
        foreseen = first[i] + slope * value * (_TRIED[2] - _TRIED[0])
        if not abs(foreseen - third[i]) <= _PROPORTIONAL * abs(first[i]):
            return []
        ratio = first[i] / value
        is_ratio = abs(slope - ratio) <= _PROPORTIONAL * abs(ratio)
        offset, slope = (0.0, ratio) if is_ratio else (first[i] - slope * value, slope)
        places.append(ChangedNumber(at + int(i), float(offset), float(slope)))
    return places


def _bounds(hint: Any) -> tuple[float, float]:
    """Return the bounds that a key of a spec has by its type."""
    metas = list(_metas(hint))
    least = max((meta.ge for meta in metas if meta.ge is not None), default=0.0)
    most = min((meta.le for meta in metas if meta.le is not None), default=_MOST_GAIN)
    return max(float(least), 0.0), min(float(most), _MOST_GAIN)


def _metas(hint: Any) -> Iterator[Meta]:
    yield from (meta for meta in getattr(hint, "__metadata__", ()) if isinstance(meta, Meta))
    for part in get_args(hint):
        yield from _metas(part)


def _of_supervisor(parts: ControllerParts) -> Iterator[Changeable]:
    """Yield the limits that each input has; they may become tighter than exported, and back."""
    if parts.supervisor is None or len(parts.robot.drives):
        return
    spec, prepared = parts.supervisor
    for field in _OF_SUPERVISOR:
        if field == "acceleration" and spec.jerk is not None:
            continue  # the window of smoothing depends on it
        for i, name in enumerate(parts.robot.input_names):
            index = layout.bounds_layout.place(field.removesuffix("_error"), prepared.sizes) + i
            value = float(prepared.memory[index])
            places = [ChangedNumber(index, 0.0, 1.0)]
            yield Changeable(f"supervisor.{field}.{name}", value, 1e-3 * value, value, True, places)
