"""A run from objects: robot, reference, law and plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.controller.controller import Controller
from dqcontrol.controller.task_levels import FurtherTask, PreparedTasks
from dqcontrol.errors import DivergedError, ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws.law import Law
from dqcontrol.limits import CommandLimits
from dqcontrol.loop.clock import Clock
from dqcontrol.loop.closed_loop import close_loop
from dqcontrol.loop.constraint_signals import constraint_signals, held_signals
from dqcontrol.loop.record import Record
from dqcontrol.loop.replanning import Replanning, plan_signals, refuse_replanning
from dqcontrol.loop.signals import actuator_command, task_errors
from dqcontrol.loop.supervision import BlackBox, Supervision, Watch
from dqcontrol.loop.trace import SampleSink, Stop
from dqcontrol.plants.disturbance import Disturbance
from dqcontrol.plants.plant import Plant, command_mode, lagging_mode, limits_before
from dqcontrol.references import Reference
from dqcontrol.references.follow import follow_in
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
    q0 = as_array("start", start, (robot.configuration_size,))
    robot = robot.from_start(q0)
    times = period * np.arange(step_count(reference, period, duration), dtype=np.float64)
    samples = reference.samples(times)
    further = PreparedTasks(robot, list(tasks), q0, times) if tasks else None
    return simulate_prepared(
        law.prepare(
            robot,
            reference,
            period,
            limits_before(plant, limits, robot),
            lagging_mode(plant),
            further,
            plant.lag(robot),
        ),
        plant,
        q0,
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
