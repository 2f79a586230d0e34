"""Drawings: lines and arcs in one go, as for light painting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, ValueRangeError, as_positive, unknown_name
from dqcontrol.files.text_file import read_text
from dqcontrol.references.planar import PlanarReference, Plane, plane_axes
from dqcontrol.references.sample import as_pose
from dqcontrol.references.strokes import Arc, PenPath, Rest, StraightStroke, Stroke, distance_home
from dqcontrol.references.yaml_form import FileName, SpecStart

_SAME = 1e-9  # m: no way to go


@dataclass(frozen=True)
class PenStroke:
    """What is drawn without lifting the pen.

    Attributes
    ----------
    start
        Where the pen is put down, paper coordinates.
    strokes
        Lines and arcs from there on, in the same coordinates.
    """

    start: tuple[float, float]
    strokes: tuple[Stroke, ...]


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
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        start = as_pose("start", self.start)
        strokes = tuple(self.strokes)
        object.__setattr__(self, "strokes", strokes)
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
        from dqcontrol.references.drawing.drawing_file import parse_drawing

        said = parse_drawing(read_text(path), str(path))
        if said.position is not None:
            start.refuse_position(path)
        if said.rotation is not None:
            start.refuse_orientation(path)
        return said.drawing(start.pose)

    @classmethod
    def _of_svg(cls, start: SpecStart, path: Path, width: float, speed: float, plane: Plane) -> Drawing:
        from dqcontrol.references.drawing.svg_file import load_svg

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
