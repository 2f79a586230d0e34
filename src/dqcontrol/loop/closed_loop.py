"""The closed loop: compiled where law and plant are, interpreted otherwise, with equal results."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from typing import Annotated, Protocol

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, Kernel
from dqcontrol.contact.admittance import NEEDS_CONTACT
from dqcontrol.controller.controller import Controller, status_text
from dqcontrol.errors import DivergedError, Error, FallenError, ShapeError, ValueRangeError, as_array
from dqcontrol.files.long_array import long_array
from dqcontrol.loop import rollout as compiled
from dqcontrol.loop.clock import Clock
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.record import has_failed
from dqcontrol.loop.replanning import Replanning
from dqcontrol.loop.signals import Readings, Signal
from dqcontrol.loop.supervision import Senses, Supervision, most_steps_to_rest
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.disturbance import RunningDisturbance
from dqcontrol.plants.plant import CompiledPlant, PlantProtocol, RunningPlant, running_plant
from dqcontrol.references.modifiers import Follow
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TIME, TWIST, TWIST_RATE
from dqcontrol.supervisor.supervisor_layout import GO, moment_layout

_PROGRESS_EVERY = 50  # steps
_SUPERVISOR = "the supervisor"
_LOST = "the measured configuration is not finite"


class SampleSink(Protocol):
    """Takes samples one by one and returns at once; `dqcontrol.recording.RecordStream` is one.

    Attributes
    ----------
    failure
        Why samples are lost, empty while none is: the loop then stops the robot.
    """

    failure: str

    def take(
        self, sample: Array, q: Array, measured: Array, command: Array, interventions: float = 0.0
    ) -> None:
        """Take one sample.

        Parameters
        ----------
        sample
            As of ``Sample.data``, shape (21,); the time increases.
        q, measured
            True and measured configuration, shape (n,), rad or m.
        command
            Inputs after all limits, shape (m,), rad/s or m/s.
        interventions
            Code of the supervisor.
        """
        ...


FARTHEST = 1e4  # rad or m: no robot goes there


class Stop(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """End a run early, once the error norm has stayed below a tolerance."""

    error: Annotated[float, Meta(gt=0, description="|vec8(1 − x*x_d)|")]
    samples: Annotated[int, Meta(ge=1, description="consecutive samples")] = 50


@dataclass(frozen=True)
class Trace:
    """What the loop saw at each sample, and why it ended.

    With a supervisor the last samples are those in which the robot came to rest: what is desired rests there too.
    """

    q: Array
    measured: Array
    command: Array
    stopped: str
    desired: Array
    disturbance: Array | None = None  # inertial twist, shape (done, 6)
    readings: dict[str, Signal] = field(default_factory=dict)  # what else the plant sensed
    kept: Array | None = None  # reports of the law's constraints


def close_loop(
    law: Controller,
    plant: PlantProtocol,
    samples: Array,
    stop: Stop | None = None,
    *,
    disturbance: RunningDisturbance | None = None,
    interpreted: bool = False,
    progress: Callable[[int, int], None] | None = None,
    clock: Clock | None = None,
    supervision: Supervision | None = None,
    recording: SampleSink | None = None,
    follow: Follow | None = None,
    replanning: Replanning | None = None,
) -> Trace:
    """Drive a plant along samples with a law.

    Parameters
    ----------
    law
        From ``law.prepare``.
    plant
        From ``plant.start``, or a robot of your own: anything that has what `PlantProtocol` has, and as much of
        `RunningPlant` as it can. It is moved.
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
        Whatever ends the loop, an exception of law or plant and a second interrupt among it, the robot is first brought
        to rest within the supervisor's limits, and an exception raised only then.
    recording
        Gets every sample at once; the loop is then interpreted, and ends, braking if it can, when it cannot be written.
    follow
        Displaces the samples to where its body is measured.
    replanning
        Plans where constraints hold the robot, and replaces samples and law by what leads along its plan; the loop is
        then interpreted.

    Returns
    -------
    Trace
        Configurations before, and command at, each sample done; with supervision until the robot rests. A run that
        produces NaN or infinity ends there and says so in ``stopped``; so does one that the supervisor halted, and one
        whose plant switched its motors off.

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
    live = running_plant(plant)
    if live.periods < len(samples):
        raise ShapeError(f"plant: was started for {live.periods} periods, got {len(samples)} samples")
    if disturbance is not None:
        check_disturbed(plant)
        if len(disturbance.rows) < len(samples):
            raise ShapeError(
                f"disturbance: was started for {len(disturbance.rows)} periods, got {len(samples)} samples"
            )
    if supervision is not None:
        _ = supervision.supervisor.kernel.pointer  # compiled now, not while the robot moves
    if law.is_guarded and not law.wrench.size:
        raise ValueRangeError(NEEDS_CONTACT)
    if law.wrench.size and not live.wrench.size:
        raise ValueRangeError(
            f"contact: {type(plant).__name__} measures no wrench, so no force can be controlled; "
            "take a plant with a force sensor"
        )
    if follow is not None:
        if follow.body not in live.seen:
            raise ValueRangeError(
                f"reference.body: nothing measures '{follow.body}' here; its 'watch' needs a plant that moves it"
            )
        samples = samples.copy()
    steps = _Steps(law, plant, samples, disturbance, clock, supervision, recording, follow, replanning)
    if clock is not None:
        _warm_up(law, live, samples, disturbance)
        asked = first_interrupt(supervision.end) if supervision else nullcontext()
        with asked, clock.running(law.period, len(steps.desired)):
            return steps.run(stop, progress)
    compiled_plant = None if interpreted or recording or replanning else live.compiled()
    if compiled_plant is not None:
        law_kernel, plant_kernel = law.kernel, compiled_plant.kernel
        if isinstance(law_kernel, Kernel) and isinstance(plant_kernel, Kernel):
            return _rollout(steps, compiled_plant, plant_kernel.pointer, stop)
    return steps.run(stop, progress)


def check_disturbed(plant: PlantProtocol) -> None:
    """Raise an `Error` if a disturbance cannot move this plant's joints."""
    if running_plant(plant).compiled() is None:
        raise Error(
            f"disturbance: cannot move the joints of {type(plant).__name__}, whose physics moves them; "
            "use integrator, servo or own as plant"
        )


def _stop_array(stop: Stop | None) -> Array:
    return np.array([stop.error, float(stop.samples)]) if stop else np.zeros(2)


def _rollout(steps: _Steps, plant: CompiledPlant, plant_pointer: int, stop: Stop | None) -> Trace:
    """Run the steps compiled; only coming to rest is interpreted."""
    law, samples, supervision, disturbance = steps.law, steps.samples, steps.supervision, steps.disturbance
    count = len(steps.samples)
    done, settling = np.zeros(3), np.zeros(9)
    supervised, disturbed = compiled.UNSUPERVISED, compiled.UNDISTURBED
    if supervision:
        supervised = compiled.supervisor_arrays(
            memory=supervision.supervisor.memory,
            moment=moment_layout.pack(age=0.0, elapsed=supervision.period, request=GO, known=0.0, still=0.0),
            state=supervision.state,
            codes=supervision.codes[:count],
        )
    if disturbance:
        given = {"rows": disturbance.rows, "parameters": disturbance.parameters, "work": disturbance.work}
        disturbed = compiled.disturbance_arrays(**given, realised=steps.realised[:count])
    status = compiled.rollout(
        compiled.stages(
            kinematics=law.robot.kernels.twist_kinematics.pointer,
            supervisor=supervision.supervisor.kernel.pointer if supervision else 0,
            disturbance=disturbance.kernel.pointer if disturbance else 0,
            plant=plant_pointer,
            settled=compiled.settled.pointer if stop else 0,
        ),
        compiled.law_arrays(plan=law.plan, memory=law.memory, state=steps.law_state),
        supervised,
        disturbed,
        compiled.moved_plant(plant),
        compiled.course(samples=samples, stop=_stop_array(stop), done=done, settling=settling),
        compiled.Records(*(each[:count] for each in (*steps.records, steps.readings.rows))),
    )
    failure, halted, steps.done = None, "", int(done[0])
    finished = "duration" if steps.done == count else "settled"
    steps.was_sent = status == OK and not (stop and settling[0] >= stop.samples)
    if status == compiled.HALTED:
        halted, steps.at_rest = _SUPERVISOR, True
    elif status >= compiled.PLANT_FAILED:
        steps.done -= 1
        command = steps.records[2][steps.done]
        failure = plant.failure(status - compiled.PLANT_FAILED, command, steps.done)
    elif status >= compiled.LAW_FAILED:
        failure = steps.law_failure(steps.done, status)
    elif status:
        failure = _LOST
    if done[1]:
        steps.unanswered = steps.law_failure(int(done[1]) - 1, int(done[2]))
    return steps.end(failure, halted, finished)


@dataclass(eq=False)
class _Steps:
    """The loop in Python, one period after the other, and how it ends."""

    law: Controller
    moved: PlantProtocol
    samples: Array
    disturbance: RunningDisturbance | None
    clock: Clock | None
    supervision: Supervision | None
    recording: SampleSink | None
    follow: Follow | None
    replanning: Replanning | None

    def __post_init__(self) -> None:
        law, samples, supervision = self.law, self.samples, self.supervision
        self.plant, self._followed = running_plant(self.moved), np.zeros(8)
        self.desired, self.senses = samples, None
        if supervision is not None:
            self.desired = long_array(len(samples) + most_steps_to_rest(supervision.supervisor), SAMPLE_SIZE)
            self.desired[: len(samples)] = samples
            self.senses = Senses(self.moved, supervision.supervisor)
            supervision.begin(len(self.desired))
        n, m, size, report = len(self.plant.q), law.robot.input_size, len(self.desired), len(law.report)
        kept = long_array(size, report) if report else np.zeros((size, 0))
        self.records = long_array(size, n), long_array(size, n), long_array(size, m), kept
        self.realised = np.zeros((size if self.disturbance else 0, 6))
        self.law_state = law.initial_state(self.plant.q)
        self.done, self.was_sent, self.at_rest = 0, True, False
        self.readings = Readings(self.plant, size)
        self._fault, self.unanswered = "", ""
        if self.clock is not None:
            self._take_memory()

    def _take_memory(self) -> None:
        """Write what steps will write: the system gives memory at that, and is not asked while a robot moves."""
        codes = self.supervision.codes if self.supervision else np.zeros(0)
        rest = self.desired[len(self.samples) :]
        for array in (*self.records, rest, self.realised, codes, self.readings.rows):
            array.fill(0.0)

    def run(self, stop: Stop | None, progress: Callable[[int, int], None] | None) -> Trace:
        """Follow the samples to their end, or to an earlier one."""
        try:
            failure, halted, finished = self._follow(stop, progress)
        except BaseException:
            self._stop_on_exception()
            raise
        return self.end(failure, halted, finished)

    def end(self, failure: str | None, halted: str, finished: str) -> Trace:
        """Come to rest, if there is a supervisor, and return what was seen and why it ended."""
        supervision, done = self.supervision, self.done
        if supervision:
            self._come_to_rest(hard=bool(failure or halted))
            if failure:
                self.done = done
            else:
                halted = self._why(supervision, halted)
        done, desired = self.done, self.law.guided(self.desired, self.law_state)
        lost, why = _first_beyond(FARTHEST, self.records[0][:done]), failure
        if lost:
            done, why = lost, f"a joint went beyond {FARTHEST:g} rad or m"
        if why is not None:
            stopped = f"diverged at {desired[done, TIME]:g} s: {why}"
        elif halted:
            stopped = f"halted at {desired[max(done - 1, 0), TIME]:g} s: {halted}"
        else:
            stopped = finished or ("duration" if done == len(desired) else "settled")
        # a stop after the fault is its consequence, a failure is not
        if self._fault and ((supervision and not failure) or not has_failed(stopped)):
            stopped = self._fault
        q, measured, command, kept = (array[:done] for array in self.records)
        realised = self.realised[:done] if self.disturbance else None
        signals = self.readings.signals(done) | (supervision.signals(done) if supervision else {})
        return Trace(q, measured, command, stopped, desired[:done], realised, signals, kept)

    def _why(self, supervision: Supervision, halted: str) -> str:
        """Say why the supervisor stopped the robot, if it did not only end what was over."""
        cause = "" if halted == _SUPERVISOR else halted
        if self.done and not self.at_rest:
            cause = f"it still moves after {self.done - len(self.samples)} periods of braking"
        if self.recording and self.recording.failure:
            cause = self.recording.failure
        if not self.done or not (cause or halted or not supervision.stopped_softly):
            return ""
        if cause:
            return f"stop category 1: {cause}"
        why = supervision.why(self.done)
        return f"{why}: {self.unanswered}" if supervision.missed_command and self.unanswered else why

    def law_failure(self, k: int, status: int) -> str:
        """Say why the law had no command at sample k: of its own words, if it fails there again."""
        if status < compiled.LAW_FAILED:
            return _LOST
        state, command = self.law_state.copy(), np.empty(self.law.robot.input_size)
        failure = _ask(self.law, self.records[1][k], self.samples[k], k, state, command)
        return failure or status_text(status - compiled.LAW_FAILED)

    def _come_to_rest(self, *, hard: bool) -> None:
        """Step on, with the desired pose at rest, until what is sent to the robot is at rest too."""
        supervision = self.supervision
        if supervision is None or not self.done:
            return
        self.plant.rewind()
        if self.clock:
            self.clock.go_on()
        if hard:
            supervision.stop()
        else:
            supervision.finish()
        self._flush_command()
        while not self.at_rest and self.done < len(self.desired):
            if self.clock:
                self.clock.await_step()
            self._rest_desired()
            self._command(self.desired[self.done], asks=False)
            self._flush_command()

    def _follow(
        self, stop: Stop | None, progress: Callable[[int, int], None] | None
    ) -> tuple[str | None, str, str]:
        """Take one step a sample; return what failed, what halted it and how it finished otherwise."""
        stop_values, count = _stop_array(stop), np.zeros(9)
        for k, row in enumerate(self.samples):
            if self.replanning and self.replanning.is_over(k, self.plant.measured):
                return None, "", "duration"
            if self.clock and not self.clock.await_step():
                return None, self.clock.overran, ""
            try:
                failure = self._command(row)
                if failure and self.supervision is None:
                    return failure, "", ""
                if self.at_rest:
                    return None, _SUPERVISOR, ""
                if self.recording and self.recording.failure and not self.supervision:
                    return None, self.recording.failure, ""
                if stop and not failure and compiled.settled(self.law.pose, row[POSE], stop_values, count):
                    return None, "", "settled" if self.done < len(self.samples) else "duration"
                self._move()
            except DivergedError as error:
                if not self.was_sent:
                    self.done, self.was_sent = self.done - 1, True
                return str(error), "", ""
            except FallenError as error:
                self.was_sent, self._fault = True, str(error)
                if self.supervision:
                    self.supervision.stop()
                return None, "", "duration"
            if progress and self.done % _PROGRESS_EVERY == 0:
                progress(self.done, len(self.samples))
        return None, "", "duration"

    def _command(self, row: Array, *, asks: bool = True) -> str | None:
        """Find the command of the next sample; return why the law had none."""
        k, plant, supervision = self.done, self.plant, self.supervision
        q, measured, command, kept = (record[k] for record in self.records)
        q[:], measured[:] = plant.q, plant.measured
        self.readings.take(k)
        self._see(k, row)
        if asks and self.replanning:
            self._plan_again(self.replanning)
        command[:] = 0.0
        if self.law.wrench.size:
            self.law.wrench[:] = plant.wrench
        failure = _ask(self.law, plant.measured, row, k, self.law_state, command) if asks else None
        kept[:] = self.law.report
        if failure and supervision is None:
            return failure
        self.unanswered = failure or self.unanswered
        self.done, self.was_sent = k + 1, False
        elapsed = self.clock.elapsed if self.clock else None
        if supervision:
            self.at_rest = supervision.step(k, row[TIME], measured, command, self.senses, elapsed)
            self.law.sent(self.law_state, command)
            code = supervision.codes[k]
            supervision.black_box.take(elapsed or supervision.period, row, q, measured, command, code)
        if self.recording:
            self.recording.take(row, q, measured, command, supervision.codes[k] if supervision else 0.0)
            if self.recording.failure and supervision:
                supervision.stop()
        if self.clock:
            self.clock.commanded()
        return failure

    def _plan_again(self, replanning: Replanning) -> None:
        """Go along another way from this sample on, if constraints held the robot on the one before."""
        k, plant = self.done, self.plant
        found = replanning.look(k, self.law, self.law_state, plant.measured, plant.seen, self.samples)
        if found is None:
            return
        self.law, self.law_state = found
        self.desired[k : len(self.samples)] = self.samples[k:]
        for name, pose in plant.seen.items():
            self.law.place(name, pose)

    def _see(self, k: int, row: Array) -> None:
        """Let law and desired sample know where watched bodies are measured."""
        for name, pose in self.plant.seen.items():
            self.law.place(name, pose)
        follow = self.follow
        if follow is None or k >= len(self.samples):
            return
        if row[TIME] <= follow.until:
            self._followed[:] = self.plant.seen[follow.body]
        row[:] = follow.carried(row, self._followed)
        self.desired[k] = row

    def _move(self) -> None:
        """Send the last command, and let the robot move for a period."""
        k = self.done - 1
        if self.disturbance is not None:
            self.disturbance.step(self.law.robot, k, self.plant.q, self.realised[k])
        self.plant.step(self.records[2][k])
        self.was_sent = True
        if self.plant.fault and not self._fault:
            category = "stop category 0: " if self.supervision else ""
            self._fault = f"faulted at {self.desired[k, TIME]:g} s: {category}{self.plant.fault}"
            if self.supervision:
                self.supervision.stop()

    def _flush_command(self) -> None:
        """Send the last command if it was not; a plant that fails may hear the next one."""
        if not self.was_sent:
            self.was_sent = True
            with suppress(Exception):
                self.plant.step(self.records[2][self.done - 1])

    def _stop_on_exception(self) -> None:
        """Come to rest while an exception is on its way; one interrupt does not end that, the next one does."""
        self.was_sent = self.was_sent or not self.at_rest
        if self.supervision and self.done:
            with first_interrupt(self.supervision.stop), suppress(Exception):
                self._come_to_rest(hard=True)

    def _rest_desired(self) -> None:
        """Let what is desired of the next sample be the pose of the last one, at rest."""
        before, row = self.desired[self.done - 1], self.desired[self.done]
        row[:] = before
        row[TWIST] = row[TWIST_RATE] = 0.0
        row[TIME] = before[TIME] + self.law.period


def _first_beyond(bound: float, rows: Array) -> int:
    """Return the first row with a number beyond ± bound, or 0."""
    if not rows.size or max(rows.max(), -rows.min()) <= bound:  # a tenth of the time of looking at each row
        return 0
    found = np.flatnonzero((np.abs(rows) > bound).any(axis=1))
    return int(found[0]) if len(found) else 0


def _ask(law: Controller, measured: Array, row: Array, k: int, state: Array, command: Array) -> str | None:
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


def _warm_up(
    law: Controller, plant: RunningPlant, samples: Array, disturbance: RunningDisturbance | None
) -> None:
    """Compile what the loop calls, so that its first steps are as fast as the others."""
    for each in (plant.compiled(), disturbance):
        if each is not None and isinstance(each.kernel, Kernel):
            _ = each.kernel.pointer
    _ = compiled.settled.pointer
    if isinstance(law.kernel, Kernel):
        with suppress(DivergedError, ValueRangeError):  # the loop will say so
            for row in samples[:1]:
                law.step(plant.measured, row, 0, law.initial_state(plant.q), np.empty(law.robot.input_size))
