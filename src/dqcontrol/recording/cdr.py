"""Many messages of one type at once, to and from the bytes of ROS 2 (CDR, little-endian)."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Rows = NDArray[np.void]
Field = int | str | Sequence[str] | NDArray[Any]

_ENCAPSULATION = b"\x00\x01\x00\x00"  # little-endian, no options; alignment counts from its end


class Alike(NamedTuple):
    """Messages that are alike but for their numbers.

    Attributes
    ----------
    form
        One of them, with zeros in place of the numbers.
    numbers
        Of each array, where in a message it begins, and the bytes of its rows, shape (N,).
    """

    form: bytes
    numbers: list[tuple[int, Rows]]


def cdr(*fields: Field) -> Alike:
    r"""Return messages that are alike but for their numbers.

    CDR: OMG Common Data Representation, version 1 (formal/02-06-51, chapter 15.3): each number starts at a multiple of
    its own size, text has its length before and a zero behind it.

    Parameters
    ----------
    fields
        In the order of the message's definition, parts of parts one after the other. The same in all messages: a
        ``uint32``, a text, a sequence of texts. One row a message: arrays (N, m) of numbers, written in their own type,
        each row in one piece; a sequence of them has its length m as a field before.

    Examples
    --------
    >>> import numpy as np
    >>> messages = cdr("ab", np.array([[1], [2]], dtype=np.uint32))
    >>> messages.form[4:]
    b'\x03\x00\x00\x00ab\x00\x00\x00\x00\x00\x00'
    >>> [(place, rows.tolist()) for place, rows in messages.numbers]
    [(12, [b'\x01\x00\x00\x00', b'\x02\x00\x00\x00'])]
    """
    form, numbers = bytearray(_ENCAPSULATION), []
    for field in fields:
        for alignment, part in _parts(field):
            form += bytes((len(_ENCAPSULATION) - len(form)) % alignment)
            if isinstance(part, bytes):
                form += part
            else:
                numbers.append((len(form), part))
                form += bytes(part.itemsize)
    return Alike(bytes(form), numbers)


def _parts(field: Field) -> Iterator[tuple[int, bytes | Rows]]:
    """Yield a field's alignments, and the bytes of all messages or of each."""
    if isinstance(field, np.ndarray):
        little = np.asarray(field, dtype=field.dtype.newbyteorder("<"))
        if little.shape[1]:
            yield little.itemsize, little.view(f"V{little.itemsize * little.shape[1]}")[:, 0]
    elif isinstance(field, int):
        yield 4, struct.pack("<I", field)
    elif isinstance(field, str):
        text = field.encode() + b"\0"
        yield 4, struct.pack("<I", len(text)) + text
    else:
        yield from _parts(len(field))
        for text in field:
            yield from _parts(text)


class Layout(NamedTuple):
    """Where a message has its numbers; all that agree with it in size and form have them there.

    Attributes
    ----------
    size
        Of the message, bytes.
    fields
        First byte and count of float64 of each field.
    form
        Indices of the bytes that say how long texts and sequences are, and of the texts.
    expected
        These bytes.
    names
        Of the joints, where it has some.
    """

    size: int
    fields: dict[str, tuple[int, int]]
    form: NDArray[np.intp]
    expected: Bytes
    names: tuple[str, ...]


DEFINITIONS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/Float64": "float64 data\n",
    "std_msgs/MultiArrayDimension": "string label\nuint32 size\nuint32 stride\n",
    "std_msgs/MultiArrayLayout": "std_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n",
    "std_msgs/Float64MultiArray": "std_msgs/MultiArrayLayout layout\nfloat64[] data\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/Accel": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
    "geometry_msgs/TwistStamped": "std_msgs/Header header\ngeometry_msgs/Twist twist\n",
    "geometry_msgs/AccelStamped": "std_msgs/Header header\ngeometry_msgs/Accel accel\n",
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    ),
}


def full_name(kind: str) -> str:
    """Return the full name of a type, as ``std_msgs/msg/Float64`` of ``std_msgs/Float64``."""
    return kind.replace("/", "/msg/")


def definition(kind: str) -> str:
    """Return a type's definition and those of all its parts, as ROS 2 tools write them."""
    text, todo, seen = DEFINITIONS[kind], [kind], {kind}
    for name in todo:
        for word in DEFINITIONS[name].replace("[]", "").split():
            if word in DEFINITIONS and word not in seen:
                seen.add(word)
                todo.append(word)
                text += f"{'=' * 80}\nMSG: {word}\n{DEFINITIONS[word]}"
    return text


class _Walk:
    """Steps through one message and notes its form."""

    def __init__(self, message: bytes) -> None:
        if message[:2] != b"\x00\x01":
            raise ValueError("the message is not little-endian CDR")
        self.message, self.place = message, 4
        self.form: list[tuple[int, int]] = [(0, 2)]
        self.fields: dict[str, tuple[int, int]] = {}
        self.names: tuple[str, ...] = ()

    def skip(self, size: int, alignment: int) -> int:
        """Return where something begins, and go behind it."""
        first = self.place + (4 - self.place) % alignment
        self.place = first + size
        if self.place > len(self.message):
            raise ValueError("the message is cut short")
        return first

    def count(self) -> int:
        """Return a number that belongs to the form."""
        first = self.skip(4, 4)
        self.form.append((first, self.place))
        return struct.unpack_from("<I", self.message, first)[0]

    def text(self) -> str:
        """Return a text."""
        first = self.skip(self.count(), 1)
        self.form.append((first, self.place))
        return self.message[first : self.place].rstrip(b"\0").decode()

    def through(self, kind: str) -> None:
        """Go through a message of a type, or a part of one; single float64 numbers are one field, ``data``."""
        for line in DEFINITIONS[kind].splitlines():
            part, name = line.split()
            count = self.count() if part.endswith("[]") else 1
            match part.removesuffix("[]"):
                case "string":
                    texts = tuple(self.text() for _ in range(count))
                    self.names = texts if name == "name" else self.names
                case "float64" if part == "float64":
                    first, before = self.fields.get("data", (self.skip(0, 8), 0))
                    self.skip(8, 8)
                    self.fields["data"] = first, before + 1
                case "float64":
                    self.fields[name] = (self.skip(8 * count, 8) if count else self.place, count)
                case "int32" | "uint32":
                    self.skip(4, 4)
                case inner:
                    for _ in range(count):
                        self.through(inner)


def layout_of(kind: str, message: bytes) -> Layout:
    """Return where a message of one of the types in `DEFINITIONS` has its numbers.

    Parameters
    ----------
    kind
        As ``"sensor_msgs/JointState"``. Poses and twists have their numbers, in the order of the definition, in the
        field ``data``.
    message
        With its encapsulation.

    Raises
    ------
    ValueError
        If it is no such message.
    """
    try:
        walk = _Walk(message)
        walk.through(kind)
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise ValueError(f"no message of {kind}: {error}") from None
    form = np.concatenate([np.arange(*each) for each in walk.form]).astype(np.intp)
    expected = np.frombuffer(message, dtype=np.uint8)[form]
    return Layout(len(message), walk.fields, form, expected, walk.names)
