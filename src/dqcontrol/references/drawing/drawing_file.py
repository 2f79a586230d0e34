"""The drawing file: one command a line. The format is described in ``docs/drawing-files.md``."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import pose
from dqcontrol.algebra.batch import WRITTEN_TOLERANCE
from dqcontrol.errors import FileFormatError, ValueRangeError, suggest
from dqcontrol.files.text_file import as_number, read_text
from dqcontrol.references.drawing.drawing import ORIENTATIONS, TURN_SPEED, Drawing
from dqcontrol.references.planar import PLANES, Plane, plane_axes
from dqcontrol.references.sample import as_pose
from dqcontrol.references.strokes import Arc, PenPath, Rest, StraightStroke, Stroke, distance_home

_DIRECTIONS = {"cw": True, "ccw": False}


@dataclass(frozen=True, eq=False)
class DrawingFile:
    """What a drawing file says.

    Attributes
    ----------
    path
        The file.
    strokes, plane, orientation, turn_speed, repeat
        As for `Drawing`.
    position
        Of the paper's origin in the inertial frame, shape (3,), m; None for the end effector's.
    rotation
        Unit quaternion of the start, shape (4,); None for the end effector's.
    trace
        The strokes over time, drawn once with fixed orientation.
    """

    path: str
    strokes: tuple[Stroke, ...]
    plane: Plane
    orientation: str
    turn_speed: float
    repeat: int
    position: NDArray[np.float64] | None
    rotation: NDArray[np.float64] | None
    trace: PenPath = field(repr=False)

    def drawing(self, start: ArrayLike | None = None) -> Drawing:
        """Return the reference.

        Parameters
        ----------
        start
            Pose of the end effector, `DualQuaternion` or shape (8,), inertial frame, m. It gives the position, if the
            file says ``start hand`` or nothing about it, and the orientation, if the file gives none.

        Raises
        ------
        ValueRangeError
            If the end effector's pose is needed and not given.
        """
        position, rotation = self.position, self.rotation
        if position is None or rotation is None:
            if start is None:
                lacks = "position" if position is None else "orientation"
                raise ValueRangeError(
                    f"start: {self.path} gives no {lacks} to start at: give the end effector's pose"
                )
            hand = as_pose("start", start)
            origin = hand if position is None else pose(hand[:4], position)
        else:
            origin = pose(rotation, position)
        return Drawing(
            origin,
            self.strokes,
            plane=self.plane,
            orientation=self.orientation,
            turn_speed=self.turn_speed,
            repeat=self.repeat,
        )


def load_drawing(path: str | os.PathLike[str], start: ArrayLike | None = None) -> Drawing:
    r"""Return the reference that a drawing file describes.

    Parameters
    ----------
    path
        The file; ``docs/drawing-files.md`` describes the format.
    start
        Pose of the end effector, `DualQuaternion` or shape (8,), inertial frame, m. It gives the position, if the
        file says ``start hand`` or nothing about it, and the orientation, if the file gives none.

    Raises
    ------
    FileFormatError
        If the file cannot be read; the message begins with the file and the line.
    ValueRangeError
        If the end effector's pose is needed and not given.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "stroke.txt"
    >>> _ = file.write_text("speed 0.1\nline 0.2 0\n")
    >>> load_drawing(file, start=[1, 0, 0, 0, 0, 0, 0, 0]).duration
    2.0
    """
    return parse_drawing(read_text(path), str(path)).drawing(start)


def parse_drawing(text: str, path: str = "drawing") -> DrawingFile:
    r"""Return what a drawing says.

    Parameters
    ----------
    text
        The file's text.
    path
        The file's name for error messages.

    Raises
    ------
    FileFormatError
        If the text is no drawing; the message begins with the file and the line.

    Examples
    --------
    >>> parse_drawing("speed 0.1\nline 0.2 0\n").strokes
    (StraightStroke(x=0.2, y=0.0, speed=0.1),)
    """
    parser = _Parser(path)
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("#")[0].split()
        if words:
            parser.read(number, words[0], words[1:])
    return parser.finish()


class _Parser:
    """Reads command after command; `settings` are those that may stand only once."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.where = path
        self._speed: float | None = None
        self.strokes: list[Stroke] = []
        self.labels: list[str] = []
        self.settings: dict[str, tuple[str, Any]] = {}

    def read(self, number: int, name: str, words: list[str]) -> None:
        if name not in _COMMANDS:
            near, allowed = suggest(name, _COMMANDS), ", ".join(_COMMANDS)
            raise FileFormatError(
                f"{self.path}:{number}: {name:.40}: unknown command{near} (allowed: {allowed})"
            )
        self.where = f"{self.path}:{number}: {name}"
        _COMMANDS[name](self, words)

    def finish(self) -> DrawingFile:
        if not any(isinstance(stroke, StraightStroke | Arc) for stroke in self.strokes):
            raise FileFormatError(f"{self.path}: draws nothing: expected at least one line or arc")
        try:
            trace = PenPath.of(self.strokes, labels=self.labels)
        except ValueRangeError as error:
            raise FileFormatError(str(error)) from None
        where, repeat = self.settings.get("repeat", (self.path, 1))
        if repeat > 1 and (gap := distance_home(self.strokes)):
            raise FileFormatError(
                f"{where}: the drawing must end at its origin 0 0, it ends {gap:.6g} m from it"
            )
        position, rotation = self._setting("start", (None, None))
        orientation, turn_speed = self._setting("orientation", ("fixed", TURN_SPEED))
        return DrawingFile(
            path=self.path,
            strokes=tuple(self.strokes),
            plane=self._setting("plane", "xz"),
            orientation=orientation,
            turn_speed=turn_speed,
            repeat=repeat,
            position=position,
            rotation=rotation,
            trace=trace,
        )

    def _setting(self, name: str, default: Any) -> Any:
        return self.settings[name][1] if name in self.settings else default

    def _set(self, name: str, value: Any) -> None:
        if name in self.settings:
            raise FileFormatError(f"{self.where}: given twice, first in {self.settings[name][0]}")
        self.settings[name] = (self.where, value)

    def _numbers(self, words: list[str], usage: str) -> list[float]:
        """Return the words as numbers, as many as the usage has names in it."""
        count = len(usage.split())
        if len(words) != count:
            raise FileFormatError(
                f"{self.where}: expected {usage}, got {len(words)} instead of {count} words"
            )
        return [as_number(self.where, word) for word in words]

    def _positive(self, word: str) -> float:
        number = as_number(self.where, word)
        if number <= 0:
            raise FileFormatError(f"{self.where}: must be > 0, got {word}")
        return number

    def _fail(self, what: str) -> FileFormatError:
        return FileFormatError(f"{self.where}: {what}")

    def start(self, words: list[str]) -> None:
        if words == ["hand"]:
            self._set("start", (None, None))
            return
        if len(words) not in (3, 7):
            raise self._fail(f"expected hand, X Y Z or X Y Z QW QX QY QZ, got {len(words)} words")
        values = np.array([as_number(self.where, word) for word in words])
        rotation, norm = values[3:] if len(words) == 7 else None, np.linalg.norm(values[3:])
        if rotation is not None:
            if abs(norm - 1) > WRITTEN_TOLERANCE:
                raise self._fail(f"the quaternion must have norm 1, got {norm:.9g}")
            rotation = rotation / norm
        self._set("start", (values[:3], rotation))

    def plane(self, words: list[str]) -> None:
        if len(words) == 1:
            if words[0] not in PLANES:
                raise self._fail(
                    f"unknown plane '{words[0]:.40}' (allowed: {', '.join(PLANES)}, or six numbers)"
                )
            self._set("plane", words[0])
            return
        axes = np.reshape(self._numbers(words, "UX UY UZ VX VY VZ"), (2, 3))
        try:
            plane_axes(self.where, axes)
        except ValueRangeError as error:
            raise FileFormatError(str(error)) from None
        self._set("plane", axes)

    def orientation(self, words: list[str]) -> None:
        if not words or words[0] not in ORIENTATIONS or len(words) > (2 if words[0] == "path" else 1):
            raise self._fail(f"expected fixed, path or path TURN_SPEED, got '{' '.join(words):.40}'")
        self._set("orientation", (words[0], self._positive(words[1]) if len(words) == 2 else TURN_SPEED))

    def repeat(self, words: list[str]) -> None:
        number = self._numbers(words, "N")[0]
        if number < 1 or number != int(number):
            raise self._fail(f"expected a whole number ≥ 1, got {words[0]}")
        self._set("repeat", int(number))

    def speed(self, words: list[str]) -> None:
        self._numbers(words, "V")
        self._speed = self._positive(words[0])

    def pause(self, words: list[str]) -> None:
        self._numbers(words, "SECONDS")
        self._draw(Rest(self._positive(words[0])))

    def line(self, words: list[str]) -> None:
        x, y = self._numbers(words, "X Y")
        self._draw(StraightStroke(x, y, self._drawing_speed()))

    def arc(self, words: list[str]) -> None:
        if len(words) != 5 or words[4] not in _DIRECTIONS:
            raise self._fail(f"expected X Y CX CY cw or X Y CX CY ccw, got '{' '.join(words):.60}'")
        x, y, cx, cy = self._numbers(words[:4], "X Y CX CY")
        self._draw(Arc(x, y, cx, cy, _DIRECTIONS[words[4]], self._drawing_speed()))

    def _drawing_speed(self) -> float:
        if self._speed is None:
            raise self._fail("no speed yet: put 'speed V' (m/s) before it")
        return self._speed

    def _draw(self, stroke: Stroke) -> None:
        self.strokes.append(stroke)
        self.labels.append(self.where)


_COMMANDS: dict[str, Callable[[_Parser, list[str]], None]] = {
    "start": _Parser.start,
    "plane": _Parser.plane,
    "orientation": _Parser.orientation,
    "speed": _Parser.speed,
    "line": _Parser.line,
    "arc": _Parser.arc,
    "pause": _Parser.pause,
    "repeat": _Parser.repeat,
}
