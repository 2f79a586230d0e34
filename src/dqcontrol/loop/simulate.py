"""A run from objects: robot, reference, law and plant; once, or again and again with other laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, Kernel
from dqcontrol.controller.controller import Controller
from dqcontrol.controller.task_levels import FurtherTask, PreparedTasks
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws.law import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop import rollout as compiled
from dqcontrol.loop.clock import Clock
from dqcontrol.loop.closed_loop import FARTHEST, SampleSink, Stop, close_loop
from dqcontrol.loop.record import Record, has_failed
from dqcontrol.loop.replanning import Replanning, plan_signals, refuse_replanning
from dqcontrol.loop.signals import Signal, actuator_command, constraint_signals, held_signals, task_errors
from dqcontrol.loop.supervision import BlackBox, Supervision, Watch
from dqcontrol.plants.disturbance import Disturbance
from dqcontrol.plants.plant import (
    CompiledPlant,
    Plant,
    command_mode,
    lagging_mode,
    limits_before,
    running_plant,
)
from dqcontrol.references import Reference
from dqcontrol.references.modifiers import follow_in
from dqcontrol.robots.robot import Robot
from dqcontrol.supervisor import Supervisor

_MOST_STEPS = 10_000_000  # as of a reference, see `laws.law`


def simulate(
    robot: Robot,
    reference: Reference,
    law: Law,
    plant: Plant,
    start: ArrayLike,
    period: float,
    duration: float | None = None,
    *,
    limits: CommandLimits | None = None,
    stop: Stop | None = None,
    disturbance: Disturbance | None = None,
    supervisor: Supervisor | None = None,
    seed: int = 0,
    tasks: Sequence[FurtherTask] = (),
    interpreted: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Record:
    """Drive a plant along a reference with a law and record it.

    Parameters
    ----------
    robot
        An arm or a whole body.
    reference
        The desired motion.
    law, plant
        What commands and what moves.
    start
        Start configuration, shape (n,), rad or m; it may lie outside the joint limits, as in specs it may not: a robot
        may have been left there, and position limits bring it back.
    period
        T, control period, s.
    duration
        s; as long as the reference if omitted.
    limits
        What is done to commands before they leave; see `dqcontrol.plants.limits_before`.
    stop
        When to end early.
    disturbance
        What moves the end effector beside the commands; not for physics.
    supervisor
        What stands between law and plant; nothing if omitted.
    seed
        Of the plant's noise and the disturbance.
    tasks
        What two arms or another tree are to do beside the law's task; see `controller.FurtherTask`.
    interpreted
        True: step in Python even if all parts are compiled; the result is the same to the last bit.
    progress
        Called with steps done and steps in all.

    Returns
    -------
    Record
        All samples; one that diverged holds those before, and says so.

    Raises
    ------
    Error
        If something does not fit, or the very first command fails.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), [0, 0.6, 0, 1.6, 0, 0.6, 0]
    >>> circle = dqc.references.Circle(arm.fkm(q), radius=0.05, duration=4.0)
    >>> law, plant = dqc.laws.ProportionalFeedforward(gain=10.0), dqc.plants.Servo()
    >>> record = dqc.simulate(arm, circle, law, plant, q, period=0.01)
    >>> bool(record.position_error.max() < 0.005)
    True
    """
    for field, value, kind in (
        ("robot", robot, Robot),
        ("reference", reference, Reference),
        ("law", law, Law),
        ("plant", plant, Plant),
    ):
        if not isinstance(value, kind):
            raise ShapeError(f"{field}: expected a {kind.__name__}, got {value!r:.80}")
    period = as_positive("period", period)
    start = as_array("start", start, (robot.configuration_size,))
    robot = robot.from_start(start)
    times = period * np.arange(step_count(reference, period, duration), dtype=np.float64)
    samples = reference.samples(times)
    further = PreparedTasks(robot, list(tasks), start, times) if tasks else None
    before, mode = limits_before(plant, limits, robot), lagging_mode(plant)
    return simulate_prepared(
        law.prepare(robot, reference, period, before, mode, further, plant.lag(robot)),
        plant,
        start,
        samples,
        stop=stop,
        disturbance=disturbance,
        supervisor=supervisor,
        seed=seed,
        interpreted=interpreted,
        progress=progress,
        reference=reference,
        lasts=duration is None,
    )


def simulate_prepared(
    law: Controller,
    plant: Plant,
    start: Array,
    samples: Array,
    *,
    stop: Stop | None = None,
    disturbance: Disturbance | None = None,
    supervisor: Supervisor | None = None,
    seed: int = 0,
    interpreted: bool = False,
    progress: Callable[[int, int], None] | None = None,
    clock: Clock | None = None,
    recording: Callable[[], SampleSink] | None = None,
    watch: Watch | None = None,
    black_box: BlackBox | None = None,
    reference: Reference | None = None,
    lasts: bool = False,
) -> Record:
    """Drive a plant along samples (N, 21) with a law made ready; what `simulate` does after its preparation.

    Parameters
    ----------
    recording
        Begins what takes each sample, once the plant has started: a robot that is not there leaves nothing behind.
    reference
        Of which the samples are; one that changes while the robot moves needs it.
    lasts
        Whether the run lasts as long as such a reference, not as long as its samples.

    Raises
    ------
    DivergedError
        If the very first command fails.
    """
    robot = law.robot
    replanning = Replanning.of(law, reference, lasts=lasts)
    if replanning is not None:
        if clock is not None:
            refuse_replanning(law, reference, "which takes time that a run in real time has not")
        samples = replanning.with_room(samples)
    if plant.is_robot:
        clock = clock or Clock(overrun="skip")
        supervisor = supervisor or Supervisor()
    supervision = supervisor and supervise(supervisor, law, plant, start, watch, black_box)
    started = plant.start(robot, start, law.period, len(samples), seed)
    trace = close_loop(
        law,
        started,
        samples,
        stop,
        disturbance=disturbance and disturbance.start(robot, law.period, len(samples), seed),
        interpreted=interpreted,
        progress=progress,
        clock=clock,
        supervision=supervision,
        recording=recording and recording(),
        follow=follow_in(reference),
        replanning=replanning,
    )
    if not len(trace.q):
        raise DivergedError(trace.stopped)
    done = trace.desired
    return Record(
        time=done[:, -1],
        q=trace.q,
        measured=trace.measured,
        command=trace.command,
        pose=row_by_row(robot.fkm, trace.q),
        desired=done,
        joint_names=robot.joint_names,
        input_names=robot.input_names,
        stopped=trace.stopped,
        disturbance=trace.disturbance,
        readings=trace.readings
        | actuator_command(robot, trace.q, trace.command)
        | task_errors(law, trace.q)
        | constraint_signals(law, trace.q, done[:, -1], trace.kept)
        | held_signals(law, trace.q, done[:, -1], trace.readings)
        | plan_signals(reference, replanning, done[:, -1]),
    )


def supervise(
    supervisor: Supervisor,
    law: Controller,
    plant: Plant,
    start: Array,
    watch: Watch | None = None,
    black_box: BlackBox | None = None,
) -> Supervision:
    """Return a supervisor at work between a law and a plant that starts at rest, shape (n,), rad or m.

    Raises
    ------
    Error
        If a parameter is not allowed, or the robot starts outside its bounds.
    """
    prepared = supervisor.prepare(law.robot, law.period, command_mode(plant))
    return Supervision(prepared, start, watch, black_box)


def step_count(reference: Reference, period: float, duration: float | None) -> int:
    """Return the number of samples of a run, the last at its end.

    Raises
    ------
    ValueRangeError
        If the duration is not finite, shorter than a period, or absurdly long.
    """
    seconds = duration if duration is not None else reference.duration
    if not np.isfinite(seconds):
        raise ValueRangeError("duration: a set-point has no duration; give 'duration'")
    if not seconds / period < _MOST_STEPS:
        raise ValueRangeError(
            f"duration: {seconds:g} s are {seconds / period:.9g} periods; at most 10 million"
        )
    steps = round(seconds / period) + 1
    if steps < 2:
        raise ValueRangeError(
            f"duration: {seconds:g} s is shorter than one period of {period:g} s{_slip(period)}"
        )
    return steps


def _slip(period: float) -> str:
    """Return a hint for a period that looks like milliseconds."""
    return f"; milliseconds? Write {period:g} ms" if period >= 1 else ""


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


@dataclass(eq=False)
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
    >>> from dqcontrol.loop.simulate import RepeatedLoop
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> samples = dqc.references.SetPoint(arm.fkm(q + 0.1)).samples(0.01 * np.arange(100))
    >>> loop = RepeatedLoop(arm, dqc.plants.Integrator(), q, 0.01, samples, seed=0)
    >>> laws = [dqc.laws.Proportional(gain=gain).prepare(arm, None, 0.01) for gain in (1.0, 5.0)]
    >>> ends = [loop.run(law).q[-1].copy() for law in laws]
    >>> bool(np.abs(ends[0] - q - 0.1).max() > np.abs(ends[1] - q - 0.1).max())
    True
    """

    robot: Robot
    plant: Plant
    start: Array
    period: float
    samples: Array
    _: KW_ONLY
    seed: int
    supervisor: Supervisor | None = None
    disturbance: Disturbance | None = None

    def __post_init__(self) -> None:
        plant, self.samples = self.plant, np.ascontiguousarray(self.samples)
        if plant.is_robot:
            kind = type(plant).__struct_config__.tag
            raise ValueRangeError(
                f"plant: '{kind}' is a robot, and a search would run it many times; search on a simulated one, as a "
                "servo that dqcontrol identify found"
            )
        periods = self.period, len(self.samples), self.seed
        ready = running_plant(plant.start(self.robot, self.start, *periods)).compiled()
        is_free = self.supervisor is None and self.disturbance is None
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
            plant=plant.kernel.pointer,
            supervisor=0,
            disturbance=0,
            settled=0,
        )
        self._moved = compiled.moved_plant(plant)
        self._course = compiled.course(
            samples=self.samples, done=self._done, stop=np.zeros(2), settling=np.zeros(9)
        )
        self._written: dict[int, compiled.Records] = {}

    def _records_of(self, report: int) -> compiled.Records:
        """Return where a run is written whose law reports that many numbers a sample."""
        if report not in self._written:
            count = len(self.samples)
            arrays = *self._records, np.empty((count, report)), np.empty((count, 0))
            self._written[report] = compiled.Records(*arrays)
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
        supervisor, disturbance = self.supervisor, self.disturbance
        supervision = supervisor and supervise(supervisor, law, self.plant, self.start)
        periods = self.period, len(self.samples), self.seed
        moved = disturbance and disturbance.start(self.robot, *periods)
        try:
            plant = self.plant.start(self.robot, self.start, *periods)
            trace = close_loop(law, plant, self.samples, disturbance=moved, supervision=supervision)
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
