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
``/dqcontrol/sample``           std_msgs/Float64MultiArray    exact time, pose (8), reference sample (21)
==============================  ============================  ===============================================

Position and quaternion of a pose cannot give its eight numbers back to the last bit, nor nanoseconds the
time; the last topic can. The metadata record ``dqcontrol`` holds names, stop reason, version and the spec's
text.
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
from dqcontrol.loop.message_types import definition, full_name
from dqcontrol.loop.record import Record
from dqcontrol.references.sample import TWIST, TWIST_RATE

Array = NDArray[np.float64]
T = TypeVar("T")

FORMAT = "1"
_METADATA = "dqcontrol"
_FRAME = "world"
_STATES, _MEASURED, _COMMAND, _DISTURBANCE, _SAMPLE = (
    "/joint_states",
    "/measured_joint_states",
    "/joint_command",
    "/disturbance",
    "/dqcontrol/sample",
)

_TOPICS = {
    _STATES: "sensor_msgs/JointState",
    _MEASURED: "sensor_msgs/JointState",
    _COMMAND: "sensor_msgs/JointState",
    "/hand/pose": "geometry_msgs/PoseStamped",
    "/hand/desired": "geometry_msgs/PoseStamped",
    "/hand/desired_twist": "geometry_msgs/TwistStamped",
    "/hand/desired_acceleration": "geometry_msgs/AccelStamped",
    _DISTURBANCE: "geometry_msgs/TwistStamped",
    "/error": "std_msgs/Float64",
    _SAMPLE: "std_msgs/Float64MultiArray",
}


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
        }
        writer.add_metadata(_METADATA, metadata)
        schemas = {
            kind: writer.register_msgdef(full_name(kind), definition(kind)) for kind in set(_TOPICS.values())
        }
        first = min(0.0, float(record.time[0]))  # MCAP has no negative times
        columns = _columns(record)
        topics = {topic: kind for topic, kind in _TOPICS.items() if topic in columns}
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


def _columns(record: Record) -> dict[str, Callable[[int], dict[str, Any]]]:
    """Return for each topic the function that makes the message of one sample."""
    q, measured, command = record.q.tolist(), record.measured.tolist(), record.command.tolist()
    joints, inputs = list(record.joint_names), list(record.input_names)
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        speed = np.zeros_like(record.q)
        speed[:-1] = np.diff(record.q, axis=0) / np.diff(record.time)[:, None]
        linear, acceleration = _hand_motion(record)
    speeds, sample = speed.tolist(), np.column_stack([record.time, record.pose, record.desired]).tolist()
    layout = {"dim": [{"label": "time, pose, desired", "size": len(sample[0]), "stride": len(sample[0])}]}
    twist = _vectors(linear, record.desired[:, TWIST][:, :3])
    accel = _vectors(acceleration, record.desired[:, TWIST_RATE][:, :3])
    pose, desired = _poses(record.position, record.pose), _poses(record.desired_position, record.desired_pose)
    error = record.error.tolist()
    columns: dict[str, Callable[[int], dict[str, Any]]] = {
        _STATES: lambda k: {"name": joints, "position": q[k], "velocity": speeds[k]},
        _MEASURED: lambda k: {"name": joints, "position": measured[k]},
        _COMMAND: lambda k: {"name": inputs, "velocity": command[k]},
        "/hand/pose": lambda k: {"pose": pose[k]},
        "/hand/desired": lambda k: {"pose": desired[k]},
        "/hand/desired_twist": lambda k: {"twist": twist[k]},
        "/hand/desired_acceleration": lambda k: {"accel": accel[k]},
        "/error": lambda k: {"data": error[k]},
        _SAMPLE: lambda k: {"layout": layout, "data": sample[k]},
    }
    if record.disturbance is not None:
        pushes = _vectors(record.disturbance[:, 3:], record.disturbance[:, :3])
        columns[_DISTURBANCE] = lambda k: {"twist": pushes[k]}
    return columns


def _hand_motion(record: Record) -> tuple[Array, Array]:
    """Return ṗ_d = v − p × ω and p̈_d = v̇ − ṗ × ω − p × ω̇ of the reference."""
    twist, rate, p = record.desired[:, TWIST], record.desired[:, TWIST_RATE], record.desired_position
    velocity = twist[:, 3:] - np.cross(p, twist[:, :3])
    return velocity, rate[:, 3:] - np.cross(velocity, twist[:, :3]) - np.cross(p, rate[:, :3])


def _vectors(linear: Array, angular: Array) -> list[dict[str, Any]]:
    return [
        {"linear": _xyz(a), "angular": _xyz(b)}
        for a, b in zip(linear.tolist(), angular.tolist(), strict=True)
    ]


def _poses(position: Array, pose: Array) -> list[dict[str, Any]]:
    return [
        {"position": _xyz(p), "orientation": {"w": r[0], "x": r[1], "y": r[2], "z": r[3]}}
        for p, r in zip(position.tolist(), pose.tolist(), strict=True)
    ]


def _xyz(v: list[float]) -> dict[str, float]:
    return {"x": v[0], "y": v[1], "z": v[2]}


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
    fields = {_STATES: "position", _MEASURED: "position", _COMMAND: "velocity", _SAMPLE: "data"}
    rows: dict[str, list[Any]] = {topic: [] for topic in fields}
    pushes: list[list[float]] = []
    for _, channel, _, message in reader.iter_decoded_messages([*fields, _DISTURBANCE], log_time_order=False):
        if channel.topic == _DISTURBANCE:
            angular, linear = message.twist.angular, message.twist.linear
            pushes.append([angular.x, angular.y, angular.z, linear.x, linear.y, linear.z])
        else:
            rows[channel.topic].append(getattr(message, fields[channel.topic]))
    count = int(metadata["samples"])
    for topic, values in rows.items():
        if len(values) != count:
            raise FileFormatError(f"{topic}: expected {count} messages, got {len(values)}")
    if len(pushes) not in (0, count):
        raise FileFormatError(f"{_DISTURBANCE}: expected {count} messages, got {len(pushes)}")
    q, measured, command, sample = (
        np.array(rows[topic], dtype=np.float64).reshape(count, -1) for topic in fields
    )
    return Record(
        time=sample[:, 0],
        q=q,
        measured=measured,
        command=command,
        pose=sample[:, 1:9],
        desired=sample[:, 9:],
        joint_names=tuple(json.loads(metadata["joint_names"])),
        input_names=tuple(json.loads(metadata["input_names"])),
        stopped=metadata["stopped"],
        disturbance=np.array(pushes) if pushes else None,
    )
