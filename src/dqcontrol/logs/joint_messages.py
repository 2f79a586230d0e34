"""Joint states, commands and poses out of MCAP files and ROS bags."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.batch import WRITTEN_TOLERANCE
from dqcontrol.errors import Error, FileFormatError, MissingExtraError, suggest

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

JOINTS, POSE, NUMBERS = "sensor_msgs/JointState", "geometry_msgs/PoseStamped", "std_msgs/Float64MultiArray"
_USUAL = "/joint_states"


class Messages(NamedTuple):
    """An open recording.

    Attributes
    ----------
    types
        Type of the messages by topic, as ``"sensor_msgs/JointState"``.
    read
        Yields the time of recording (ns) and the message, for all of one topic, in the order of that time.
    """

    types: dict[str, str]
    read: Callable[[str], Iterator[tuple[int, Any]]]


def is_recording(path: Path) -> bool:
    """Whether a path names a recording: an MCAP file, a ROS 1 bag, or the folder or database of a ROS 2 bag."""
    return path.suffix.lower() in (".mcap", ".bag", ".db3") or path.is_dir()


def read_joint_states(path: Path, names: Sequence[str], topic: str | None = None) -> tuple[Stamps, Array]:
    """Return stamps (N,), ns, and the positions (N, n) of the named joints, rad or m.

    Raises
    ------
    FileFormatError
        If there is no such topic, a joint is missing, a number is not finite, or the stamps do not increase.
    MissingExtraError
        If rosbags is needed and not installed.
    """
    with open_messages(path) as messages:
        topic = _choose(path, messages.types, topic, "joint_topic", (JOINTS,))
        return _series(
            path, topic, messages, lambda message: _by_name(message, names, "position"), increasing=True
        )


def read_commands(path: Path, names: Sequence[str], topic: str) -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and commands (K, m) of the named inputs, rad/s or m/s; raises as `read_joint_states`."""
    with open_messages(path) as messages:
        topic = _choose(path, messages.types, topic, "command_topic", (JOINTS, NUMBERS))
        if messages.types[topic] == JOINTS:
            return _series(path, topic, messages, lambda message: _by_name(message, names, "velocity"))
        return _series(path, topic, messages, lambda message: _in_order(message, names))


def read_poses(path: Path, topic: str) -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and poses (K, 8) of a topic of PoseStamped; raises as `read_joint_states`."""
    with open_messages(path) as messages:
        topic = _choose(path, messages.types, topic, "reference_topic", (POSE,))
        stamps, rows = _series(path, topic, messages, _position_and_quaternion, increasing=True)
    with np.errstate(over="ignore"):  # the check is for damaged numbers, too
        norms = np.linalg.norm(rows[:, 3:], axis=1)
    for k in np.flatnonzero(np.abs(norms - 1) > WRITTEN_TOLERANCE)[:1]:
        raise FileFormatError(
            f"{path}: {topic}: message {k + 1}: quaternion must have norm 1, got {norms[k]:.9g}"
        )
    return stamps, algebra.pose(rows[:, 3:] / norms[:, None], rows[:, :3])


def held(stamps: Stamps, values: Array, at: Stamps) -> Array:
    """Return the last values at or before each of the stamps; 0 before the first."""
    before = np.searchsorted(stamps, at, side="right") - 1
    return np.where(before[:, None] < 0, 0.0, values[np.maximum(before, 0)])


@contextmanager
def open_messages(path: Path) -> Iterator[Messages]:
    """Open a recording; whatever reading a damaged one raises becomes a `FileFormatError`."""
    opened = _open_mcap if path.suffix.lower() == ".mcap" and path.is_file() else _open_bag
    try:
        with opened(path) as messages:
            yield messages
    except Error:
        raise
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # decoders of damaged bytes raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise FileFormatError(f"{path}: is no whole recording ({reason:.200})") from None


@contextmanager
def _open_mcap(path: Path) -> Iterator[Messages]:
    from mcap.exceptions import DecoderNotFoundError
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        if summary is not None and summary.channels:
            pairs = (
                (channel, summary.schemas.get(channel.schema_id)) for channel in summary.channels.values()
            )
        else:  # a recorder that was killed wrote none
            pairs = ((channel, schema) for schema, channel, _ in reader.iter_messages())
        types = {channel.topic: _short(schema.name) for channel, schema in pairs if schema is not None}

        def read(topic: str) -> Iterator[tuple[int, Any]]:
            try:
                for _, _, message, decoded in reader.iter_decoded_messages([topic]):
                    yield message.log_time, decoded
            except DecoderNotFoundError as error:
                raise FileFormatError(f"{path}: {topic}: holds no ROS 2 messages: {error}") from None

        yield Messages(types, read)


@contextmanager
def _open_bag(path: Path) -> Iterator[Messages]:
    if not path.exists():
        raise FileFormatError(
            f"{path}: no such file{suggest(path.name, [p.name for p in path.parent.glob('*')])}"
        )
    if path.suffix.lower() == ".db3" and path.is_file():
        raise FileFormatError(f"{path}: is a part of a ROS 2 bag; give its folder, with metadata.yaml in it")
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise FileFormatError(f"{path}: is no ROS 2 bag: it holds no metadata.yaml")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError(
            f"rosbags: is needed for {path} and not installed; install it with: pip install 'dqcontrol[data]'"
        ) from None
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:

        def read(topic: str) -> Iterator[tuple[int, Any]]:
            chosen = [connection for connection in reader.connections if connection.topic == topic]
            for connection, stamp, data in reader.messages(chosen):
                yield stamp, reader.deserialize(data, connection.msgtype)

        yield Messages({c.topic: _short(c.msgtype) for c in reader.connections}, read)


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


def _choose(path: Path, types: dict[str, str], topic: str | None, field: str, wanted: tuple[str, ...]) -> str:
    """Return the topic asked for, or the usual or only one of its type."""
    fitting = sorted(name for name, kind in types.items() if kind in wanted)
    option = f"--{field.replace('_', '-')}"
    if topic is None:
        if len(fitting) > 1 and _USUAL not in fitting:
            raise FileFormatError(
                f"{path}: several topics of {wanted[0]}; choose one with {option}: {', '.join(fitting)}"
            )
        if not fitting:
            raise FileFormatError(
                f"{path}: has no topic of {wanted[0]} (topics: {', '.join(sorted(types)) or 'none'})"
            )
        return _USUAL if _USUAL in fitting else fitting[0]
    if topic not in types:
        listed = ", ".join(fitting) or "none"
        raise FileFormatError(
            f"{path}: no topic '{topic}'{suggest(topic, types)} (topics of {' or '.join(wanted)}: {listed})"
        )
    if types[topic] not in wanted:
        raise FileFormatError(f"{path}: {topic} holds {types[topic]}; {option} needs {' or '.join(wanted)}")
    return topic


def _series(
    path: Path,
    topic: str,
    messages: Messages,
    values: Callable[[Any], list[float] | None],
    *,
    increasing: bool = False,
) -> tuple[Stamps, Array]:
    """Return stamps and values of all messages that have some; sorted by stamp unless that is asked to increase."""
    stamps, rows = [], []
    for count, (recorded, message) in enumerate(messages.read(topic), start=1):
        where = f"{path}: {topic}: message {count}"
        try:
            row = values(message)
        except ValueError as error:
            raise FileFormatError(f"{where}: {error}") from None
        if row is None:
            continue
        if not np.isfinite(row).all():
            raise FileFormatError(f"{where}: must be finite, got {row}")
        stamp = _stamp(message) or recorded
        if increasing and stamps and stamp <= stamps[-1]:
            raise FileFormatError(
                f"{where}: time must increase, got {(stamp - stamps[-1]) / 1e9:.9g} s after the message before it"
            )
        stamps.append(stamp)
        rows.append(row)
    if not rows:
        raise FileFormatError(f"{path}: {topic}: has no message, or none of these joints")
    order = np.argsort(stamps, kind="stable")
    return np.array(stamps, dtype=np.int64)[order], np.array(rows, dtype=np.float64)[order]


def _stamp(message: Any) -> int:
    """Return the stamp in the header, ns; 0 without one."""
    header = getattr(message, "header", None)
    return header.stamp.sec * 10**9 + header.stamp.nanosec if header is not None else 0


def _by_name(message: Any, names: Sequence[str], field: str) -> list[float] | None:
    """Return one field of the named joints, or None if the message is about other joints."""
    found, values = list(message.name), getattr(message, field)
    if not set(names) & set(found):
        return None
    missing = [name for name in names if name not in found]
    if missing:
        listed = " ".join(", ".join(found).split())
        raise ValueError(f"joints missing: {', '.join(missing)} (it has {listed:.200})")
    if len(values) != len(found):
        raise ValueError(f"{field}: expected {len(found)} numbers as there are names, got {len(values)}")
    return [float(values[found.index(name)]) for name in names]


def _in_order(message: Any, names: Sequence[str]) -> list[float]:
    if len(message.data) != len(names):
        raise ValueError(f"data: expected {len(names)} numbers, one for each input, got {len(message.data)}")
    return [float(value) for value in message.data]


def _position_and_quaternion(message: Any) -> list[float]:
    p, r = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, r.w, r.x, r.y, r.z]
