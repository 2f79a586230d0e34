"""Writes recordings of runs: what they say about themselves, and samples as they come."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import IO

import numpy as np

from dqcontrol.loop.record import Record, part_of
from dqcontrol.loop.signals import Signal
from dqcontrol.recording.mcap_topics import NUMBERS, TOPICS, messages_of
from dqcontrol.recording.message_types import definition, full_name

FORMAT = "1"
METADATA, END = "dqcontrol", "dqcontrol_end"
_BLOCK = 4096  # samples whose messages are in memory at once


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
    """Writes samples of records to a stream, with all message types, in chunks of so many bytes before compression.

    The messages are made here for all samples at once, because the library makes them number by number.

    Attributes
    ----------
    file
        The library's writer of the stream; finish it at the end.
    """

    def __init__(self, stream: IO[bytes], chunk_size: int = 1 << 20) -> None:
        from mcap.well_known import MessageEncoding, SchemaEncoding
        from mcap.writer import Writer

        self.file: Writer = Writer(stream, chunk_size=chunk_size)
        self.file.start(profile="ros2")
        self._schemas = {
            kind: self.file.register_schema(full_name(kind), SchemaEncoding.ROS2, definition(kind).encode())
            for kind in dict.fromkeys(TOPICS.values())
        }
        self._encoding = MessageEncoding.CDR
        self._channels: dict[str, int] = {}

    def write(self, record: Record, count: int, first: float) -> None:
        """Write the messages of the first samples; MCAP has no negative times, so they count from ``first`` (s)."""
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            self._write(
                part_of(record, begin, end + 1), end - begin, begin, first
            )  # one more for its velocity

    def _write(self, record: Record, count: int, begin: int, first: float) -> None:
        """Write the first samples of a part of a record, which begins at sample ``begin``."""
        stamps = np.rint((record.time - first) * 1e9).astype(np.int64)
        messages = messages_of(record, stamps)
        columns = [(self._channel(topic), rows.shape[1], rows.tobytes()) for topic, rows in messages.items()]
        for k, stamp in enumerate(stamps[:count].tolist()):
            for channel, size, data in columns:
                self.file.add_message(channel, stamp, data[k * size : (k + 1) * size], stamp, begin + k)

    def _channel(self, topic: str) -> int:
        if topic not in self._channels:
            schema = self._schemas[TOPICS.get(topic, NUMBERS)]
            self._channels[topic] = self.file.register_channel(topic, self._encoding, schema)
        return self._channels[topic]
