"""Drawings: lines and arcs in one go, as for light painting, and their files, a command a line.

The format is described in ``docs/drawing-files.md``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import pose
from dqcontrol.algebra.functions import WRITTEN_TOLERANCE
from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ValueRangeError, as_positive, suggest, unknown_name
from dqcontrol.files.input_file import as_number, read_text
from dqcontrol.references.planar import PLANES, PlanarReference, Plane, plane_axes
from dqcontrol.references.reference import FileName, SpecStart
from dqcontrol.references.sample import as_pose
from dqcontrol.references.strokes import Arc, PenPath, PenStroke, Rest, StraightStroke, Stroke, distance_home

_SAME = 1e-9  # m: no way to go


def relative(pen: PenStroke, origin: Array, scale: float, pace: float) -> tuple[Stroke, ...]:
    """Return strokes in paper coordinates, about an origin."""

    def moved(stroke: Stroke) -> Stroke:
        if isinstance(stroke, Rest):
            return stroke
        x, y = scale * (np.array([stroke.x, stroke.y]) - origin)
        if isinstance(stroke, StraightStroke):
            return replace(stroke, x=float(x), y=float(y), speed=pace)
        cx, cy = scale * (np.array([stroke.centre_x, stroke.centre_y]) - origin)
        return Arc(float(x), float(y), float(cx), float(cy), stroke.clockwise, pace)

    return tuple(map(moved, pen.strokes))


def box_of(pens: Sequence[PenStroke]) -> tuple[Array, Array]:
    """Return the least and greatest coordinates of all.

    Raises
    ------
    FileFormatError
        If they are one point.
    """
    boxes = [PenPath.of(relative(pen, np.array(pen.start), 1.0, 1.0)).box() + pen.start for pen in pens]
    low, high = np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)
    if (high - low).max() < 1e-6:
        raise FileFormatError("drawing: has no size")
    return low, high


def scaled(pens: Sequence[PenStroke], middle: Array, scale: float, pace: float) -> list[PenStroke]:
    """Return strokes in m, each about its own start; starts about the middle."""
    out = []
    for pen in pens:
        x, y = scale * (np.array(pen.start) - middle)
        out.append(PenStroke((float(x), float(y)), relative(pen, np.array(pen.start), scale, pace)))
    return out


def in_one_go(pens: Sequence[PenStroke], scale: float, pace: float) -> tuple[Stroke, ...]:
    """Return strokes in m about the first one's start; straight lines lead from where one ends to the next."""
    origin, out, at = np.array(pens[0].start), list[Stroke](), np.zeros(2)
    for pen in pens:
        begin = scale * (np.array(pen.start) - origin)
        if np.abs(begin - at).max() > _SAME:
            out.append(StraightStroke(float(begin[0]), float(begin[1]), pace))
        out += relative(pen, origin, scale, pace)
        at = PenPath.of(out).ends()[0][-1]
    return tuple(out)


ORIENTATIONS = ("fixed", "path")
TURN_SPEED = 1.0  # rad/s
_WIDTH, _SPEED = 0.2, 0.1  # m, m/s: of an SVG file where nothing is said


@dataclass(frozen=True, eq=False, repr=False)
class Drawing(PlanarReference):
    """Draw lines and arcs on a plane in one go, each stroke at constant speed.

    Parameters
    ----------
    start
        Pose at time 0, the paper's origin: unit dual quaternion, `DualQuaternion` or (8,), inertial frame, m.
    strokes
        `StraightStroke`, `Arc` and `Rest`, in paper coordinates; the first stroke starts at the origin.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors (2, 3), inertial frame: the paper's
        axes to the right and up.
    orientation
        ``"fixed"``: that of the start; ``"path"``: the end effector turns about the paper's normal with the
        tangent, from the start's orientation on.
    turn_speed
        rad/s; how fast an end effector that follows the path turns on the spot where the tangent jumps.
    repeat
        How often the strokes are drawn; to repeat, they must end at the origin.

    Attributes
    ----------
    duration
        s.
    length
        Length of all strokes, m.
    box
        Least and greatest paper coordinates, shape (2, 2), m.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If the start is no unit dual quaternion, a stroke cannot be drawn, or a parameter is not as above.

    Examples
    --------
    >>> from dqcontrol.references import Arc, StraightStroke
    >>> strokes = [StraightStroke(0.1, 0.0, speed=0.1), Arc(0.0, 0.0, 0.05, 0.0, clockwise=False, speed=0.1)]
    >>> drawing = Drawing([1, 0, 0, 0, 0, 0, 0, 0], strokes)
    >>> round(drawing.length, 4), drawing.box.round(4).tolist()
    (0.2571, [[0.0, 0.0], [0.1, 0.05]])
    """

    kind = "drawing"

    start: ArrayLike
    strokes: Sequence[Stroke]
    _: KW_ONLY
    plane: Plane = "xz"
    orientation: str = "fixed"
    turn_speed: float = TURN_SPEED
    repeat: int = 1

    def __post_init__(self) -> None:
        start = as_pose("start", self.start)
        strokes = tuple(self.strokes)
        vars(self).update(strokes=strokes)
        if self.orientation not in ORIENTATIONS:
            raise unknown_name("orientation", self.orientation, ORIENTATIONS)
        if not isinstance(self.repeat, int) or self.repeat < 1:
            raise ValueRangeError(f"repeat: expected a whole number ≥ 1, got {self.repeat!r}")
        follow = self.orientation == "path"
        turn_speed = as_positive("turn_speed", self.turn_speed)
        PenPath.of(strokes)  # errors name the stroke before it is repeated
        if self.repeat > 1 and (gap := distance_home(strokes)):
            raise ValueRangeError(f"repeat: the drawing must end at its origin, it ends {gap:.6g} m from it")
        trace = PenPath.of(strokes * self.repeat, turn_speed if follow else None)
        self._place(trace, start, plane_axes("plane", self.plane), follow=follow)

    @classmethod
    def from_spec(
        cls,
        start: SpecStart,
        *,
        file: FileName,
        width: Annotated[float, Meta(gt=0, description="m")] | None = None,
        speed: Annotated[float, Meta(gt=0, description="m/s")] | None = None,
        plane: Literal["xy", "xz", "yz"] | None = None,
    ) -> Drawing:
        """Follow a drawing file, or the outlines of an SVG file.

        Parameters
        ----------
        start
            Where it begins.
        file
            A drawing file, see `dqcontrol.references.load_drawing`; or an SVG file, whose outlines are drawn one after
            the other, with straight lines between them.
        width, speed, plane
            Of an SVG file, which says none of them: 0.2 m, 0.1 m/s, ``"xz"`` if omitted.
        """
        path = start.folder / file
        if path.suffix.lower() == ".svg":
            return cls._of_svg(start, path, width or _WIDTH, speed or _SPEED, plane or "xz")
        for key, value in (("width", width), ("speed", speed), ("plane", plane)):
            if value is not None:
                raise ValueRangeError(f"{start.place}.{key}: is for SVG files; {path} says it itself")
        said = parse_drawing(read_text(path), str(path))
        if said.position is not None:
            start.refuse_position(path)
        if said.rotation is not None:
            start.refuse_orientation(path)
        return said.drawing(start.pose)

    @classmethod
    def _of_svg(cls, start: SpecStart, path: Path, width: float, speed: float, plane: Plane) -> Drawing:
        from dqcontrol.references.svg_file import load_svg

        pens = load_svg(path)
        low, high = box_of(pens)
        across = float(high[0] - low[0]) or float(high[1] - low[1])
        return cls(start.pose, in_one_go(pens, width / across, speed), plane=plane)

    @property
    def length(self) -> float:
        """Length of all strokes, m."""
        return self.trace.length

    @property
    def box(self) -> NDArray[np.float64]:
        """Least and greatest paper coordinates, shape (2, 2), m."""
        return self.trace.box()


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


_COMMANDS = ("start", "plane", "orientation", "speed", "line", "arc", "pause", "repeat")


class _Parser:
    """Reads command after command, by the method of its name; `settings` are those that may stand only once."""

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
        getattr(self, name)(words)

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
            raise self._fail(f"given twice, first in {self.settings[name][0]}")
        self.settings[name] = (self.where, value)

    def _numbers(self, words: list[str], usage: str) -> list[float]:
        """Return the words as numbers, as many as the usage has names in it."""
        count = len(usage.split())
        if len(words) != count:
            raise self._fail(f"expected {usage}, got {len(words)} instead of {count} words")
        return [as_number(self.where, word) for word in words]

    def _positive(self, word: str) -> float:
        number = as_number(self.where, word)
        if number <= 0:
            raise self._fail(f"must be > 0, got {word}")
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
