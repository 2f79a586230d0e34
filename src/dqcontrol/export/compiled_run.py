"""A run in real time whose law and supervisor step in C; Python only watches and records."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from dqcontrol.errors import ValueRangeError
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.real_time import StreamedRun
from dqcontrol.experiments.results_folder import told_first
from dqcontrol.experiments.run import Run, as_run
from dqcontrol.export.controller_parts import ControllerParts, controller_parts
from dqcontrol.export.loop_hosts import END, STOP, LoopHost, LoopRows, Over, ProcessHost, ThreadHost
from dqcontrol.files.long_array import row_by_row
from dqcontrol.loop import Record, Timing
from dqcontrol.loop.closed_loop import SampleSink
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.supervision import SECONDS, Watch
from dqcontrol.plants.plant import CompiledPlant, running_plant
from dqcontrol.references.sample import TIME
from dqcontrol.supervisor.interventions import INTERVENTIONS, describe_stop, reasons

_EVERY = 0.05  # s between looks at what the loop has done
_ENDED = 3  # of dqc_controller.h
_FAILED = {
    -6: "the law failed",
    -11: "no measurement came in its period",
}  # without a supervisor; of dqc_controller.h


def run_compiled_in_real_time(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    figures: bool = True,
    over: Over | None = None,
    watch: Watch | None = None,
    computed: Callable[[Run], None] | None = None,
) -> Run:
    """Do what `experiments.run_in_real_time` does, with law and supervisor in a loop of C.

    The loop has real-time scheduling (SCHED_FIFO) if the system allows it.

    Parameters
    ----------
    source
        Path of a YAML file, or the same as a dictionary.
    folder
        A new folder.
    force
        Replace it, if it holds an earlier run.
    figures
        Draw the figures of the report.
    over
        None: a thread, which moves the plant too. ``"udp"`` or ``"shared-memory"``: a process, which reaches the plant
        in another process that way; the plant then has no noise.
    watch
        Called with time (s) and reasons whenever what the supervisor does changes.
    computed
        Called with the run before its figures and report are written.

    Raises
    ------
    Error
        If the plant is not compiled, there is no C compiler, or something else is missing or does not fit, before
        anything moves.
    """
    parts = controller_parts(source)
    setting = parts.setting
    case = setting.only_case("spec" if isinstance(source, dict) else source, "in real time there is one")
    plant = _startable_plant(parts)
    (expected,) = warn_unstable(setting, stacklevel=2)
    streamed = StreamedRun(folder, parts.robot, setting.single_text(case, 0), force=force)
    with tempfile.TemporaryDirectory() as build:
        host = _host(parts, plant, Path(build), over)
        with streamed.record() as recording:
            try:
                _watched(host, recording, watch)
            except BaseException as error:
                _keep_last_seconds(parts, streamed, host, f"broken off: {error or type(error).__name__}")
                raise
            rows = host.rows[: host.written]
            record = _record(parts, rows)
            recording.close(record.stopped)
        if record.stopped.startswith("halted"):
            _keep_last_seconds(parts, streamed, host, record.stopped)
    timing = Timing(parts.period, rows.begin, rows.computation, rows.idle, rows.late != 0.0)
    done = replace(as_run(setting, case, 0, record), timing=timing, expected=expected)
    with told_first(computed, done):
        streamed.complete(done, figures=figures)
        warn_of_failures([(case, [done.metrics.flat()])], stacklevel=2)
    return done


def _startable_plant(parts: ControllerParts) -> CompiledPlant:
    """Return the plant with its noise, and refuse what the thread cannot do."""
    kind = type(parts.case.plant).__struct_config__.tag
    if parts.plant is None:
        raise ValueRangeError(f"plant: '{kind}' does not step in C; with --compiled use servo or integrator")
    if parts.wrench_at >= 0:
        raise ValueRangeError("contact: loops in C hand the law no wrench; run it without --compiled")
    if parts.setting.spec.disturbance is not None:
        raise ValueRangeError("disturbance: does not step in C; leave it out, or leave out --compiled")
    case = parts.case
    started = case.plant.start(
        parts.robot, case.scene.start, parts.period, len(parts.samples), parts.setting.spec.seed
    )
    plant = running_plant(started).compiled()
    assert plant is not None
    return plant


def _host(parts: ControllerParts, plant: CompiledPlant, build: Path, over: Over | None) -> LoopHost:
    return ProcessHost(parts, plant, build, over) if over else ThreadHost(parts, plant, build)


def _watched(host: LoopHost, recording: SampleSink, watch: Watch | None) -> None:
    """Start a loop, and record what it does until it has ended."""
    seen, code = 0, 0

    def look(told: Watch | None) -> None:
        nonlocal seen, code
        new = host.rows[seen : host.written]
        for k in range(len(new.numbers)):
            sample = new.sample[k].copy()
            sample[TIME] = new.time[k]
            recording.take(sample, new.q[k], new.measured[k], new.command[k], new.interventions[k])
            seen += 1
            if told and new.interventions[k] != code:
                code = new.interventions[k]
                told(float(new.time[k]), reasons(code))
        if recording.failure:
            host.ask(STOP)

    with first_interrupt(lambda: host.ask(END)):
        host.start()
        try:
            while not host.is_done:
                host.beat()
                time.sleep(_EVERY)
                look(watch)
        except BaseException:
            host.ask(STOP)
            watch = None  # it may be what failed
            raise
        finally:
            try:
                host.join()
            finally:
                look(watch)


def _keep_last_seconds(parts: ControllerParts, streamed: StreamedRun, host: LoopHost, why: str) -> None:
    """Write what a black box would hold, of a supervised robot that has moved."""
    count = host.written
    if parts.supervisor and count:
        rows = host.rows[max(count - round(SECONDS / parts.period), 0) : count]
        streamed.keep(replace(_record(parts, rows), stopped=why))


def _record(parts: ControllerParts, rows: LoopRows) -> Record:
    """Return what the thread noted as the record of a run."""
    desired = rows.sample.copy()
    desired[:, TIME] = rows.time
    robot = parts.robot
    return Record(
        time=rows.time.copy(),
        q=rows.q.copy(),
        measured=rows.measured.copy(),
        command=rows.command.copy(),
        pose=row_by_row(robot.fkm, rows.q.copy()),
        desired=desired,
        joint_names=robot.joint_names,
        input_names=robot.input_names,
        stopped=_why(parts, rows),
        readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), rows.interventions[:, None].copy())}
        if parts.supervisor
        else {},
    )


def _why(parts: ControllerParts, rows: LoopRows) -> str:
    """Say why a loop ended: because its reference was over, or what halted it."""
    over = parts.samples[-1, TIME] - 0.5 * parts.period
    if rows.status[-1] == _ENDED and rows.sample[-1, TIME] >= over:
        return "duration"
    words = describe_stop(rows.interventions[-1])
    if not parts.supervisor:
        words = next(
            (_FAILED[status] for status in map(int, rows.status) if status in _FAILED), "asked to end"
        )
    return f"halted at {rows.time[-1]:g} s: {words}"
