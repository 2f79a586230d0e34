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
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ExistsError, FileFormatError, writing
from dqcontrol.files.input_file import open_regular
from dqcontrol.files.whole_file import whole_file
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.supervision import BlackBox
from dqcontrol.recording import mcap_writer
from dqcontrol.recording.cdr import Layout, layout_of
from dqcontrol.recording.mcap_reader import ChunkMessages, read_records

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
        A file written by `save_record`, or the folder of a run, which holds it as ``record.mcap``.

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
    return _read(path, lambda found: found.metadata, messages=False)


def _write(stream: IO[bytes], record: Record, spec: str) -> None:
    writer = mcap_writer.SampleWriter(stream)
    metadata = mcap_writer.about(record.joint_names, record.input_names, spec, list(record.readings.values()))
    writer.add_metadata(
        mcap_writer.METADATA, metadata | {"samples": str(len(record)), "stopped": record.stopped}
    )
    writer.write(record, len(record), min(0.0, float(record.time[0])))
    writer.finish()


def _read(path: str | Path, parse: Callable[[_Contents], T], *, messages: bool = True) -> T:
    """Read a file, make something of it, and word whatever a damaged one raises."""
    if Path(path).is_dir():
        path = Path(path) / "record.mcap"
    try:
        with open_regular(path) as stream:
            return parse(_Contents(read_records(stream, messages=messages)))
    except (FileFormatError, EOFError) as error:
        raise FileFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # parsing damaged bytes raises anything
        raise FileFormatError(
            f"{path}: is not a complete MCAP file ({type(error).__name__}: {error})"
        ) from None


class _Contents:
    """What the records of a file say and hold.

    Attributes
    ----------
    rows
        Numbers of all messages of a topic, in parts of shape (k, size).
    is_cut_off
        Whether it was written while a robot moved, and never ended.
    """

    def __init__(self, records: Iterator[Any]) -> None:
        from mcap.records import Channel, Metadata

        self._about: dict[str, str] = {}
        self._topics: dict[int, str] = {}
        self._layouts: dict[str, Layout] = {}
        self.rows: dict[str, list[Array]] = {}
        self.is_cut_off, streamed = False, False
        try:
            for record in records:
                if isinstance(record, ChunkMessages):
                    self._take(record)
                elif isinstance(record, Channel):
                    self._topics[record.id] = record.topic
                elif isinstance(record, Metadata) and record.name in (mcap_writer.METADATA, mcap_writer.END):
                    streamed = streamed or (
                        record.name == mcap_writer.METADATA and "samples" not in record.metadata
                    )
                    self._about |= record.metadata
        except OSError:
            raise
        except Exception:
            if not streamed:
                raise
            self.is_cut_off = True

    @property
    def metadata(self) -> dict[str, str]:
        """What the file says about itself."""
        if not self._about:
            raise FileFormatError("is no record of dqcontrol: it lacks the metadata 'dqcontrol'")
        if self._about["format"] != mcap_writer.FORMAT:
            raise FileFormatError(
                f"has record format {self._about['format']}, this version reads {mcap_writer.FORMAT}"
            )
        return self._about

    def _take(self, messages: ChunkMessages) -> None:
        """Keep the numbers of messages of one topic."""
        topic = self._topics[messages.channel]
        kind, field = _FIELDS.get(
            topic, (mcap_writer.NUMBERS, "data") if topic.startswith(mcap_writer.READINGS) else ("", "")
        )
        if not kind:
            return
        layout = self._layouts.setdefault(topic, layout_of(kind, messages.first()))
        if not messages.alike(layout).all():
            raise FileFormatError(f"{topic}: has messages of different forms")
        self.rows.setdefault(topic, []).append(messages.floats(layout, field))


_FIELDS = {
    mcap_writer.STATES: ("sensor_msgs/JointState", "position"),
    mcap_writer.MEASURED: ("sensor_msgs/JointState", "position"),
    mcap_writer.COMMAND: ("sensor_msgs/JointState", "velocity"),
    mcap_writer.SAMPLE: (mcap_writer.NUMBERS, "data"),
    mcap_writer.DISTURBANCE: ("geometry_msgs/TwistStamped", "data"),
}


def _record(found: _Contents) -> Record:
    metadata = found.metadata
    joints, inputs = _names(metadata, "joint_names"), _names(metadata, "input_names")
    readings = {name: (parts, units) for name, parts, units in json.loads(metadata.get("readings", "[]"))}
    topics = [
        mcap_writer.STATES,
        mcap_writer.MEASURED,
        mcap_writer.COMMAND,
        mcap_writer.SAMPLE,
        *(mcap_writer.READINGS + name for name in readings),
    ]
    values = {}
    for topic in [*topics, mcap_writer.DISTURBANCE] if mcap_writer.DISTURBANCE in found.rows else topics:
        parts = found.rows.pop(topic, [])
        values[topic] = np.concatenate(parts) if parts else np.zeros((0, 0))
    if not found.is_cut_off:
        count, stopped = int(metadata["samples"]), metadata["stopped"]
    else:
        count = min(map(len, values.values()))
        if not count:
            raise FileFormatError("was cut off before its first samples were written")
        stopped = f"cut off at {values[mcap_writer.SAMPLE][count - 1, 0]:g} s: the recording has no end"
        values = {topic: each[:count] for topic, each in values.items()}
    for topic, each in values.items():
        if len(each) != count:
            raise FileFormatError(f"{topic}: expected {count} messages, got {len(each)}")
    sample = values[mcap_writer.SAMPLE]
    return Record(
        time=sample[:, 0],
        q=values[mcap_writer.STATES],
        measured=values[mcap_writer.MEASURED],
        command=values[mcap_writer.COMMAND],
        pose=sample[:, 1:9],
        desired=sample[:, 9:],
        joint_names=joints,
        input_names=inputs,
        stopped=stopped,
        disturbance=values[mcap_writer.DISTURBANCE][:, [3, 4, 5, 0, 1, 2]]
        if mcap_writer.DISTURBANCE in values
        else None,
        readings={
            name: Signal(name, tuple(parts), tuple(units), values[mcap_writer.READINGS + name])
            for name, (parts, units) in readings.items()
        },
    )


def _names(metadata: dict[str, str], key: str) -> tuple[str, ...]:
    names = json.loads(metadata[key])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise FileFormatError(f"{key}: expected a list of names, got {names!r:.80}")
    return tuple(names)


FOLDER = "black-box"  # its name in a folder of results


def save_black_box(black_box: BlackBox, folder: str | Path, spec: str, stopped: str) -> Path:
    """Write it as a folder that `dqcontrol figures` and ``view`` read; a number is added if there is one already.

    Parameters
    ----------
    black_box
        With at least one sample.
    folder
        Wanted name.
    spec
        Text of the experiment.
    stopped
        Why the robot stopped.

    Returns
    -------
    The folder.

    Raises
    ------
    Error
        If it holds nothing, or cannot be written.

    Examples
    --------
    >>> save_black_box(supervision.black_box, "out/black-box", spec, trace.stopped)  # doctest: +SKIP
    """
    return save_last_seconds(black_box.record(stopped), folder, spec)


def save_last_seconds(record: Record, folder: str | Path, spec: str) -> Path:
    """Do the same with what `BlackBox.record` gave, which may take seconds."""
    path, number = Path(folder), 1
    with writing(folder):
        while path.exists():
            number += 1
            path = Path(f"{folder}-{number}")
        path.mkdir(parents=True)
        (path / "spec.yaml").write_text(spec, encoding="utf-8")
        save_record(record, path / "record.mcap", spec)
    return path
