"""URDF files as XML: refused if unsafe or malformed; where each link and joint is, for messages."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.parsers import expat

from dqcontrol.errors import FileFormatError, suggest
from dqcontrol.files.input_file import read_whole
from dqcontrol.robots.files.suffixes import XACRO
from dqcontrol.robots.files.xacro_file import expand_xacro

_DEEPEST = 50
_LARGEST = 20_000_000  # bytes; the largest that robots come with have one million
_JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_NUMBERS = {  # element: attributes that hold numbers, and how many
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "velocity": 1, "effort": 1},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
}
_REQUIRED = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}


class CheckedXml:
    """The bytes of a URDF file that is safe to parse, and where in it everything is.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    FileFormatError
        If the file cannot be read, declares a document type or entities (which could make a parser read other
        files or fill the memory), is no well-formed XML, or has something that no robot description has:
        ``path:line: …``.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = path
        self.lines: dict[tuple[str, str], int] = {}
        try:
            self.data: bytes = read_whole(path, _LARGEST)
        except OSError as error:
            raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
        self._refuse_declarations()
        if Path(path).suffix.lower() == XACRO or _has_macros(self.data):
            self.data = expand_xacro(path)
            self._refuse_declarations()
        self._stack: list[str] = []
        self._parser = expat.ParserCreate(namespace_separator=" ")
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._doctype
        try:
            self._parser.Parse(self.data, True)
        except expat.ExpatError as error:
            text = expat.ErrorString(error.code)
            if not self.data.strip():
                text = "is empty"
            raise FileFormatError(f"{path}:{error.lineno}: not well-formed XML: {text}") from None
        except FileFormatError:
            raise
        except (ValueError, LookupError) as error:  # an encoding that expat does not know
            raise FileFormatError(f"{path}:1: not well-formed XML: {error}") from None
        for kind in ("parent", "child"):
            for (tag, name), line in self.lines.items():
                if tag == "joint" and (kind, name) not in self.lines:
                    raise FileFormatError(f"{path}:{line}: joint '{name}': missing <{kind} link=…>")

    def error(self, tag: str, name: str, text: str) -> FileFormatError:
        """Return an error about a link or joint, with its line."""
        return FileFormatError(f"{self.path}:{self.lines.get((tag, name), 1)}: {tag} '{name}': {text}")

    def _refuse_declarations(self) -> None:
        plain = self.data.replace(b"\0", b"").upper()  # so that UTF-16 and UTF-32 read like ASCII
        for word in (b"<!DOCTYPE", b"<!ENTITY"):
            if word in plain:
                line = plain[: plain.index(word)].count(b"\n") + 1
                raise FileFormatError(f"{self.path}:{line}: {_NO_DOCTYPE}")

    def _doctype(self, *_: object) -> None:
        raise self._fault(_NO_DOCTYPE)

    def _fault(self, text: str) -> FileFormatError:
        return FileFormatError(f"{self.path}:{self._parser.CurrentLineNumber}: {text}")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        depth = len(self._stack)
        if depth > _DEEPEST:
            raise self._fault(f"more than {_DEEPEST} elements inside each other")
        self._stack.append(tag)
        if depth == 0:
            if tag != "robot":
                raise self._fault(f"expected <robot>, got <{tag}>")
            self._need(tag, attributes, "name")
        elif depth == 1 and tag in ("link", "joint"):
            self._link_or_joint(tag, attributes)
        elif depth == 2 and self._stack[1] == "joint" and tag in ("parent", "child"):
            self._need(tag, attributes, "link")
            self.lines[tag, self._name] = self._parser.CurrentLineNumber
        if depth >= 2 and self._stack[1] in ("link", "joint") and "visual" not in self._stack:
            self._numbers(tag, attributes)

    def _end(self, _: str) -> None:
        self._stack.pop()

    def _need(self, tag: str, attributes: dict[str, str], key: str) -> None:
        if not attributes.get(key):
            raise self._fault(f"<{tag}> misses its attribute '{key}'")

    def _link_or_joint(self, tag: str, attributes: dict[str, str]) -> None:
        self._need(tag, attributes, "name")
        self._name = attributes["name"]
        if (tag, self._name) in self.lines:
            raise self._fault(
                f"{tag} '{self._name}' is already defined on line {self.lines[tag, self._name]}"
            )
        self.lines[tag, self._name] = self._parser.CurrentLineNumber
        kind = attributes.get("type", "")
        if tag == "joint" and kind not in _JOINT_KINDS:
            near = suggest(kind, _JOINT_KINDS)
            raise self._fault(
                f"joint '{self._name}': unknown type '{kind}'{near} (allowed: {', '.join(_JOINT_KINDS)})"
            )

    def _numbers(self, tag: str, attributes: dict[str, str]) -> None:
        where = f"{self._stack[1]} '{self._name}': <{tag}>"
        for key in _REQUIRED.get(tag, ()):
            if key not in attributes:
                raise self._fault(f"{where} misses its attribute '{key}'")
        for key, count in _NUMBERS.get(tag, {}).items():
            if key not in attributes:
                continue
            try:
                numbers = [float(word) for word in attributes[key].split()]
            except ValueError:
                numbers = []
            unlimited = tag == "limit" and math.inf in map(abs, numbers)
            if len(numbers) != count or not (unlimited or all(map(math.isfinite, numbers))):
                wanted = "a finite number" if count == 1 else f"{count} finite numbers"
                raise self._fault(f"{where} {key}: expected {wanted}, got '{attributes[key]}'")


def _has_macros(data: bytes) -> bool:
    """Return whether a file is xacro whatever its name: some packages call theirs .urdf."""
    return b"<xacro:" in re.sub(rb"<!--.*?-->", b"", data, flags=re.DOTALL)


_NO_DOCTYPE = (
    "declares a document type or entities; robot descriptions need none, and they are refused for safety"
)
