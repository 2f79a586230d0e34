"""Records as MCAP files of standard ROS 2 messages: Foxglove and ``ros2 bag`` read them, and nothing is lost.

==============================  ============================  ===============================================
topic                           type                          holds
==============================  ============================  ===============================================
``/joint_states``               sensor_msgs/JointState        true configuration, velocity until the next one
``/measured_joint_states``      sensor_msgs/JointState        configuration as the law saw it
``/joint_command``              sensor_msgs/JointState        inputs, in the velocity field
``/hand/pose``                  geometry_msgs/PoseStamped     end pose
``/hand/desired``               geometry_msgs/PoseStamped     desired pose
``/hand/desired_twist``         geometry_msgs/TwistStamped    desired ṗ and ω, inertial frame
``/hand/desired_acceleration``  geometry_msgs/AccelStamped    desired p̈ and ω̇, inertial frame
``/disturbance``                geometry_msgs/TwistStamped    inertial twist of a disturbance, if there was one:
                                                              ω, and velocity of the point at the origin
``/error``                      std_msgs/Float64              |1 − x* x_d|
``/readings/NAME``              std_msgs/Float64MultiArray    what else the plant sensed, if it did
``/dqcontrol/sample``           std_msgs/Float64MultiArray    exact time, pose (8), reference sample (21)
==============================  ============================  ===============================================

Position and quaternion of a pose cannot give its eight numbers back to the last bit, nor nanoseconds the
time; the last topic can. The metadata record ``dqcontrol`` holds names, stop reason, version, the spec's
text, and names and units of the readings' numbers. A recording that is written while the robot moves says how many
samples it has in a record ``dqcontrol_end`` when it ends; if it was cut off, it is read as far as it goes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ExistsError, FileFormatError
from dqcontrol.files.whole_file import whole_file
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.mcap_topics import COMMAND, DISTURBANCE, MEASURED, READINGS, SAMPLE, STATES
from dqcontrol.recording.mcap_writer import END, FORMAT, METADATA, SampleWriter, about

Array = NDArray[np.float64]
T = TypeVar("T")


def save_record(record: Record, path: str | Path, spec: str = "") -> Path:
    """Write a record as an MCAP file, in compressed chunks; the file appears whole or not at all.

    Parameters
    ----------
    record
        The run.
    path
        A file that does not exist yet; missing folders are made.
    spec
        Text of the experiment, kept with the data.

    Returns
    -------
    The path.

    Raises
    ------
    ExistsError
        If the file exists.

    Examples
    --------
    >>> save_record(run.record, "out/record.mcap")  # doctest: +SKIP
    """
    path = Path(path)
    if path.exists():
        raise ExistsError(f"{path}: exists already; choose another name or remove it")
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as draft, open(draft, "xb") as stream:
        _write(stream, record, spec)
        stream.flush()
        os.fsync(stream.fileno())
    return path


def load_record(path: str | Path) -> Record:
    """Read a record back, equal to the saved one to the last bit.

    Parameters
    ----------
    path
        A file written by `save_record`.

    Raises
    ------
    FileFormatError
        If the file is missing, damaged, cut short, or not a record. One that a `RecordStream` did not end is read as
        far as it goes, and says so in ``stopped``.

    Examples
    --------
    >>> record = load_record("out/record.mcap")  # doctest: +SKIP
    """
    return _read(path, _record)


def load_metadata(path: str | Path) -> dict[str, str]:
    """Return what a record's file says about itself.

    Keys: ``format``, ``version`` (of dqcontrol), ``samples``, ``joint_names`` and ``input_names`` (JSON
    lists), ``stopped``, ``spec``. Raises `FileFormatError` as `load_record` does.
    """
    return _read(path, _metadata)


def _write(stream: IO[bytes], record: Record, spec: str) -> None:
    writer = SampleWriter(stream)
    metadata = about(record.joint_names, record.input_names, spec, list(record.readings.values()))
    writer.file.add_metadata(METADATA, metadata | {"samples": str(len(record)), "stopped": record.stopped})
    writer.write(record, len(record), min(0.0, float(record.time[0])))
    writer.file.finish()


def _read(path: str | Path, parse: Callable[[Any], T]) -> T:
    """Open a file, parse it, and word whatever a damaged one raises."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    try:
        with open(path, "rb") as stream:
            try:
                return parse(make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()]))
            except (FileFormatError, OSError):
                raise
            except Exception:
                if not _is_cut_off(stream):
                    raise
                return parse(CutOff(stream))
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # decoders of damaged bytes raise anything
        raise FileFormatError(
            f"{path}: is no whole MCAP recording ({type(error).__name__}: {error})"
        ) from None


class CutOff:
    """Reads a recording without an end as far as it goes, as the library's readers do."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream

    def _reader(self) -> Any:
        from mcap.reader import NonSeekingReader
        from mcap_ros2.decoder import DecoderFactory

        self._stream.seek(0)
        return NonSeekingReader(self._stream, validate_crcs=True, decoder_factories=[DecoderFactory()])

    def iter_metadata(self) -> Iterator[Any]:
        """Yield the metadata."""
        with suppress(Exception):
            yield from self._reader().iter_metadata()

    def iter_decoded_messages(self, topics: list[str], *, log_time_order: bool) -> Iterator[Any]:
        """Yield the messages of all whole chunks."""
        with suppress(Exception):
            yield from self._reader().iter_decoded_messages(topics, log_time_order=log_time_order)


def _is_cut_off(stream: Any) -> bool:
    """Tell whether a file was written while the robot moved, and has no end."""
    for metadata in CutOff(stream).iter_metadata():
        if metadata.name == METADATA:
            return "samples" not in metadata.metadata
    return False


def _metadata(reader: Any) -> dict[str, str]:
    found: dict[str, str] = {}
    for metadata in reader.iter_metadata():
        if metadata.name == METADATA:
            if metadata.metadata["format"] != FORMAT:
                raise FileFormatError(
                    f"has record format {metadata.metadata['format']}, this version reads {FORMAT}"
                )
            found |= metadata.metadata
        elif metadata.name == END:
            found |= metadata.metadata
    if not found:
        raise FileFormatError("is no record of dqcontrol: it lacks the metadata 'dqcontrol'")
    return found


def _record(reader: Any) -> Record:
    metadata = _metadata(reader)
    fields = {STATES: "position", MEASURED: "position", COMMAND: "velocity", SAMPLE: "data"}
    readings = {name: (parts, units) for name, parts, units in json.loads(metadata.get("readings", "[]"))}
    fields |= {READINGS + name: "data" for name in readings}
    rows: dict[str, list[Any]] = {topic: [] for topic in fields}
    pushes: list[list[float]] = []
    for _, channel, _, message in reader.iter_decoded_messages([*fields, DISTURBANCE], log_time_order=False):
        if channel.topic == DISTURBANCE:
            angular, linear = message.twist.angular, message.twist.linear
            pushes.append([angular.x, angular.y, angular.z, linear.x, linear.y, linear.z])
        else:
            rows[channel.topic].append(getattr(message, fields[channel.topic]))
    if not isinstance(reader, CutOff):
        count, stopped = int(metadata["samples"]), metadata["stopped"]
    else:
        count = min(map(len, rows.values()))
        if not count:
            raise FileFormatError("was cut off before its first samples were written")
        stopped = f"cut off at {rows[SAMPLE][count - 1][0]:g} s: the recording has no end"
        rows = {topic: values[:count] for topic, values in rows.items()}
    for topic, values in rows.items():
        if len(values) != count:
            raise FileFormatError(f"{topic}: expected {count} messages, got {len(values)}")
    if len(pushes) not in (0, count):
        raise FileFormatError(f"{DISTURBANCE}: expected {count} messages, got {len(pushes)}")
    values = {topic: np.array(rows[topic], dtype=np.float64).reshape(count, -1) for topic in fields}
    sample = values[SAMPLE]
    return Record(
        time=sample[:, 0],
        q=values[STATES],
        measured=values[MEASURED],
        command=values[COMMAND],
        pose=sample[:, 1:9],
        desired=sample[:, 9:],
        joint_names=tuple(json.loads(metadata["joint_names"])),
        input_names=tuple(json.loads(metadata["input_names"])),
        stopped=stopped,
        disturbance=np.array(pushes) if pushes else None,
        readings={
            name: Signal(name, tuple(parts), tuple(units), values[READINGS + name])
            for name, (parts, units) in readings.items()
        },
    )
