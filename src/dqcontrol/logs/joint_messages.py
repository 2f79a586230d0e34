"""Joint states, commands and poses out of MCAP files and ROS bags."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.functions import WRITTEN_TOLERANCE
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, from_extra, suggest, unreadable
from dqcontrol.files.input_file import open_regular
from dqcontrol.recording.cdr import layout_of
from dqcontrol.recording.mcap import ChunkMessages, read_records

Stamps = NDArray[np.int64]

JOINTS, POSE, NUMBERS = "sensor_msgs/JointState", "geometry_msgs/PoseStamped", "std_msgs/Float64MultiArray"
WRENCH = "geometry_msgs/WrenchStamped"
_USUAL = "/joint_states"
_MOST_LAYOUTS = 32  # of messages of one topic in a chunk: who publishes more kinds is read message by message


class OpenRecording(NamedTuple):
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
    return _read_numbers(path, names, topic, "joint_topic", "position", (JOINTS,))


def read_commands(path: Path, names: Sequence[str], topic: str) -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and commands (K, m) of the named inputs, rad/s or m/s; raises as `read_joint_states`."""
    return _read_numbers(path, names, topic, "command_topic", "velocity", increasing=False)


def read_targets(path: Path, names: Sequence[str], topic: str) -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and commanded positions (K, n) of the named joints; raises as `read_joint_states`."""
    return _read_numbers(path, names, topic, "target_topic", "position")


def _read_numbers(
    path: Path,
    names: Sequence[str],
    topic: str | None,
    option: str,
    field: str,
    kinds: tuple[str, ...] = (JOINTS, NUMBERS),
    *,
    increasing: bool = True,
) -> tuple[Stamps, Array]:
    """Return stamps and one field of the named joints, or the numbers in their order."""
    with open_messages(path) as messages:
        topic = _choose(path, messages.types, topic, option, kinds)
        by_name = messages.types[topic] == JOINTS
        if by_name and (found := _numbers_by_name(path, topic, names, field, increasing=increasing)):
            return found

        def values(message: Any) -> list[float] | None:
            return _by_name(message, names, field) if by_name else _in_order(message, names)

        return _series(path, topic, messages, values, increasing=increasing)


def read_poses(path: Path, topic: str | None, field: str = "reference_topic") -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and poses (K, 8) of a topic of PoseStamped; raises as `read_joint_states`.

    ``field`` is the option that names the topic, for messages.
    """
    with open_messages(path) as messages:
        kinds = (POSE, JOINTS) if field == "reference_topic" else (POSE,)
        topic = _choose(path, messages.types, topic, field, kinds)
        stamps, rows = _series(path, topic, messages, _position_and_quaternion, increasing=True)
    with np.errstate(over="ignore"):  # the check is for damaged numbers, too
        norms = np.linalg.norm(rows[:, 3:], axis=1)
    for k in np.flatnonzero(np.abs(norms - 1) > WRITTEN_TOLERANCE)[:1]:
        raise FileFormatError(
            f"{path}: {topic}: message {k + 1}: quaternion must have norm 1, got {norms[k]:.9g}"
        )
    return stamps, algebra.pose(rows[:, 3:] / norms[:, None], rows[:, :3])


def read_wrenches(path: Path, topic: str | None) -> tuple[Stamps, Array]:
    """Return stamps (K,), ns, and wrenches (K, 6) of a topic of WrenchStamped; raises as `read_joint_states`."""
    with open_messages(path) as messages:
        topic = _choose(path, messages.types, topic, "wrench_topic", (WRENCH,))
        return _series(path, topic, messages, _force_and_torque, increasing=True)


def holds_joint_states(path: Path, topic: str) -> bool:
    """Whether a topic of a recording is one of joint states; raises as `read_joint_states`."""
    with open_messages(path) as messages:
        return messages.types.get(topic) == JOINTS


def held(stamps: Stamps, values: Array, at: Stamps) -> Array:
    """Return the last values at or before each of the stamps; 0 before the first."""
    before = np.searchsorted(stamps, at, side="right") - 1
    return np.where(before[:, None] < 0, 0.0, values[np.maximum(before, 0)])


@contextmanager
def open_messages(path: Path) -> Iterator[OpenRecording]:
    """Open a recording; whatever reading a damaged one raises becomes a `FileFormatError`."""
    is_file = path.exists() and not path.is_dir()
    try:
        if is_file:
            open_regular(path).close()
        opened = _open_mcap if is_file and path.suffix.lower() == ".mcap" else _open_bag
        with opened(path) as messages:
            yield messages
    except FileFormatError as error:
        text = str(error)
        raise FileFormatError(text if text.startswith(f"{path}") else f"{path}: {text}") from None
    except Error:
        raise
    except OSError as error:
        raise unreadable(path, error) from None
    except Exception as error:  # decoders of damaged bytes raise anything
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise FileFormatError(f"{path}: is not a complete recording ({reason:.200})") from None


@contextmanager
def _open_mcap(path: Path) -> Iterator[OpenRecording]:
    from mcap_ros2.decoder import DecoderFactory

    channels, schemas = _channels(path)
    known = [each for each in channels.values() if each.schema_id in schemas]
    types = {each.topic: _short(schemas[each.schema_id].name) for each in known}

    def read(topic: str) -> Iterator[tuple[int, Any]]:
        found: list[tuple[int, Any]] = []
        for part in _messages(path, channels, topic):
            channel = channels[part.channel]
            decode = DecoderFactory().decoder_for(channel.message_encoding, schemas[channel.schema_id])
            if decode is None:
                raise FileFormatError(f"{path}: {topic}: holds no ROS 2 messages: {channel.message_encoding}")
            places = zip(part.times.tolist(), part.starts, part.sizes, strict=True)
            found += [(time, decode(part.data[at : at + size].tobytes())) for time, at, size in places]
        yield from sorted(found, key=lambda each: each[0])

    yield OpenRecording(types, read)


def _channels(path: Path) -> tuple[dict[int, Any], dict[int, Any]]:
    """Return the channels and schemas of an MCAP file by their numbers; without a summary they are in its chunks."""
    from mcap.records import Channel, Schema

    for inside in (False, True):
        with open_regular(path) as stream:
            records = [
                each for each in read_records(stream, messages=inside) if isinstance(each, Channel | Schema)
            ]
        channels = {each.id: each for each in records if isinstance(each, Channel)}
        if channels:
            break
    return channels, {each.id: each for each in records if isinstance(each, Schema)}


def _messages(path: Path, channels: dict[int, Any], topic: str) -> Iterator[ChunkMessages]:
    """Yield the messages of a topic, chunk by chunk."""
    with open_regular(path) as stream:
        for part in read_records(stream):
            if isinstance(part, ChunkMessages) and channels[part.channel].topic == topic:
                yield part


def _numbers_by_name(
    path: Path, topic: str, names: Sequence[str], field: str, *, increasing: bool = False
) -> tuple[Stamps, Array] | None:
    """Return stamps and one field of the named joints out of an MCAP file, many messages at once.

    None where not all is as usual: read one by one then, which takes a hundred times as long and names what is wrong.
    """
    if path.suffix.lower() != ".mcap":
        return None
    channels, _ = _channels(path)
    parts = []
    for part in _messages(path, channels, topic):
        is_usual = channels[part.channel].message_encoding == "cdr"
        if not is_usual or (found := _part_by_name(part, names, field)) is None:
            return None
        parts.append(found)
    if not sum(len(stamps) for stamps, _ in parts):
        return None
    times, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    if not np.isfinite(values).all() or (increasing and (np.diff(times) <= 0).any()):
        return None
    order = np.argsort(times, kind="stable")
    return times[order], values[order]


def _part_by_name(part: ChunkMessages, names: Sequence[str], field: str) -> tuple[Stamps, Array] | None:
    """Return stamps and values of some messages, in the order of the file."""
    stamps, values = np.zeros(len(part.times), dtype=np.int64), np.zeros((len(part.times), len(names)))
    left, kept = np.ones(len(part.times), dtype=bool), np.zeros(len(part.times), dtype=bool)
    for _ in range(_MOST_LAYOUTS):
        rest = part.chosen(left)
        if not len(rest.times):
            return stamps[kept], values[kept]
        try:
            layout = layout_of(JOINTS, rest.first())
        except ValueError:
            return None
        alike = rest.alike(layout)
        which = np.flatnonzero(left)[alike]
        left[which] = False
        if set(names).isdisjoint(layout.names):
            continue
        if not set(names) <= set(layout.names) or layout.fields[field][1] != len(layout.names):
            return None
        same = rest.chosen(alike)
        values[which] = same.floats(layout, field)[:, [layout.names.index(name) for name in names]]
        seconds, nanoseconds = same.part(4, 12).view("<u4").astype(np.int64).T
        said = seconds * 10**9 + nanoseconds
        stamps[which], kept[which] = np.where(said == 0, same.times, said), True
    return None


@contextmanager
def _open_bag(path: Path) -> Iterator[OpenRecording]:
    if not path.exists():
        raise unreadable(path, FileNotFoundError())
    if path.suffix.lower() == ".db3" and path.is_file():
        raise FileFormatError(f"{path}: is a part of a ROS 2 bag; give its folder, with metadata.yaml in it")
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise FileFormatError(f"{path}: is no ROS 2 bag: it holds no metadata.yaml")
    what = f"bags, as {path},"
    highlevel, typesys = (from_extra(f"rosbags.{part}", "data", what) for part in ("highlevel", "typesys"))
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    with highlevel.AnyReader([path], default_typestore=store) as reader:

        def read(topic: str) -> Iterator[tuple[int, Any]]:
            chosen = [connection for connection in reader.connections if connection.topic == topic]
            for connection, stamp, data in reader.messages(chosen):
                yield stamp, reader.deserialize(data, connection.msgtype)

        yield OpenRecording({c.topic: _short(c.msgtype) for c in reader.connections}, read)


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
    messages: OpenRecording,
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


def _force_and_torque(message: Any) -> list[float]:
    force, torque = message.wrench.force, message.wrench.torque
    return [force.x, force.y, force.z, torque.x, torque.y, torque.z]


def _position_and_quaternion(message: Any) -> list[float]:
    p, r = message.pose.position, message.pose.orientation
    return [p.x, p.y, p.z, r.w, r.x, r.y, r.z]
