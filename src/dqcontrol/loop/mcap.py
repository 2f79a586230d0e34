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
text, and names and units of the readings' numbers.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dqcontrol.errors import ExistsError, FileFormatError
from dqcontrol.loop.mcap_topics import (
    COMMAND,
    DISTURBANCE,
    MEASURED,
    NUMBERS,
    READINGS,
    SAMPLE,
    STATES,
    TOPICS,
    columns_of,
)
from dqcontrol.loop.message_types import definition, full_name
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal

Array = NDArray[np.float64]
T = TypeVar("T")

FORMAT = "1"
_METADATA = "dqcontrol"
_FRAME = "world"


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
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with open(temporary, "xb") as stream:
            _write(stream, record, spec)
            stream.flush()
            os.fsync(stream.fileno())
        if path.exists():
            raise ExistsError(f"{path}: appeared meanwhile; choose another name")
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
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
        If the file is missing, damaged, cut short, or not a record.

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


def _write(stream: Any, record: Record, spec: str) -> None:
    from mcap_ros2.writer import Writer

    from dqcontrol import __version__

    with Writer(stream) as writer:
        metadata = {
            "format": FORMAT,
            "version": __version__,
            "samples": str(len(record)),
            "joint_names": json.dumps(record.joint_names, ensure_ascii=False),
            "input_names": json.dumps(record.input_names, ensure_ascii=False),
            "stopped": record.stopped,
            "spec": spec,
            "readings": json.dumps([s[:3] for s in record.readings.values()], ensure_ascii=False),
        }
        writer.add_metadata(_METADATA, metadata)
        schemas = {
            kind: writer.register_msgdef(full_name(kind), definition(kind)) for kind in set(TOPICS.values())
        }
        first = min(0.0, float(record.time[0]))  # MCAP has no negative times
        columns = columns_of(record)
        topics = {topic: TOPICS.get(topic, NUMBERS) for topic in columns}
        for k, time in enumerate(record.time.tolist()):
            stamp = round((time - first) * 1e9)
            header = {
                "stamp": dict(zip(("sec", "nanosec"), divmod(stamp, 10**9), strict=True)),
                "frame_id": _FRAME,
            }
            for topic, kind in topics.items():
                message = columns[topic](k)
                message["header"] = header
                writer.write_message(topic, schemas[kind], message, log_time=stamp, sequence=k)


def _read(path: str | Path, parse: Callable[[Any], T]) -> T:
    """Open a file, parse it, and word whatever a damaged one raises."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    try:
        with open(path, "rb") as stream:
            return parse(make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()]))
    except FileFormatError as error:
        raise FileFormatError(f"{path}: {error}") from None
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # decoders of damaged bytes raise anything
        raise FileFormatError(
            f"{path}: is no whole MCAP recording ({type(error).__name__}: {error})"
        ) from None


def _metadata(reader: Any) -> dict[str, str]:
    for metadata in reader.iter_metadata():
        if metadata.name == _METADATA:
            if metadata.metadata["format"] != FORMAT:
                raise FileFormatError(
                    f"has record format {metadata.metadata['format']}, this version reads {FORMAT}"
                )
            return metadata.metadata
    raise FileFormatError("is no record of dqcontrol: it lacks the metadata 'dqcontrol'")


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
    count = int(metadata["samples"])
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
        stopped=metadata["stopped"],
        disturbance=np.array(pushes) if pushes else None,
        readings={
            name: Signal(name, tuple(parts), tuple(units), values[READINGS + name])
            for name, (parts, units) in readings.items()
        },
    )
