"""The closed loop: compiled where law and plant are, interpreted otherwise, with equal results."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compiled.compile import Kernel
from dqcontrol.errors import DivergedError, Error, ShapeError, ValueRangeError, as_array
from dqcontrol.laws.law import PreparedLaw, status_text
from dqcontrol.limits.supervisor.prepared_supervisor import STOP
from dqcontrol.limits.supervisor.supervisor_step import supervise
from dqcontrol.loop import rollout as compiled
from dqcontrol.loop.clock import Clock
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.record import has_failed
from dqcontrol.loop.sample_sink import SampleSink
from dqcontrol.loop.signals import Readings, Signal, foreseen_signals
from dqcontrol.loop.supervision import Supervision
from dqcontrol.loop.trace import Stop, Trace, empty_records, ended
from dqcontrol.plants.disturbance_step import ROW, LiveDisturbance
from dqcontrol.plants.plant import AgedPlant, CompiledPlant, GuardedPlant, LivePlant
from dqcontrol.references.sample import POSE, SAMPLE_SIZE
from dqcontrol.robots import kinematics_kernels as kernels

Array = NDArray[np.float64]
_PROGRESS_EVERY = 50  # steps
_LOST = "the measured configuration is not finite"


def close_loop(
    law: PreparedLaw,
    plant: LivePlant,
    samples: Array,
    stop: Stop | None = None,
    *,
    disturbance: LiveDisturbance | None = None,
    interpreted: bool = False,
    progress: Callable[[int, int], None] | None = None,
    clock: Clock | None = None,
    supervision: Supervision | None = None,
    recording: SampleSink | None = None,
) -> Trace:
    """Drive a plant along samples with a law.

    Parameters
    ----------
    law
        From ``law.prepare``.
    plant
        From ``plant.start``; it is moved.
    samples
        Desired motion, one row a period, shape (N, 21), inertial frame.
    stop
        When to end early.
    disturbance
        From ``disturbance.start``; moves the joints before each step of the plant.
    interpreted
        True: step in Python even if all parts are compiled; the result is the same to the last bit.
    progress
        Called with steps done and steps in all.
    clock
        Paces the loop in real time, one step a period of the law; it is then interpreted, and the clock measures it.
        With supervision, the first interrupt (Ctrl-C) stops softly.
    supervision
        What stands between law and plant. A command or measurement that is not finite then ends nothing: it brakes.
    recording
        Gets every sample at once; the loop is then interpreted, and ends, braking if it can, when it cannot be written.

    Returns
    -------
    Trace
        Configurations before, and command at, each sample done. A run that leaves the finite numbers ends there and
        says so in ``stopped``; so does one that the supervisor halted, and one whose plant switched its motors off.

    Raises
    ------
    ShapeError
        If law, plant and samples do not fit together.
    Error
        If there is a disturbance and the plant does not let it move the joints.
    """
    n = law.robot.configuration_size
    if np.shape(plant.q) != (n,):
        raise ShapeError(f"plant: expected {n} joints, as the law, got shape {np.shape(plant.q)}")
    samples = np.ascontiguousarray(as_array("samples", samples, (SAMPLE_SIZE,)))
    if samples.ndim != 2:
        raise ShapeError(f"samples: expected shape (N, {SAMPLE_SIZE}), got {samples.shape}")
    if isinstance(plant, CompiledPlant) and len(plant.noise) < len(samples):
        raise ShapeError(f"plant: was started for {len(plant.noise)} periods, got {len(samples)} samples")
    if disturbance is not None:
        check_disturbed(plant)
        if len(disturbance.rows) < len(samples):
            raise ShapeError(
                f"disturbance: was started for {len(disturbance.rows)} periods, got {len(samples)} samples"
            )
    if supervision is not None:
        supervision.begin(len(samples))
        _ = supervise.pointer  # compiled now, not while the robot moves
    if clock is not None:
        _warm_up(law, plant, samples, disturbance)
        asked = first_interrupt(supervision.end) if supervision else nullcontext()
        with asked, clock.running(law.dt, len(samples)):
            return _interpret(law, plant, samples, stop, disturbance, progress, clock, supervision, recording)
    if not interpreted and not recording and isinstance(plant, CompiledPlant):
        law_kernel, plant_kernel = law.kernel, plant.kernel
        if isinstance(law_kernel, Kernel) and isinstance(plant_kernel, Kernel):
            trace = _rollout(law, plant, plant_kernel.pointer, samples, stop, disturbance, supervision)
            return _with_signals(trace, foreseen_signals(plant, len(trace.q)), supervision)
    return _interpret(law, plant, samples, stop, disturbance, progress, None, supervision, recording)


def check_disturbed(plant: LivePlant) -> None:
    """Raise an `Error` if a disturbance cannot move this plant's joints."""
    if not isinstance(plant, CompiledPlant):
        raise Error(
            f"disturbance: cannot move the joints of {type(plant).__name__}, whose physics moves them; "
            "use integrator, servo or own as plant"
        )


def _stop_array(stop: Stop | None) -> Array:
    return np.array([stop.error, float(stop.samples)]) if stop else np.zeros(2)


def _rollout(
    law: PreparedLaw,
    plant: CompiledPlant,
    plant_pointer: int,
    samples: Array,
    stop: Stop | None,
    disturbance: LiveDisturbance | None,
    supervision: Supervision | None,
) -> Trace:
    none = np.zeros(0)
    records = empty_records(law, samples)
    realised = np.zeros((len(samples) if disturbance else 1, 6))
    steps = np.zeros(10)
    status = compiled.rollout(
        kernels.twist_kinematics.pointer,
        supervise.pointer if supervision else 0,
        disturbance.kernel.pointer if disturbance else 0,
        plant_pointer,
        compiled.settled.pointer if stop else 0,
        law.robot.chain,
        law.plan,
        law.memory,
        law.initial_state(plant.q),
        supervision.supervisor.parameters if supervision else none,
        supervision.state if supervision else none,
        supervision.supervisor.work if supervision else none,
        supervision.codes if supervision else none,
        disturbance.rows if disturbance else np.zeros((0, ROW)),
        disturbance.parameters if disturbance else none,
        disturbance.work if disturbance else none,
        plant.parameters,
        plant.state,
        plant.noise,
        plant.q,
        plant.measured,
        samples,
        _stop_array(stop),
        *records,
        realised,
        steps,
    )
    failure, halted = None, ""
    if status == compiled.HALTED and supervision:
        halted = supervision.why(int(steps[0]))
    elif status >= compiled.PLANT_FAILED:
        failure = "the plant left the finite numbers"
        steps[0] -= 1
    elif status >= compiled.LAW_FAILED:
        failure = status_text(status - compiled.LAW_FAILED)
    elif status:
        failure = _LOST
    return ended(int(steps[0]), samples, records, realised if disturbance else None, failure, halted)


def _interpret(
    law: PreparedLaw,
    plant: LivePlant,
    samples: Array,
    stop: Stop | None,
    disturbance: LiveDisturbance | None,
    progress: Callable[[int, int], None] | None,
    clock: Clock | None,
    supervision: Supervision | None,
    recording: SampleSink | None,
) -> Trace:
    records = empty_records(law, samples)
    q, measured, command = records
    realised = np.zeros((len(samples), 6)) if disturbance else None
    state, stop_values, count = law.initial_state(plant.q), _stop_array(stop), np.zeros(9)
    done, failure, fault, halted = 0, None, "", ""
    readings = Readings(plant, len(samples))
    guarded = plant if isinstance(plant, GuardedPlant) else None
    aged = plant if isinstance(plant, AgedPlant) else None
    for k, row in enumerate(samples):
        if clock and not clock.await_step():
            halted = clock.overran
            break
        q[k], measured[k] = plant.q, plant.measured
        readings.take(k)
        try:
            failure = _ask(law, plant.measured, row, k, state, command[k])
            if failure and supervision is None:
                break
            done = k + 1
            if supervision and supervision.step(
                k, row[-1], measured[k], command[k], aged.age if aged else 0.0
            ):
                lost = recording.failure if recording else ""
                halted, failure = lost or supervision.why(done), None
            if recording:
                code = supervision.codes[k] if supervision else 0.0
                recording.take(row, q[k], measured[k], command[k], code)
                if recording.failure and supervision:
                    supervision.request = STOP
                elif recording.failure:
                    halted = recording.failure
            if clock:
                clock.commanded()
            if halted:
                break
            if stop and not failure and compiled.settled(law.pose, row[POSE], stop_values, count):
                break
            failure = None
            if disturbance is not None and realised is not None:
                disturbance.step(law.robot.chain, k, plant.q, realised[k])
            plant.step(command[k])
            if guarded and not fault and guarded.fault:
                fault = f"faulted at {row[-1]:g} s: {guarded.fault}"
        except DivergedError as error:
            done, failure = k, str(error)
            break
        if progress and done % _PROGRESS_EVERY == 0:
            progress(done, len(samples))
    trace = ended(done, samples, records, realised, failure, halted)
    stopped = fault if fault and not has_failed(trace.stopped) else trace.stopped
    return _with_signals(replace(trace, stopped=stopped), readings.signals(len(trace.q)), supervision)


def _ask(law: PreparedLaw, measured: Array, row: Array, k: int, state: Array, command: Array) -> str | None:
    """Write what the law says; say why it cannot, and write NaN."""
    try:
        law.step(measured, row, k, state, command)
    except DivergedError as error:
        failure = str(error)
    except ValueRangeError:
        if np.isfinite(measured).all():
            raise
        failure = _LOST
    else:
        return None
    command[:] = np.nan
    return failure


def _with_signals(trace: Trace, readings: dict[str, Signal], supervision: Supervision | None) -> Trace:
    done = supervision.signals(len(trace.q)) if supervision else {}
    return replace(trace, readings=readings | done)


def _warm_up(law: PreparedLaw, plant: LivePlant, samples: Array, disturbance: LiveDisturbance | None) -> None:
    """Compile what the loop calls, so that its first steps are as fast as the others."""
    for kernel in (compiled.settled, getattr(plant, "kernel", None), getattr(disturbance, "kernel", None)):
        if isinstance(kernel, Kernel):
            _ = kernel.pointer
    if isinstance(law.kernel, Kernel):
        with suppress(DivergedError, ValueRangeError):  # the loop will say so
            for row in samples[:1]:
                law.step(plant.measured, row, 0, law.initial_state(plant.q), np.empty(law.robot.input_size))
