"""Writes recordings of runs as MCAP files: what they say about themselves, and samples as they come.

By hand, although there is a library: it takes messages one by one, 18 times as long. All samples of a run have messages
of the same sizes, so a chunk of the file is an array with a row of bytes for each sample, and NumPy writes its columns.
Records other than messages and their index are left to the library.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Sequence
from typing import IO, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.loop.record import Record, part_of
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.cdr import Alike, Rows, cdr, definition, full_name
from dqcontrol.references.sample import TWIST, TWIST_RATE

if TYPE_CHECKING:
    from mcap.records import McapRecord


STATES, MEASURED, COMMAND, DISTURBANCE, SAMPLE = (
    "/joint_states",
    "/measured_joint_states",
    "/joint_command",
    "/disturbance",
    "/dqcontrol/sample",
)

READINGS = "/readings/"
NUMBERS = "std_msgs/Float64MultiArray"

TOPICS = {
    STATES: "sensor_msgs/JointState",
    MEASURED: "sensor_msgs/JointState",
    COMMAND: "sensor_msgs/JointState",
    "/hand/pose": "geometry_msgs/PoseStamped",
    "/hand/desired": "geometry_msgs/PoseStamped",
    "/hand/desired_twist": "geometry_msgs/TwistStamped",
    "/hand/desired_acceleration": "geometry_msgs/AccelStamped",
    DISTURBANCE: "geometry_msgs/TwistStamped",
    "/error": "std_msgs/Float64",
    SAMPLE: NUMBERS,
}

_FRAME = "world"


def messages_of(record: Record, stamps: NDArray[np.int64]) -> dict[str, Alike]:
    """Return the messages of all samples by topic.

    Parameters
    ----------
    record
        What they say.
    stamps
        Times of the messages, ns, shape (N,), not negative.
    """
    header = np.stack(np.divmod(stamps, 10**9), axis=1).astype(np.uint32), _FRAME
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        speed = np.zeros_like(record.q)
        speed[:-1] = np.diff(record.q, axis=0) / np.diff(record.time)[:, None]
        linear, acceleration = _hand_motion(record)
    joints = *header, record.joint_names
    messages = {
        STATES: cdr(*joints, *_sequence(record.q), *_sequence(speed), 0),
        MEASURED: cdr(*joints, *_sequence(record.measured), 0, 0),
        COMMAND: cdr(*header, record.input_names, 0, *_sequence(record.command), 0),
        "/hand/pose": cdr(*header, record.position, *_quaternion(record.pose)),
        "/hand/desired": cdr(*header, record.desired_position, *_quaternion(record.desired)),
        "/hand/desired_twist": cdr(*header, linear, record.desired[:, TWIST][:, :3]),
        "/hand/desired_acceleration": cdr(*header, acceleration, record.desired[:, TWIST_RATE][:, :3]),
        "/error": cdr(record.error[:, None]),
        SAMPLE: _numbers("time, pose, desired", record.time[:, None], record.pose, record.desired),
    }
    if record.disturbance is not None:
        messages[DISTURBANCE] = cdr(*header, record.disturbance[:, 3:], record.disturbance[:, :3])
    for signal in record.readings.values():
        messages[READINGS + signal.name] = _numbers(", ".join(signal.headings()), signal.values)
    return messages


def _sequence(*values: Array) -> tuple[int | Array, ...]:
    return sum(each.shape[1] for each in values), *values


def _quaternion(pose: Array) -> tuple[Array, Array]:
    """Return a pose's x, y, z and w, as geometry_msgs/Quaternion has them."""
    return pose[:, 1:4], pose[:, :1]


def _numbers(label: str, *values: Array) -> Alike:
    """Return messages of the type ``NUMBERS``: their one dimension with label, size and stride, no offset, the data."""
    size, *_ = _sequence(*values)
    return cdr(1, label, size, size, 0, *_sequence(*values))


def _hand_motion(record: Record) -> tuple[Array, Array]:
    """Return ṗ_d = v − p × ω and p̈_d = v̇ − ṗ × ω − p × ω̇ of the reference."""
    twist, rate, p = record.desired[:, TWIST], record.desired[:, TWIST_RATE], record.desired_position
    velocity = twist[:, 3:] - np.cross(p, twist[:, :3])
    return velocity, rate[:, 3:] - np.cross(velocity, twist[:, :3]) - np.cross(p, rate[:, :3])


FORMAT = "1"
METADATA, END = "dqcontrol", "dqcontrol_end"
_BLOCK = 8192  # samples whose numbers are worked out at once
_CHUNK = 1 << 20  # bytes before compression, as the library has it
_LEVEL = -3  # of zstd: 1.4 µs and 391 bytes a sample; the usual level, 3, takes 6.2 µs for 378
_MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _MESSAGE, _CHUNK_RECORD, _MESSAGE_INDEX = 2, 5, 6, 7
_SUMMARY = 3, 4, 11, 8, 13  # opcodes of schemas, channels, statistics, indexes of chunks and of metadata
_HEAD = np.dtype([("sequence", "<u4"), ("log_time", "<u8"), ("publish_time", "<u8")])  # of a message


def about(
    joints: Sequence[str], inputs: Sequence[str], spec: str, signals: Sequence[Signal]
) -> dict[str, str]:
    """Return what a recording says about itself."""
    from dqcontrol.version import __version__

    return {
        "format": FORMAT,
        "version": __version__,
        "joint_names": json.dumps(joints, ensure_ascii=False),
        "input_names": json.dumps(inputs, ensure_ascii=False),
        "spec": spec,
        "readings": json.dumps([signal[:3] for signal in signals], ensure_ascii=False),
    }


class SampleWriter:
    """Writes samples of records to a stream, with all message types, in compressed chunks with their indexes.

    Parameters
    ----------
    stream
        Empty.
    """

    def __init__(self, stream: IO[bytes]) -> None:
        import zstandard
        from mcap.records import Header

        from dqcontrol.version import __version__

        self._stream, self._place = stream, 0
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL, write_checksum=True)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._announced = b""  # schemas and channels, at the begin of the first chunk
        # Room for a chunk: of each sample its messages, one behind the other, in which only numbers change; where they
        # begin; and its time, ns.
        self._samples: Rows = np.empty(0, "V")
        self._places: list[int] = []
        self._stamps = np.empty(0, np.int64)
        self._filled, self._count, self._chunks, self._metadata = 0, 0, 0, 0
        self._first, self._last = 0, 0  # ns
        self._summary = {opcode: bytearray() for opcode in _SUMMARY}
        self._put(_MAGIC + _encoded(Header("ros2", f"dqcontrol {__version__}")))

    def add_metadata(self, name: str, texts: dict[str, str]) -> None:
        """Write texts under a name, behind the samples so far."""
        from mcap.records import Metadata, MetadataIndex

        self.flush()
        begin = self._place
        self._put(_encoded(Metadata(name, texts)))
        self._summarise(MetadataIndex(begin, self._place - begin, name))
        self._metadata += 1

    def write(self, record: Record, count: int, first: float) -> None:
        """Write the messages of the first samples; MCAP has no negative times, so they count from ``first`` (s)."""
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            part = part_of(record, begin, end + 1)  # one more for its velocity
            stamps = np.rint((part.time - first) * 1e9).astype(np.int64)
            self._write(messages_of(part, stamps), stamps[: end - begin])

    def _write(self, messages: dict[str, Alike], stamps: NDArray[np.int64]) -> None:
        """Write the messages of as many samples as there are stamps, and all full chunks."""
        heads = np.empty(len(stamps), _HEAD)
        heads["sequence"] = np.arange(self._count, self._count + len(stamps))
        heads["log_time"] = heads["publish_time"] = stamps
        form, numbers, self._places = b"", {}, []
        for topic, alike in messages.items():
            self._places.append(len(form))
            form += struct.pack("<BQH", _MESSAGE, 2 + _HEAD.itemsize + len(alike.form), self._channel(topic))
            numbers[len(form)] = heads.view(f"V{_HEAD.itemsize}")
            form += bytes(_HEAD.itemsize)
            numbers |= {len(form) + place: rows for place, rows in alike.numbers}
            form += alike.form
        if not len(self._samples):
            self._samples = np.full(max(_CHUNK // len(form), 1), np.void(form))
            self._stamps = np.empty(len(self._samples), np.int64)
        begin = 0
        while begin < len(stamps):
            end = min(begin + len(self._samples) - self._filled, len(stamps))
            place = slice(self._filled, self._filled + end - begin)
            self._stamps[place] = stamps[begin:end]
            for first, rows in numbers.items():
                self._samples.getfield(rows.dtype, first)[place] = rows[begin:end]
            self._filled, begin = place.stop, end
            if self._filled == len(self._samples):
                self._end_chunk()
        self._count += len(stamps)

    def _channel(self, topic: str) -> int:
        """Return a topic's number, and announce it and its message type if they are new."""
        from mcap.records import Channel, Schema

        if topic not in self._channels:
            kind, number = TOPICS.get(topic, NUMBERS), len(self._channels) + 1
            if kind not in self._schemas:
                self._schemas[kind] = len(self._schemas) + 1
                text = definition(kind).encode()
                self._announce(Schema(self._schemas[kind], text, "ros2msg", full_name(kind)))
            self._channels[topic] = number
            self._announce(Channel(number, topic, "cdr", {}, self._schemas[kind]))
        return self._channels[topic]

    def _announce(self, record: McapRecord) -> None:
        self._announced += self._summarise(record)

    def _summarise(self, record: McapRecord) -> bytes:
        """Keep a record for the summary, and return it."""
        encoded = _encoded(record)
        self._summary[encoded[0]] += encoded
        return encoded

    def flush(self) -> None:
        """Bring what was written to the file, where readers see it."""
        if self._filled:
            self._end_chunk()
        self._stream.flush()

    def _end_chunk(self) -> None:
        """Write the samples at hand as a chunk, and where their messages are."""
        from mcap.records import ChunkIndex

        samples, stamps = self._samples[: self._filled], self._stamps[: self._filled]
        data = b"".join([self._announced, samples.data]) if self._announced else samples.view(np.uint8).data
        packed, times = self._compressor.compress(data), (int(stamps[0]), int(stamps[-1]))
        # No CRC of MCAP's (0): zstd's own checksum, which all its readers compare, takes a quarter of the time.
        head = struct.pack("<QQQII4sQ", *times, len(data), 0, 4, b"zstd", len(packed))
        begin = self._place
        self._put(struct.pack("<BQ", _CHUNK_RECORD, len(head) + len(packed)) + head)
        self._put(packed)
        middle, indexes = self._place, {}
        entries = np.empty((len(stamps), 2), "<u8")
        entries[:, 0] = stamps
        for channel, place in zip(self._channels.values(), self._places, strict=True):
            indexes[channel] = self._place
            entries[:, 1] = np.arange(len(self._announced) + place, len(data), samples.itemsize)
            size = entries.nbytes
            self._put(struct.pack("<BQHI", _MESSAGE_INDEX, 6 + size, channel, size) + entries.tobytes())
        self._summarise(
            ChunkIndex(
                chunk_length=middle - begin,
                chunk_start_offset=begin,
                compression="zstd",
                compressed_size=len(packed),
                message_end_time=times[1],
                message_index_length=self._place - middle,
                message_index_offsets=indexes,
                message_start_time=times[0],
                uncompressed_size=len(data),
            )
        )
        self._first, self._last = self._first if self._chunks else times[0], times[1]
        self._chunks += 1
        self._announced, self._filled = b"", 0

    def finish(self) -> None:
        """Write what is left, and the summary by which readers find what they want."""
        from mcap.records import DataEnd, Statistics, SummaryOffset

        self.flush()
        counts = dict.fromkeys(self._channels.values(), self._count)
        self._summarise(
            Statistics(
                attachment_count=0,
                channel_count=len(counts),
                channel_message_counts=counts,
                chunk_count=self._chunks,
                message_count=self._count * len(counts),
                message_end_time=self._last,
                message_start_time=self._first,
                metadata_count=self._metadata,
                schema_count=len(self._schemas),
            )
        )
        self._put(_encoded(DataEnd(0)))
        begin, summary, offsets = self._place, b"", b""
        for opcode, group in self._summary.items():
            offsets += _encoded(SummaryOffset(opcode, begin + len(summary), len(group)))
            summary += group
        footer = struct.pack("<BQQQ", _FOOTER, 20, begin, begin + len(summary))
        summary += offsets + footer
        self._put(summary + struct.pack("<I", zlib.crc32(summary)) + _MAGIC)
        self._stream.flush()

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._place += len(data)


def _encoded(record: McapRecord) -> bytes:
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
