"""A run in real time whose law and supervisor step in C, in a thread or a process; Python only watches and records."""

from __future__ import annotations

import ctypes
import math
import os
import socket
import subprocess
import tempfile
import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compiled.object_code import target_named
from dqcontrol.errors import Error, MissingExtraError, NoteWarning, ValueRangeError
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.failure_hints import warn_of_failures
from dqcontrol.experiments.real_time import StreamedRun
from dqcontrol.experiments.results_folder import told_first
from dqcontrol.experiments.run import Run, as_run
from dqcontrol.export.controller_folder import write_controller
from dqcontrol.export.controller_parts import ControllerParts, controller_parts
from dqcontrol.files.long_array import row_by_row
from dqcontrol.loop import Record, Signal, Timing
from dqcontrol.loop.closed_loop import SampleSink
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.supervision import SECONDS, Watch, most_steps_to_rest
from dqcontrol.plants.plant import CompiledPlant
from dqcontrol.recording.stream import broken_off
from dqcontrol.references.sample import SAMPLE_SIZE, TIME
from dqcontrol.supervisor.interventions import INTERVENTIONS, describe_stop, reasons

Over = Literal["udp", "shared-memory"]

END, STOP = 1, 2  # requests of dqc_loop.h
_WRITTEN, _REQUEST, _IS_DONE, _HEARTBEAT, _WATCH = 0, 1, 2, 7, 8  # of its dqc_watch
_PRIORITY = 50  # of SCHED_FIFO, as ros2_control has it
_REACTION = 10.0  # s in which it begins to brake, whatever the system does meanwhile
_PATIENCE = 10.0  # s for a process to begin, to take a step, and to end
_SOURCES = ("hosts/realtime/thread_host.c", "hosts/realtime/dqc_loop.c", "dqc_controller.c", "dqc_data.c")
_OBJECTS = ("dqc_plant.c", "dqc_code.o", "dqc_numbers.o", "dqc_plant_code.o", "dqc_plant_numbers.o")
_FAST = Path("/dev/shm")  # files that no disk is waited for
_EVERY = 0.05  # s between looks at a loop
_ENDED = 3  # of dqc_controller.h
# without a supervisor; of dqc_controller.h
_FAILED = {-6: "the law failed", -11: "no measurement came in its period"}


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
                _keep_last_seconds(parts, streamed, host, broken_off(error))
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
    plant = parts.started_plant(len(parts.samples)).compiled()
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
        for k in range(len(new)):
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


def _record(parts: ControllerParts, rows: Any) -> Record:
    """Return what the thread noted as the record of a run."""
    desired = rows.sample.copy()
    desired[:, TIME] = rows.time
    robot = parts.robot
    q, done = rows.q.copy(), rows.interventions[:, None].copy()
    return Record(
        rows.time.copy(),
        q,
        rows.measured.copy(),
        rows.command.copy(),
        row_by_row(robot.fkm, q),
        desired,
        robot.joint_names,
        robot.input_names,
        stopped=_why(parts, rows),
        readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), done)} if parts.supervisor else {},
    )


def _why(parts: ControllerParts, rows: Any) -> str:
    """Say why a loop ended: because its reference was over, or what halted it."""
    over = parts.samples[-1, TIME] - 0.5 * parts.period
    if rows.status[-1] == _ENDED and rows.sample[-1, TIME] >= over:
        return "duration"
    failures = (_FAILED[status] for status in rows.status.astype(int).tolist() if status in _FAILED)
    words = describe_stop(rows.interventions[-1]) if parts.supervisor else next(failures, "asked to end")
    return f"halted at {rows.time[-1]:g} s: {words}"


def row_type(n: int, m: int) -> np.dtype[Any]:
    """Return what a loop notes of a step, of a robot with n coordinates and m inputs: ``dqc_row`` of ``dqc_loop.h``."""
    vectors = {"sample": SAMPLE_SIZE, "q": n, "measured": n, "command": m}
    names = ("time", "begin", "computation", "idle", "late", *vectors, "interventions", "status")
    return np.dtype([(name, float, (vectors[name],) if name in vectors else ()) for name in names])


class ThreadHost:
    """A loop in a thread, which moves the plant too.

    Parameters
    ----------
    parts, plant
        Controller and plant.
    build
        Where it is built.

    Raises
    ------
    Error
        If there is no C compiler, or it fails.
    """

    def __init__(self, parts: ControllerParts, plant: CompiledPlant, build: Path) -> None:
        folder, library = build / "c", build / "host.so"
        write_controller(parts, folder, target_named("native"))
        files = [str(folder / name) for name in (*_SOURCES, *_OBJECTS)]
        command = ["cc", "-std=gnu99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", f"-I{folder}", *files]
        _build([*command, "-lm", "-lpthread", "-o", str(library)])
        self._library: Any = ctypes.CDLL(str(library))
        self._library.host_written.restype = ctypes.c_int64
        self._library.dqc_status_text.restype = ctypes.c_char_p
        self._noise = np.ascontiguousarray(plant.noise)
        n, m = parts.robot.configuration_size, parts.robot.input_size
        self.rows: Any = np.zeros(_capacity(parts), row_type(n, m)).view(np.recarray)

    def start(self) -> None:
        """Let it begin."""
        failed = self._library.host_start(
            _pointer(self.rows),
            ctypes.c_int64(len(self.rows)),
            _pointer(self._noise),
            ctypes.c_int64(len(self._noise)),
            _PRIORITY,
        )
        if failed:
            raise Error(f"compiled: the system gave no thread (error {failed})")

    @property
    def written(self) -> int:
        """How many steps it has noted."""
        return self._library.host_written()

    @property
    def is_done(self) -> bool:
        """Whether it has ended."""
        return bool(self._library.host_is_done())

    def beat(self) -> None:
        """Do nothing: the thread ends with whoever watches."""

    def ask(self, request: int) -> None:
        """Ask it to `END` or to `STOP`."""
        self._library.host_request(request)

    def join(self) -> None:
        """Wait for its end.

        Raises
        ------
        Error
            If its first step was refused.
        """
        status = self._library.host_join()
        if status < 0:
            raise Error(f"compiled: {self._library.dqc_status_text(status).decode()}")


class ProcessHost:
    """A loop in a process, and the plant, without its noise, in another one: each ends if the other one does.

    Parameters
    ----------
    parts, plant
        Controller and plant.
    build
        Where it is built.
    over
        How the two reach each other.

    Raises
    ------
    Error
        If there is no C compiler or make, or it fails.
    """

    def __init__(self, parts: ControllerParts, plant: CompiledPlant, build: Path, over: Over) -> None:
        if plant.noise.any():
            warnings.warn("plant: in a process of its own it moves without noise", NoteWarning, stacklevel=4)
        folder, kind = build / "c", over.partition("-")[0]
        write_controller(parts, folder, target_named("native"))
        programs = [f"hosts/realtime/{kind}_{each}" for each in ("robot", "loop")]
        _build(["make", "-s", "-C", str(folder), *programs])
        self._robot, self._loop = (str(folder / program) for program in programs)
        self._place = f"/dqcontrol-{os.getpid()}" if over == "shared-memory" else str(_free_port())
        self._processes: list[subprocess.Popen[str]] = []
        place = _FAST if _FAST.is_dir() else build
        self._file = tempfile.TemporaryFile(dir=place)  # noqa: SIM115 — closed by `join`; without a name nothing is left
        rows = row_type(parts.robot.configuration_size, parts.robot.input_size)
        self._file.truncate(8 * _WATCH + _capacity(parts) * rows.itemsize)
        self._watch = np.memmap(self._file, dtype=np.int64, mode="r+", shape=_WATCH)
        noted = np.memmap(self._file, dtype=rows, mode="r+", offset=8 * _WATCH)
        self.rows: Any = noted.view(np.recarray)
        self.beat()

    def start(self) -> None:
        """Let it begin.

        Raises
        ------
        Error
            If a process does not.
        """
        robot = self._run(self._robot, self._place)
        assert robot.stdout is not None
        if robot.stdout.readline() != "ready\n":
            self.join()
        self._run(self._loop, self._place, str(_PRIORITY), f"/dev/fd/{self._file.fileno()}")

    def _run(self, *command: str) -> subprocess.Popen[str]:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "pass_fds": [self._file.fileno()]}
        # An interrupt is for this process, which then asks the loop to end.
        process = subprocess.Popen(command, text=True, **pipes, start_new_session=True)  # type: ignore[call-overload]
        self._processes.append(process)
        return process

    @property
    def written(self) -> int:
        """How many steps it has noted."""
        return int(self._watch[_WRITTEN])

    @property
    def is_done(self) -> bool:
        """Whether it has ended."""
        return bool(self._watch[_IS_DONE]) or self._processes[-1].poll() is not None

    def beat(self) -> None:
        """Let it know that somebody watches; one that hears nothing for 2 s stops."""
        self._watch[_HEARTBEAT] += 1

    def ask(self, request: int) -> None:
        """Ask it to `END` or to `STOP`."""
        self._watch[_REQUEST] = request

    def join(self) -> None:
        """Wait for its end.

        Raises
        ------
        Error
            If a process failed.
        """
        self._await_rest()
        failures = []
        for process in reversed(self._processes):
            try:
                words = "".join(process.communicate(timeout=_PATIENCE)).strip()
            except subprocess.TimeoutExpired:
                process.kill()
                words = "did not end"
            if process.returncode != 0:
                name = Path(process.args[0]).name  # type: ignore[index]
                failures.append(words or f"{name} ended with {process.returncode}")
        self._file.close()
        if failures:
            raise Error(f"compiled: {'; '.join(failures)}")

    def _await_rest(self) -> None:
        """Wait as long as it takes steps: braking may take long, and none is cut off in motion."""
        last, since = math.nan, time.monotonic()
        while not self.is_done and time.monotonic() - since < _PATIENCE:
            self.beat()
            now = self.rows.time[max(self.written - 1, 0)]
            if now != last:
                last, since = now, time.monotonic()
            time.sleep(_EVERY)


LoopHost = ThreadHost | ProcessHost


def _build(command: list[str]) -> None:
    of_make = ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")
    own = {name: value for name, value in os.environ.items() if name not in of_make}
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    except FileNotFoundError:
        raise MissingExtraError("compiled: needs a C compiler and make: apt-get install gcc make") from None
    if done.returncode:
        raise Error(f"compiled: the C compiler failed: {done.stderr.strip()[:300]}")


def _capacity(parts: ControllerParts) -> int:
    to_rest = _REACTION / parts.period
    if parts.supervisor:
        given, prepared = parts.supervisor
        to_rest += given.ramp / parts.period + most_steps_to_rest(prepared)
    return len(parts.samples) + round(to_rest)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        any_socket.bind(("127.0.0.1", 0))
        return any_socket.getsockname()[1]


def _pointer(array: NDArray[Any]) -> Any:
    return ctypes.c_void_p(array.ctypes.data)
