"""Messages of MCAP files, many at once, in no more memory than a chunk takes.

By hand, although there is a library: it makes an object of each message and decodes it number by number, which took
151 s for a run of 300 001 samples; this takes 3 s. Records other than messages are left to the library.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Iterator
from typing import IO, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.compiled.compile import kernel, types
from dqcontrol.errors import FileFormatError
from dqcontrol.recording.cdr import Layout

Bytes = NDArray[np.uint8]

LARGEST_CHUNK = 1 << 28  # bytes, uncompressed; recorders write some MB
_MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _FOOTER = 3, 4, 5, 6, 12, 2

_BYTES = types.Array(types.uint8, 1, "C", readonly=True)
_TABLE = types.Array(types.int64, 2, "C")


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
            yield _record(opcode, stream.read(length))
        elif opcode == _MESSAGE and messages:
            yield from _records(np.frombuffer(head + stream.read(length), dtype=np.uint8))
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
    yield from _records(np.frombuffer(data, dtype=np.uint8))


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


def _records(data: Bytes) -> Iterator[Any]:
    """Yield the schemas and channels in some bytes, then the messages, channel by channel."""
    count = _scan(data, np.empty((0, 5), dtype=np.int64))
    if count < 0:
        raise FileFormatError("is not a complete MCAP file: a record in a chunk is cut off")
    found = np.zeros((count, 5), dtype=np.int64)
    _scan(data, found)
    for opcode, _, _, start, size in found[np.isin(found[:, 0], (_SCHEMA, _CHANNEL))].tolist():
        yield _record(opcode, data[start : start + size].tobytes())
    messages = found[found[:, 0] == _MESSAGE]
    order = np.argsort(messages[:, 1], kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(messages[order, 1])) + 1):
        if len(rows):
            _, channels, times, starts, sizes = messages[rows].T
            yield ChunkMessages(int(channels[0]), times, data, starts, sizes)


def _record(opcode: int, content: bytes) -> Any:
    """Return a record as the library reads it."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Channel, Metadata, Schema

    kind = {_SCHEMA: Schema, _CHANNEL: Channel, _METADATA: Metadata}[opcode]
    return kind.read(ReadDataStream(io.BytesIO(content)))
