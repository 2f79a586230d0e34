"""What a pen draws before it is lifted, its place and its size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError
from dqcontrol.references.strokes import Arc, PenPath, Rest, StraightStroke, Stroke

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
