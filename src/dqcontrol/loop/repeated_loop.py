"""The same loop again and again, with other laws: what does not change is made ready once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, Kernel
from dqcontrol.contact.contact_layout import WRENCH
from dqcontrol.controller.controller import Controller
from dqcontrol.errors import DivergedError, ValueRangeError
from dqcontrol.loop import rollout as compiled
from dqcontrol.loop.closed_loop import close_loop
from dqcontrol.loop.record import has_failed
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.simulate import supervise
from dqcontrol.loop.trace import FARTHEST
from dqcontrol.plants.disturbance import Disturbance
from dqcontrol.plants.plant import CompiledPlant, Plant, running_plant
from dqcontrol.robots.robot import Robot
from dqcontrol.supervisor import Supervisor


class RolloutView(NamedTuple):
    """What a loop saw, valid until it, or one with which it shares its records, runs again.

    Attributes
    ----------
    samples, q, measured, command
        As of a `Record`, one row a sample.
    failed
        Whether it diverged, or was stopped.
    readings
        What the plant sensed, by name; empty of compiled plants.
    """

    samples: Array
    q: Array
    measured: Array
    command: Array
    failed: bool
    readings: Mapping[str, Signal] = MappingProxyType({})


class RepeatedLoop:
    """A plant at its start and a desired motion, for many laws one after the other.

    Compiled plants without supervisor and disturbance start once: each run begins from a copy of their state, with the
    same noise. Results are those of `close_loop`, to the last bit.

    Parameters
    ----------
    robot, plant, start
        What moves, from where, shape (n,), rad or m.
    period
        T, s.
    samples
        Desired motion, one row a period, shape (N, 21), inertial frame.
    seed
        Of the noise.
    supervisor, disturbance
        What stands between law and plant, and what moves the end effector beside the commands.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.loop.repeated_loop import RepeatedLoop
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> samples = dqc.references.SetPoint(arm.fkm(q + 0.1)).samples(0.01 * np.arange(100))
    >>> loop = RepeatedLoop(arm, dqc.plants.Integrator(), q, 0.01, samples, seed=0)
    >>> laws = [dqc.laws.Proportional(gain=gain).prepare(arm, None, 0.01) for gain in (1.0, 5.0)]
    >>> ends = [loop.run(law).q[-1].copy() for law in laws]
    >>> bool(np.abs(ends[0] - q - 0.1).max() > np.abs(ends[1] - q - 0.1).max())
    True
    """

    def __init__(
        self,
        robot: Robot,
        plant: Plant,
        start: Array,
        period: float,
        samples: Array,
        *,
        seed: int,
        supervisor: Supervisor | None = None,
        disturbance: Disturbance | None = None,
    ) -> None:
        self.robot = robot
        self.plant = plant
        self.start = start
        self.period = period
        self.samples: Array = np.ascontiguousarray(samples)
        self._seed, self._supervisor, self._disturbance = seed, supervisor, disturbance
        if plant.is_robot:
            kind = type(plant).__struct_config__.tag
            raise ValueRangeError(
                f"plant: '{kind}' is a robot, and a search would run it many times; search on a simulated one, as a "
                "servo that dqcontrol identify found"
            )
        live = running_plant(plant.start(robot, start, period, len(samples), seed))
        ready = live.compiled()
        is_free = supervisor is None and disturbance is None
        self._compiled = ready if ready is not None and is_free and isinstance(ready.kernel, Kernel) else None
        if self._compiled is not None:
            self._begin(self._compiled)

    def _begin(self, plant: CompiledPlant) -> None:
        count, n, m = len(self.samples), self.robot.configuration_size, self.robot.input_size
        assert isinstance(plant.kernel, Kernel)
        self._first = [each.copy() for each in (plant.state, plant.q, plant.measured)]
        self._kept = plant.state, plant.q, plant.measured
        self._done = np.zeros(1)
        self._records = np.empty((count, n)), np.empty((count, n)), np.empty((count, m))
        self._stages = compiled.stages(
            kinematics=self.robot.kernels.twist_kinematics.pointer,
            supervisor=0,
            disturbance=0,
            plant=plant.kernel.pointer,
            settled=0,
        )
        self._moved = compiled.plant_arrays(
            parameters=plant.parameters,
            state=plant.state,
            noise=plant.noise,
            q=plant.q,
            measured=plant.measured,
            wrench=plant.wrench if plant.wrench.size else np.full(WRENCH, np.nan),
            readings=np.zeros(0),
        )
        self._course = compiled.course(
            samples=self.samples, stop=np.zeros(2), done=self._done, settling=np.zeros(9)
        )
        self._written: dict[int, compiled.Records] = {}

    def _records_of(self, report: int) -> compiled.Records:
        """Return where a run is written whose law reports that many numbers a sample."""
        if report not in self._written:
            count = len(self.samples)
            arrays = *self._records, np.empty((count, report)), np.empty((count, 0))
            self._written[report] = compiled.records(
                **dict(zip(compiled.Records._fields, arrays, strict=True))
            )
        return self._written[report]

    def run(self, law: Controller) -> RolloutView:
        """Run the loop with a law that was prepared for this robot and period."""
        if self._compiled is None or not isinstance(law.kernel, Kernel):
            return self._close_loop(law)
        for kept, first in zip(self._kept, self._first, strict=True):
            kept[:] = first
        arrays = compiled.law_arrays(plan=law.plan, memory=law.memory, state=law.initial_state(self.start))
        status = compiled.rollout(
            self._stages,
            arrays,
            compiled.UNSUPERVISED,
            compiled.UNDISTURBED,
            self._moved,
            self._course,
            self._records_of(law.report.size),
        )
        done = int(self._done[0])
        q, measured, command = (record[:done] for record in self._records)
        lost = status != OK or max(q.max(), -q.min()) > FARTHEST
        return RolloutView(self.samples[:done], q, measured, command, lost)

    def _close_loop(self, law: Controller) -> RolloutView:
        supervision = (
            supervise(self._supervisor, law, self.plant, self.start) if self._supervisor is not None else None
        )
        disturbance = self._disturbance
        try:
            trace = close_loop(
                law,
                self.plant.start(self.robot, self.start, self.period, len(self.samples), self._seed),
                self.samples,
                disturbance=disturbance
                and disturbance.start(self.robot, self.period, len(self.samples), self._seed),
                supervision=supervision,
            )
        except DivergedError:
            empty = np.zeros((0, self.robot.configuration_size))
            return RolloutView(self.samples[:0], empty, empty, np.zeros((0, self.robot.input_size)), True)
        failed = has_failed(trace.stopped)
        return RolloutView(trace.desired, trace.q, trace.measured, trace.command, failed, trace.readings)


def share_records(loops: Sequence[RepeatedLoop]) -> None:
    """Let loops of one robot that run one after the other write into the same memory, which then stays in caches."""
    loops = [loop for loop in loops if loop._compiled is not None]
    if not loops:
        return
    longest = max(loops, key=lambda loop: len(loop.samples))._records
    for loop in loops:
        q, measured, command = (each[: len(loop.samples)] for each in longest)
        loop._records = q, measured, command
        loop._written = {}
