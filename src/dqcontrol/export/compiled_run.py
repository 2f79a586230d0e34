"""A run in real time whose law and supervisor step in a thread of C; Python only watches and records."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.object_code import target_named
from dqcontrol.errors import Error, MissingExtraError, ValueRangeError
from dqcontrol.experiments.check import warn_unstable
from dqcontrol.experiments.run import Run, as_run
from dqcontrol.experiments.shortfall import warn_of_shortfalls
from dqcontrol.experiments.streamed_run import StreamedRun
from dqcontrol.export.controller_folder import write_controller
from dqcontrol.export.controller_parts import ControllerParts, controller_parts
from dqcontrol.files.long_array import row_by_row
from dqcontrol.limits.supervisor.interventions import INTERVENTIONS, describe_stop, reasons
from dqcontrol.loop import Record, Timing
from dqcontrol.loop.interrupts import first_interrupt
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.supervision import Watch
from dqcontrol.plants.live_plant import live_plant
from dqcontrol.plants.plant import CompiledPlant
from dqcontrol.recording import RecordStream
from dqcontrol.references.sample import SAMPLE_SIZE, TIME

_EVERY = 0.05  # s between looks at what the thread has done
_PRIORITY = 50  # of SCHED_FIFO, as ros2_control has it
_TO_REST = 10.0  # s at most after the reference
_END, _STOP = 1, 2  # requests of dqc_loop.h
_ENDED, _STOPPED = 3, 2  # of dqc_controller.h
_SOURCES = ("hosts/realtime/thread_host.c", "hosts/realtime/dqc_loop.c", "dqc_controller.c", "dqc_data.c")
_OBJECTS = ("dqc_plant.c", "dqc_code.o", "dqc_numbers.o", "dqc_plant_code.o", "dqc_plant_numbers.o")


@dataclass(frozen=True)
class LoopRows:
    """What the thread noted, one row a step, as ``dqc_row`` of ``dqc_loop.h`` has it."""

    numbers: Array
    coordinates: int
    inputs: int

    @staticmethod
    def columns(coordinates: int, inputs: int) -> int:
        """Return how many numbers a row has."""
        return 5 + SAMPLE_SIZE + 2 * coordinates + inputs + 2

    def __getattr__(self, name: str) -> Array:
        n, m = self.coordinates, self.inputs
        sizes = {"time": 1, "begin": 1, "computation": 1, "idle": 1, "late": 1, "sample": SAMPLE_SIZE}
        sizes |= {"q": n, "measured": n, "command": m, "interventions": 1, "status": 1}
        if name not in sizes:
            raise AttributeError(name)
        first = sum(list(sizes.values())[: list(sizes).index(name)])
        part = self.numbers[:, first : first + sizes[name]]
        return part[:, 0] if sizes[name] == 1 else part


def run_compiled_in_real_time(
    source: str | Path | dict[str, Any],
    folder: str | Path,
    *,
    force: bool = False,
    figures: bool = True,
    watch: Watch | None = None,
) -> Run:
    """Do what `experiments.run_in_real_time` does, with law, supervisor and plant in a thread of C.

    The thread has real-time scheduling (SCHED_FIFO) if the system allows it.

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
    watch
        Called with time (s) and reasons whenever what the supervisor does changes.

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
        host = _built_host(parts, Path(build))
        with streamed.record() as recording:
            rows = _watched(host, parts, plant, recording, watch)
            record = _record(parts, rows)
            recording.close(record.stopped)
    timing = Timing(parts.period, rows.begin, rows.computation, rows.idle, rows.late != 0.0)
    done = replace(as_run(setting, case, 0, record), timing=timing, expected=expected)
    streamed.complete(done, figures=figures)
    warn_of_shortfalls([(case, [done.metrics.flat()])], stacklevel=2)
    return done


def _startable_plant(parts: ControllerParts) -> CompiledPlant:
    """Return the plant with its noise, and refuse what the thread cannot do."""
    kind = type(parts.case.plant).__struct_config__.tag
    if parts.plant is None:
        raise ValueRangeError(f"plant: '{kind}' does not step in C; with --compiled use servo or integrator")
    if parts.setting.spec.disturbance is not None:
        raise ValueRangeError("disturbance: does not step in C; leave it out, or leave out --compiled")
    case = parts.case
    started = case.plant.start(
        parts.robot, case.scene.start, parts.period, len(parts.samples), parts.setting.spec.seed
    )
    plant = live_plant(started).compiled()
    assert plant is not None
    return plant


def _built_host(parts: ControllerParts, build: Path) -> Any:
    """Return the loop and all that it calls as a library of this process."""
    folder, library = build / "c", build / "host.so"
    write_controller(parts, folder, target_named("native"))
    files = [str(folder / name) for name in (*_SOURCES, *_OBJECTS)]
    command = ["cc", "-std=gnu99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", f"-I{folder}", *files]
    try:
        done = subprocess.run(
            [*command, "-lm", "-lpthread", "-o", str(library)], capture_output=True, text=True, check=False
        )
    except FileNotFoundError:
        raise MissingExtraError("compiled: needs a C compiler: apt-get install gcc") from None
    if done.returncode:
        raise Error(f"compiled: the C compiler failed: {done.stderr.strip()[:300]}")
    host = ctypes.CDLL(str(library))
    host.host_written.restype = ctypes.c_int64
    return host


def _watched(
    host: Any, parts: ControllerParts, plant: CompiledPlant, recording: RecordStream, watch: Watch | None
) -> LoopRows:
    """Start the thread, record what it does, and return all of it when it has ended."""
    n, m = parts.robot.configuration_size, parts.robot.input_size
    capacity = len(parts.samples) + round(_TO_REST / parts.period)
    numbers, noise = np.zeros((capacity, LoopRows.columns(n, m))), np.ascontiguousarray(plant.noise)
    seen, code = 0, 0

    def look() -> None:
        nonlocal seen, code
        count = host.host_written()
        new = LoopRows(numbers[seen:count], n, m)
        for k in range(count - seen):
            sample = new.sample[k].copy()
            sample[TIME] = new.time[k]
            recording.take(sample, new.q[k], new.measured[k], new.command[k], new.interventions[k])
            if watch and new.interventions[k] != code:
                code = new.interventions[k]
                watch(float(new.time[k]), reasons(code))
        seen = count
        if recording.failure:
            host.host_request(_STOP)

    with first_interrupt(lambda: host.host_request(_END)):
        failed = host.host_start(
            _pointer(numbers),
            ctypes.c_int64(capacity),
            _pointer(noise),
            ctypes.c_int64(len(noise)),
            _PRIORITY,
        )
        if failed:
            raise Error(f"compiled: the system gave no thread (error {failed})")
        try:
            while not host.host_is_done():
                time.sleep(_EVERY)
                look()
        except BaseException:
            host.host_request(_STOP)
            raise
        finally:
            host.host_join()
            look()
    return LoopRows(numbers[:seen], n, m)


def _pointer(array: NDArray[np.float64]) -> Any:
    return ctypes.c_void_p(array.ctypes.data)


def _record(parts: ControllerParts, rows: LoopRows) -> Record:
    """Return what the thread noted as the record of a run."""
    desired = rows.sample.copy()
    desired[:, TIME] = rows.time
    last, robot = rows.numbers[-1:], parts.robot
    status = int(LoopRows(last, rows.coordinates, rows.inputs).status[0])
    stopped = {_ENDED: "duration", _STOPPED: ""}.get(status, "room for samples")
    if not stopped:
        stopped = f"halted at {rows.time[-1]:g} s: {describe_stop(rows.interventions[-1])}"
    return Record(
        time=rows.time.copy(),
        q=rows.q.copy(),
        measured=rows.measured.copy(),
        command=rows.command.copy(),
        pose=row_by_row(robot.fkm, rows.q.copy()),
        desired=desired,
        joint_names=robot.joint_names,
        input_names=robot.input_names,
        stopped=stopped,
        readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), rows.interventions[:, None].copy())}
        if parts.supervisor
        else {},
    )
