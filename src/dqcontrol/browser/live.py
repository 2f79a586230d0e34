"""Runs in progress: their recordings are read as they grow, whoever writes them."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.constraints import Constraints
from dqcontrol.errors import Error, FileFormatError, ShapeError
from dqcontrol.experiments import execute, prepare
from dqcontrol.loop import Clock, Record
from dqcontrol.recording import RecordStream, load_metadata
from dqcontrol.recording.mcap_writer import COMMAND, MEASURED, SAMPLE, STATES
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot

_FIELDS = {STATES: "position", MEASURED: "position", COMMAND: "velocity", SAMPLE: "data"}
_POLL = 0.05  # s
_PATIENCE = 60.0  # s until the first samples: free, longer than anything takes to start


def growing_recording(path: Path) -> Path | None:
    """Return the recording that a path stands for, if its run may go on; None for folders with results, or of no run.

    A path of a recording stands for itself.
    """
    if path.suffix == ".mcap":
        return path
    inner = path / "record.mcap"
    if not inner.is_file() or (path / "metrics.json").exists():
        return None
    try:
        return None if "stopped" in load_metadata(inner) else inner  # its end says why it ended
    except FileFormatError:  # nothing is there yet
        return inner


class GrowingRecording:
    """Reads a recording while it is written, by `RecordStream` in this process or another one.

    Parameters
    ----------
    path
        The MCAP file.
    robot
        Whose recording it is.

    Attributes
    ----------
    goes_on
        False once it has ended and is read, or it was closed.
    """

    path: Path
    robot: Robot
    goes_on: bool

    def __init__(self, path: Path, robot: Robot) -> None:
        self.path, self.robot, self.goes_on = path, robot, True
        self._stopped = "the recording has no end"
        self._new: dict[str, list[Any]] = {topic: [] for topic in _FIELDS}
        self._values: dict[str, Array] = {}
        self._closed = threading.Event()
        threading.Thread(target=self._work, name="following", daemon=True).start()

    def first(self) -> Record:
        """Return the first samples, once there are some.

        Raises
        ------
        FileFormatError
            If there are none within a minute.
        """
        end = time.monotonic() + _PATIENCE
        while (record := self.record()) is None:
            if not self.goes_on or time.monotonic() > end:
                raise FileFormatError(f"{self.path}: no samples were recorded in {_PATIENCE:g} s")
            time.sleep(_POLL)
        return record

    def record(self) -> Record | None:
        """Return all samples so far; None if there are none. ``stopped`` is empty while it runs."""
        count = min(map(len, self._new.values()))
        for topic, rows in self._new.items():
            new = np.array(rows[:count], dtype=np.float64)
            del rows[:count]
            if count:
                old = self._values.get(topic)
                self._values[topic] = new if old is None else np.concatenate([old, new])
        if not self._values:
            return None
        sample = self._values[SAMPLE]
        return Record(
            time=sample[:, 0],
            q=self._values[STATES],
            measured=self._values[MEASURED],
            command=self._values[COMMAND],
            pose=sample[:, 1:9],
            desired=sample[:, 9:],
            joint_names=self.robot.joint_names,
            input_names=self.robot.input_names,
            stopped="" if self.goes_on else self._stopped,
        )

    def close(self) -> None:
        """Read no further."""
        self._closed.set()

    def read(self, size: int) -> bytes:
        """Return so many bytes, when they have been written."""
        data = self._file.read(size)
        while len(data) < size and not self._closed.wait(_POLL):
            data += self._file.read(size - len(data))
        return data

    def _work(self) -> None:
        from mcap.exceptions import McapError
        from mcap.reader import NonSeekingReader, make_reader
        from mcap_ros2.decoder import DecoderFactory

        try:
            with open(self.path, "rb") as self._file:
                reader = NonSeekingReader(self, decoder_factories=[DecoderFactory()])  # type: ignore[arg-type]
                for _, channel, _, message in reader.iter_decoded_messages(
                    list(_FIELDS), log_time_order=False
                ):
                    self._new[channel.topic].append(getattr(message, _FIELDS[channel.topic]))
                self._file.seek(0)  # by now the path may lead elsewhere
                for metadata in make_reader(self._file).iter_metadata():
                    self._stopped = metadata.metadata.get("stopped", self._stopped)
        except (McapError, OSError):
            pass  # what was read until then is shown
        finally:
            self.goes_on = False


class LiveRun:
    """A run of a spec in real time, in a thread of its own; its recording is kept only until it is closed.

    Parameters
    ----------
    source
        A spec of one run.

    Raises
    ------
    Error
        If the spec is wrong, or describes several runs.
    """

    label: str
    robot: Robot

    def __init__(self, source: str | Path) -> None:
        setting = prepare(source)
        if not setting.spec.is_single:
            raise ShapeError(f"{source}: describes several runs; only one can be looked at live")
        (case,) = setting.cases
        self.label, self.robot = case.names.label, case.scene.robot
        self.planned: Array = algebra.translation(np.ascontiguousarray(case.scene.samples[:, POSE]))
        world, kept = setting.spec.surroundings, case.variant.law.constraints
        self.constraints: Constraints | None = Constraints(world=world) if kept is None and world else kept
        self.failure: Error | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="dqcontrol-")
        self.path: Path = Path(self._folder.name) / "record.mcap"
        self._setting, self._case = setting, case
        self._recording = RecordStream(self.path, self.robot, setting.single_text(case, 0))
        threading.Thread(target=self._work, name="run", daemon=True).start()

    def close(self) -> None:
        """Remove the recording."""
        self._folder.cleanup()

    def _work(self) -> None:
        try:
            with self._recording:
                execute(self._setting, self._case, clock=Clock(), recording=lambda: self._recording)
        except Error as error:
            self.failure = error
