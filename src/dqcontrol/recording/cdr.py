"""Many messages of one type at once, in the bytes of ROS 2 (CDR, little-endian)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Field = int | str | Sequence[str] | NDArray[Any]

# little-endian, no options; alignment counts from its end
_ENCAPSULATION = np.frombuffer(b"\x00\x01\x00\x00", dtype=np.uint8)


def cdr(*fields: Field) -> Bytes:
    """Return messages that are alike but for their numbers.

    CDR: OMG Common Data Representation, version 1 (formal/02-06-51, chapter 15.3): each number starts at a multiple of
    its own size, text has its length before and a zero behind it.

    Parameters
    ----------
    fields
        In the order of the message's definition, parts of parts one after the other. The same in all messages: a
        ``uint32``, a text, a sequence of texts. One row a message: arrays (N, m) of numbers, written in their own type;
        a sequence of them has its length m as a field before.

    Returns
    -------
    Shape (N, size of a message).

    Examples
    --------
    >>> cdr("ab", np.array([[1], [2]], dtype=np.uint32))[:, 4:].tolist()
    [[3, 0, 0, 0, 97, 98, 0, 0, 1, 0, 0, 0], [3, 0, 0, 0, 97, 98, 0, 0, 2, 0, 0, 0]]
    """
    parts, size = [_ENCAPSULATION[None]], 0
    for field in fields:
        for alignment, data in _parts(field):
            if data.shape[1]:
                gap = -size % alignment
                parts += [np.zeros((1, gap), dtype=np.uint8), data]
                size += gap + data.shape[1]
    count = max(map(len, parts))
    return np.hstack([np.broadcast_to(part, (count, part.shape[1])) for part in parts])


def _parts(field: Field) -> Iterator[tuple[int, Bytes]]:
    """Yield a field's alignments and bytes, in one row or one a message."""
    if isinstance(field, np.ndarray):
        little = np.ascontiguousarray(field, dtype=field.dtype.newbyteorder("<"))
        yield little.itemsize, little.view(np.uint8)
    elif isinstance(field, int):
        yield from _parts(np.array([[field]], dtype=np.uint32))
    elif isinstance(field, str):
        text = np.frombuffer(field.encode() + b"\0", dtype=np.uint8)
        yield from _parts(len(text))
        yield 1, text[None]
    else:
        yield from _parts(len(field))
        for text in field:
            yield from _parts(text)
