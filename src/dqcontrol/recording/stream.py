"""A recording written while the robot moves: whatever happens, what was written stays readable."""

from __future__ import annotations

import io
import os
import sys
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from types import TracebackType

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, ExistsError
from dqcontrol.loop.record import Record, part_of, pose_errors
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.mcap_writer import END, METADATA, SampleWriter, about
from dqcontrol.robots.robot import Robot
from dqcontrol.supervisor.interventions import INTERVENTIONS

_EVERY = 0.1  # s between drains: little at once, as the loop may have to wait for it
_CHUNK = 1.0  # s, recorded or on the clock, of one chunk, of whose index 0.2 kB stay in memory
# of real-time scheduling, if the loop has it: at ordinary priority this could keep the loop waiting
_URGENCY = 1
_SWITCH = 1e-4  # s: how long the writing thread may keep the loop from going on


def prepare_to_record(robot: Robot) -> None:
    """Import and compile what a recording needs: now, not while the robot moves."""
    SampleWriter(io.BytesIO())
    _ = pose_errors.compiled, robot.fkm(np.zeros((1, robot.configuration_size)))


def broken_off(error: BaseException) -> str:
    """Return how a run ended that an error, or the user, broke off."""
    return f"broken off: {str(error) or type(error).__name__}"


class RecordStream:
    """Writes samples to an MCAP file from a thread, once a second, and faster if they come faster than in real time.

    Killed at any moment, the file holds all but the last second; cut anywhere, all but a second before the cut.
    `load_record` reads it. If the disk is full, ``failure`` says so, and the loop stops the robot.

    Parameters
    ----------
    path
        A file that does not exist yet; missing folders are made.
    robot
        For the poses of the end effector, and names.
    spec
        Text of the experiment, kept with the data.

    Raises
    ------
    ExistsError
        If the file exists.

    Examples
    --------
    >>> with RecordStream("out/record.mcap", arm) as stream:  # doctest: +SKIP
    ...     stream.take(sample.data, q, measured, command)
    """

    path: Path

    def __init__(self, path: str | Path, robot: Robot, spec: str = "") -> None:
        self.path, self._robot = Path(path), robot
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.failure: str = ""
        self._waiting: deque[tuple[Array, Array, Array, Array, float]] = deque()
        self._held: list[tuple[Array, Array, Array, Array, float]] = []
        self._written, self._first = 0, 0.0
        self._chunk_begin: float | None = None  # recorded s, of the chunk in progress if there is one
        self._chunk_drains = 0
        self._is_urgent = hasattr(os, "SCHED_FIFO") and bool(os.sched_getscheduler(0) & os.SCHED_FIFO)
        self._end = threading.Event()
        try:
            self._file = open(self.path, "xb")  # noqa: SIM115 — closed by `close`
        except FileExistsError:
            raise ExistsError(f"{path}: exists already; choose another name or remove it") from None
        self._writer = SampleWriter(self._file)
        signal = Signal(INTERVENTIONS, (), ("",), np.zeros((0, 1)))
        self._writer.add_metadata(METADATA, about(robot.joint_names, robot.input_names, spec, [signal]))
        self._file.flush()
        prepare_to_record(robot)
        self._switch = sys.getswitchinterval()
        sys.setswitchinterval(_SWITCH)
        self._thread = threading.Thread(target=self._work, name="recording", daemon=True)
        self._thread.start()

    def take(
        self, sample: Array, q: Array, measured: Array, command: Array, interventions: float = 0.0
    ) -> None:
        """Hand over one sample, as ``SampleSink.take`` says; returns at once."""
        self._waiting.append((sample.copy(), q.copy(), measured.copy(), command.copy(), interventions))

    def close(self, stopped: str = "") -> None:
        """Write what is left, and why it ended.

        Raises
        ------
        Error
            If the file could not be written; it also says why the motion ended, if that was not for it.
        """
        if self._end.is_set():
            return
        self._end.set()
        self._thread.join()
        sys.setswitchinterval(self._switch)
        try:
            if not self.failure:
                self._drain(everything=True)
                end = {"samples": str(self._written), "stopped": stopped or "duration"}
                self._writer.add_metadata(END, end)
                self._writer.finish()
        except OSError as error:
            self.failure = _worded(error)
        finally:
            with suppress(OSError):  # said already
                self._file.close()
        if self.failure:
            other = f"; the motion ended with: {stopped}" if stopped and self.failure not in stopped else ""
            raise Error(f"{self.path}: {self.failure}{other}")

    def __enter__(self) -> RecordStream:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error:
            error.add_note(f"recorded until then: {self.path}")
        self.close(broken_off(error) if error else "")

    def _work(self) -> None:
        if self._is_urgent:
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_URGENCY))
        while not self._end.wait(_EVERY):
            try:
                self._drain()
            except Exception as error:  # whatever it is: the robot must not move on unrecorded
                self.failure = _worded(error)
                return

    def _drain(self, *, everything: bool = False) -> None:
        """Write what waits; the last sample is held back until the next one gives its velocity."""
        self._held += [self._waiting.popleft() for _ in range(len(self._waiting))]
        ready = len(self._held) - (not everything)
        if ready > 0:
            self._write(ready)
        if self._chunk_begin is not None:
            self._chunk_drains += 1
            if self._chunk_drains * _EVERY >= _CHUNK:
                self._end_chunk()

    def _write(self, ready: int) -> None:
        """Write the first samples of those held, in chunks of so much recorded time."""
        samples, q, measured, command, codes = (np.array(column) for column in zip(*self._held, strict=True))
        time = samples[:, -1]
        if not self._written:
            self._first = min(0.0, float(time[0]))
        record = Record(
            time,
            q,
            measured,
            command,
            self._robot.fkm(q),
            samples,
            self._robot.joint_names,
            self._robot.input_names,
            readings={INTERVENTIONS: Signal(INTERVENTIONS, (), ("",), codes[:, None])},
        )
        begin = 0
        while begin < ready:
            if self._chunk_begin is None:
                self._chunk_begin = float(time[begin])
            end = begin + int(np.searchsorted(time[begin:ready], self._chunk_begin + _CHUNK))
            self._writer.write(part_of(record, begin, end + 1), end - begin, self._first)
            if end < ready:
                self._end_chunk()
            begin = end
        self._written += ready
        del self._held[:ready]

    def _end_chunk(self) -> None:
        """Bring what was written to the file, where readers see it."""
        self._writer.flush()
        self._chunk_begin, self._chunk_drains = None, 0


def _worded(error: Exception) -> str:
    return f"the recording cannot be written: {getattr(error, 'strerror', None) or error}"
