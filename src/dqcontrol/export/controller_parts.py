"""Parts of a spec that become a library: kernels under their names in C, and the numbers that they work on."""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel
from dqcontrol.compiled.kernel_cache import source_hash
from dqcontrol.compiled.object_code import TargetProcessor
from dqcontrol.controller import Controller
from dqcontrol.controller.command_kernel import Plan, sent, step
from dqcontrol.errors import Error, NoteWarning, ShapeError, ValueRangeError, unknown_name
from dqcontrol.experiments.prepared_experiment import Combination, PreparedExperiment, prepare
from dqcontrol.export.own_code import own_law_kernel
from dqcontrol.extensions import user_code
from dqcontrol.laws import Law, OwnLaw
from dqcontrol.loop.replanning import refuse_replanning
from dqcontrol.loop.target_motion import move_by_twist, move_to_pose
from dqcontrol.loop.targets import SampledTarget, Target
from dqcontrol.plants.plant import CompiledPlant, command_mode, running_plant
from dqcontrol.references.computed_path import computed_path, path_parameters
from dqcontrol.references.sample import SAMPLE_SIZE, TIME
from dqcontrol.robots import Robot
from dqcontrol.robots.kinematics.kinematics_kernels import given, twist_kinematics
from dqcontrol.supervisor import PreparedSupervisor, Supervisor, supervisor_layout as layout
from dqcontrol.supervisor.supervisor_step import check_start, supervise


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

    @cached_property
    def plant(self) -> CompiledPlant | None:
        """The plant where the spec starts, if it is compiled; the noise of its first period is left out."""
        if self.case.plant.is_robot:
            return None
        started = self.case.plant.start(
            self.robot, self.case.scene.start, self.period, 1, self.setting.spec.seed
        )
        found = running_plant(started).compiled()
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
