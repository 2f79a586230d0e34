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

Messages are read by hand, although there is a library: it makes an object of each and decodes it number by number,
which took 151 s for a run of 300 001 samples; this takes 3 s. Records other than messages are left to the library.
"""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import kernel, types
from dqcontrol.errors import ExistsError, FileFormatError, unreadable, writing
from dqcontrol.files.input_file import open_regular
from dqcontrol.files.output_file import whole_file
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.loop.supervision import BlackBox
from dqcontrol.recording.cdr import Layout, layout_of
from dqcontrol.recording.mcap_writer import (
    COMMAND,
    DISTURBANCE,
    END,
    FORMAT,
    MEASURED,
    METADATA,
    NUMBERS,
    READINGS,
    SAMPLE,
    STATES,
    SampleWriter,
    about,
)

T = TypeVar("T")
Bytes = NDArray[np.uint8]

LARGEST_CHUNK = 1 << 28  # bytes, uncompressed; recorders write some MB
_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _FOOTER = 3, 4, 5, 6, 12, 2

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_TABLE = types.Array(types.int64, 2, "C")


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
    writer = SampleWriter(stream)
    metadata = about(record.joint_names, record.input_names, spec, list(record.readings.values()))
    writer.add_metadata(METADATA, metadata | {"samples": str(len(record)), "stopped": record.stopped})
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
        raise unreadable(path, error) from None
    except Exception as error:  # parsing damaged bytes raises anything
        raise FileFormatError(
            f"{path}: is not a complete MCAP file ({type(error).__name__}: {error})"
        ) from None


class ChunkMessages(NamedTuple):
    """Messages of one channel out of one chunk, in the order of the file.

    Attributes
    ----------
    channel
        Its number.
    times
        Of recording, shape (k,), ns.
    data
        All bytes of the chunk.
    starts, sizes
        Where in them each message begins, and how long it is, shape (k,).
    """

    channel: int
    times: NDArray[np.int64]
    data: Bytes
    starts: NDArray[np.int64]
    sizes: NDArray[np.int64]

    def chosen(self, which: NDArray[np.bool_]) -> ChunkMessages:
        """Return some of the messages, (k,)."""
        return self._replace(times=self.times[which], starts=self.starts[which], sizes=self.sizes[which])

    def part(self, first: int, last: int) -> Bytes:
        """Return bytes first … last of all messages, which are at least so long: shape (k, last − first)."""
        return self.data[self.starts[:, None] + np.arange(first, last)]

    def floats(self, layout: Layout, field: str) -> NDArray[np.float64]:
        """Return a field of messages that all have this layout, shape (k, count)."""
        first, count = layout.fields[field]
        return self.part(first, first + 8 * count).view("<f8").astype(np.float64, copy=False)

    def alike(self, layout: Layout) -> NDArray[np.bool_]:
        """Return which messages have a layout."""
        fits = self.sizes == layout.size
        if len(fits):
            fits[fits] = (self.data[self.starts[fits, None] + layout.form] == layout.expected).all(axis=1)
        return fits

    def first(self) -> bytes:
        """Return the first message."""
        return self.data[self.starts[0] : self.starts[0] + self.sizes[0]].tobytes()


@kernel(types.int64(_BYTES, _TABLE))
def _scan(data, found):
    """Write opcode, channel, time, begin and size of each record's content, as many as there is room for.

    Return how many there are, or −1 if the last runs beyond the end.
    """
    count, place, size = 0, 0, data.shape[0]
    while place < size:
        if place + 9 > size:
            return -1
        length = 0
        for k in range(8):
            length |= types.int64(data[place + 1 + k]) << (8 * k)
        if length < 0 or length > size - place - 9:
            return -1
        if count < found.shape[0]:
            found[count, 0], found[count, 3], found[count, 4] = data[place], place + 9, length
            if data[place] == 5:
                if length < 22:
                    return -1
                time = 0
                for k in range(8):
                    time |= types.int64(data[place + 15 + k]) << (8 * k)
                found[count, 1] = data[place + 9] | (types.int64(data[place + 10]) << 8)
                found[count, 2], found[count, 3], found[count, 4] = time, place + 31, length - 22
        count += 1
        place += 9 + length
    return count


def read_records(stream: IO[bytes], *, messages: bool = True) -> Iterator[Any]:
    """Yield the schemas, channels and metadata of an MCAP file, as the library has them, and `ChunkMessages`.

    Parameters
    ----------
    stream
        The file, at its begin.
    messages
        Whether to look into chunks.

    Raises
    ------
    FileFormatError
        If it is none, is damaged, or a chunk is too large.
    EOFError
        If it ends too early.
    """
    size = os.fstat(stream.fileno()).st_size
    if stream.read(8) != _MAGIC:
        raise FileFormatError("is not a complete MCAP file: it does not begin as one")
    while True:
        head = stream.read(9)
        if len(head) < 9:
            raise EOFError("is not a complete MCAP file: it has no end")
        opcode, length = struct.unpack("<BQ", head)
        if length > size - stream.tell():
            raise EOFError("is not a complete MCAP file: its last record is cut off")
        if opcode == _CHUNK and messages:
            yield from _chunk(stream.read(length))
        elif opcode in (_SCHEMA, _CHANNEL, _METADATA):
            yield _other_record(opcode, stream.read(length))
        elif opcode == _MESSAGE and messages:
            yield from _records_in(np.frombuffer(head + stream.read(length), dtype=np.uint8))
        else:
            stream.seek(length, os.SEEK_CUR)
        if opcode == _FOOTER:
            if stream.read(8) != _MAGIC:
                raise EOFError("is not a complete MCAP file: its end is cut off")
            return


def _chunk(content: bytes) -> Iterator[Any]:
    """Yield the records of a chunk."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk

    chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
    data = _uncompressed(chunk)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise FileFormatError("is not a complete MCAP file: a chunk's checksum is wrong")
    yield from _records_in(np.frombuffer(data, dtype=np.uint8))


def _uncompressed(chunk: Any) -> bytes:
    """Return the content of a chunk, whose size it may state wrongly."""
    _check_size(chunk.uncompressed_size)
    if chunk.compression == "zstd":
        import zstandard

        _check_size(zstandard.frame_content_size(chunk.data))
        return zstandard.decompress(chunk.data, chunk.uncompressed_size)
    if chunk.compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, chunk.uncompressed_size)
    if chunk.compression:
        raise FileFormatError(f"is compressed by '{chunk.compression}'; only zstd and lz4 are read")
    return chunk.data


def _check_size(size: int) -> None:
    if size > LARGEST_CHUNK:
        raise FileFormatError(
            f"holds a chunk of {size / 1e6:,.0f} MB; at most {LARGEST_CHUNK / 1e6:.0f} MB are read at once"
        )


def _records_in(data: Bytes) -> Iterator[Any]:
    """Yield the schemas and channels in some bytes, then the messages, channel by channel."""
    count = _scan(data, np.empty((0, 5), dtype=np.int64))
    if count < 0:
        raise FileFormatError("is not a complete MCAP file: a record in a chunk is cut off")
    found = np.zeros((count, 5), dtype=np.int64)
    _scan(data, found)
    for opcode, _, _, start, size in found[np.isin(found[:, 0], (_SCHEMA, _CHANNEL))].tolist():
        yield _other_record(opcode, data[start : start + size].tobytes())
    messages = found[found[:, 0] == _MESSAGE]
    order = np.argsort(messages[:, 1], kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(messages[order, 1])) + 1):
        if len(rows):
            _, channels, times, starts, sizes = messages[rows].T
            yield ChunkMessages(int(channels[0]), times, data, starts, sizes)


def _other_record(opcode: int, content: bytes) -> Any:
    """Return a record as the library reads it."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Metadata, Schema

    kind = {_SCHEMA: Schema, _CHANNEL: Channel, _METADATA: Metadata}[opcode]
    return kind.read(ReadDataStream(io.BytesIO(content)))


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
                elif isinstance(record, Metadata) and record.name in (METADATA, END):
                    streamed = streamed or (record.name == METADATA and "samples" not in record.metadata)
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
        if self._about["format"] != FORMAT:
            raise FileFormatError(f"has record format {self._about['format']}, this version reads {FORMAT}")
        return self._about

    def _take(self, messages: ChunkMessages) -> None:
        """Keep the numbers of messages of one topic."""
        topic = self._topics[messages.channel]
        kind, field = _FIELDS.get(topic, (NUMBERS, "data") if topic.startswith(READINGS) else ("", ""))
        if not kind:
            return
        layout = self._layouts.setdefault(topic, layout_of(kind, messages.first()))
        if not messages.alike(layout).all():
            raise FileFormatError(f"{topic}: has messages of different forms")
        self.rows.setdefault(topic, []).append(messages.floats(layout, field))


_FIELDS = {
    STATES: ("sensor_msgs/JointState", "position"),
    MEASURED: ("sensor_msgs/JointState", "position"),
    COMMAND: ("sensor_msgs/JointState", "velocity"),
    SAMPLE: (NUMBERS, "data"),
    DISTURBANCE: ("geometry_msgs/TwistStamped", "data"),
}


def _record(found: _Contents) -> Record:
    metadata = found.metadata
    joints, inputs = _names(metadata, "joint_names"), _names(metadata, "input_names")
    readings = {name: (parts, units) for name, parts, units in json.loads(metadata.get("readings", "[]"))}
    topics = [STATES, MEASURED, COMMAND, SAMPLE, *(READINGS + name for name in readings)]
    values = {}
    for topic in [*topics, DISTURBANCE] if DISTURBANCE in found.rows else topics:
        parts = found.rows.pop(topic, [])
        values[topic] = np.concatenate(parts) if parts else np.zeros((0, 0))
    if not found.is_cut_off:
        count, stopped = int(metadata["samples"]), metadata["stopped"]
    else:
        count = min(map(len, values.values()))
        if not count:
            raise FileFormatError("was cut off before its first samples were written")
        stopped = f"cut off at {values[SAMPLE][count - 1, 0]:g} s: the recording has no end"
        values = {topic: each[:count] for topic, each in values.items()}
    for topic, each in values.items():
        if len(each) != count:
            raise FileFormatError(f"{topic}: expected {count} messages, got {len(each)}")
    sample = values[SAMPLE]
    return Record(
        time=sample[:, 0],
        q=values[STATES],
        measured=values[MEASURED],
        command=values[COMMAND],
        pose=sample[:, 1:9],
        desired=sample[:, 9:],
        joint_names=joints,
        input_names=inputs,
        stopped=stopped,
        disturbance=values[DISTURBANCE][:, [3, 4, 5, 0, 1, 2]] if DISTURBANCE in values else None,
        readings={
            name: Signal(name, tuple(parts), tuple(units), values[READINGS + name])
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
