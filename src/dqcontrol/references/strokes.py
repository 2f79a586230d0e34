"""Strokes on a sheet of paper: lines, arcs and pauses, traced at given speeds.

Every piece is the motion of a point that runs at a constant speed along a heading that turns at a constant
rate: a line does not turn, an arc does; a pause and a turn on the spot do not run. One formula serves all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, READ2, WRITE, WRITE2, kernel, types
from dqcontrol.errors import ValueRangeError, as_array, as_positive

_SAME_POINT = 1e-9  # m
_SMOOTH_TURN = 1e-3  # rad; a tangent that jumps by less comes of rounded coordinates
_OFF_CIRCLE = 0.01  # the two radii of an arc may differ by this fraction

_PIECE = types.Array(types.intp, 1, "C", readonly=True)


@kernel(types.void(READ2, _PIECE, READ, WRITE2, WRITE2, WRITE2, WRITE, WRITE), strict=True)
def _run(pieces, which, elapsed, position, velocity, acceleration, yaw, yaw_rate):
    """Write the motion at elapsed times within pieces; an arc's chord is a sinc of half its angle.

    Parameters
    ----------
    pieces
        Start, heading, speed, turn rate, yaw and yaw rate of each, as of `PenPath`, shape (n, 7).
    which, elapsed
        Piece, and time in it, shape (N,), s.
    position, velocity, acceleration, yaw, yaw_rate
        As `PenPath.at` returns them.
    """
    for i in range(which.shape[0]):
        k, t = which[i], elapsed[i]
        start_heading, speed, rate = pieces[k, 2], pieces[k, 3], pieces[k, 4]
        angle = rate * t
        heading, middle = start_heading + angle, start_heading + 0.5 * angle
        half = math.pi * (0.5 * angle / math.pi)  # as NumPy's sinc has it
        sinc = math.sin(half) / half if half != 0.0 else 1.0
        chord = speed * t * sinc
        along_x, along_y = math.cos(heading), math.sin(heading)
        position[i, 0] = pieces[k, 0] + chord * math.cos(middle)
        position[i, 1] = pieces[k, 1] + chord * math.sin(middle)
        velocity[i, 0], velocity[i, 1] = speed * along_x, speed * along_y
        acceleration[i, 0], acceleration[i, 1] = speed * rate * -along_y, speed * rate * along_x
        yaw[i] = pieces[k, 5] + pieces[k, 6] * t
        yaw_rate[i] = pieces[k, 6]


@dataclass(frozen=True)
class StraightStroke:
    """A straight stroke to a point.

    Parameters
    ----------
    x, y
        End, paper coordinates, m.
    speed
        m/s.
    """

    x: float
    y: float
    speed: float


@dataclass(frozen=True)
class Arc:
    """A circular stroke to a point; a full circle if it ends where it starts.

    Parameters
    ----------
    x, y
        End, paper coordinates, m. It must be as far from the centre as the start, to 1 %; the centre is then
        moved to where it is exactly so.
    centre_x, centre_y
        Centre, paper coordinates, m.
    clockwise
        Direction, as seen with the paper's first axis to the right and its second one up.
    speed
        m/s.
    """

    x: float
    y: float
    centre_x: float
    centre_y: float
    clockwise: bool
    speed: float


@dataclass(frozen=True)
class Rest:
    """A pause.

    Parameters
    ----------
    seconds
        s.
    """

    seconds: float


Stroke = StraightStroke | Arc | Rest


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


@dataclass(frozen=True, eq=False)
class PenPath:
    """A point that runs over the paper, piece by piece, from time 0.

    Parameters
    ----------
    start
        Point at which each piece starts, shape (n, 2), m.
    heading
        Direction in which it starts, shape (n,), rad from the first paper axis.
    speed, turn_rate
        Constant in each piece, shape (n,), m/s, rad/s; counterclockwise is positive.
    yaw, yaw_rate
        Where an end effector that follows the path points when each piece starts, and how fast it turns, shape (n,),
        rad, rad/s. It is the heading, but never jumps.
    times
        Start of each piece and end of the last, shape (n + 1,), s.
    """

    start: Array
    heading: Array
    speed: Array
    turn_rate: Array
    yaw: Array
    yaw_rate: Array
    times: Array

    @classmethod
    def of(
        cls,
        strokes: Sequence[Stroke],
        turn_speed: float | None = None,
        labels: Sequence[str] | None = None,
    ) -> PenPath:
        """PenPath strokes from the paper's origin.

        Parameters
        ----------
        strokes
            At least one line or arc among them.
        turn_speed
            If given (rad/s), the point turns on the spot at this rate wherever the heading would jump.
        labels
            Name of each stroke for error messages; ``strokes[i]`` if omitted.

        Raises
        ------
        ValueRangeError
            If a stroke has no length, an arc ends off its circle, a number is not finite, a speed is not
            positive, or there is no line or arc.
        """
        point, pieces = (0.0, 0.0), []
        for i, stroke in enumerate(strokes):
            label = labels[i] if labels else f"strokes[{i}]"
            piece = _piece(label, point, stroke)
            if not math.isfinite(piece.seconds):
                raise ValueRangeError(f"{label}: takes no finite time; give it a greater speed")
            pieces.append(piece)
            point = piece.end
        moving = [piece for piece in pieces if piece.speed]
        if not moving:
            raise ValueRangeError("strokes: expected at least one line or arc, got none")
        rows, yaw = [], moving[0].heading
        for piece in pieces:
            gap = math.remainder(piece.heading - yaw, 2 * math.pi) if piece.speed else 0.0
            if turn_speed is not None and abs(gap) > _SMOOTH_TURN:
                rate = math.copysign(turn_speed, gap)
                rows.append((*piece.start, yaw, 0.0, rate, yaw, rate, gap / rate))
                yaw, gap = yaw + gap, 0.0
            yaw_rate = piece.turn_rate + gap / piece.seconds
            rows.append((*piece.start, yaw + gap, piece.speed, piece.turn_rate, yaw, yaw_rate, piece.seconds))
            yaw += yaw_rate * piece.seconds
        table = np.array(rows)
        times = np.concatenate([[0.0], np.cumsum(table[:, 7])])
        heading, speed, turn_rate, yaw, yaw_rate = table[:, 2:7].T
        return cls(table[:, :2], heading, speed, turn_rate, yaw, yaw_rate, times)

    @property
    def length(self) -> float:
        """Length of all strokes, m."""
        return float(self.speed @ np.diff(self.times))

    def box(self) -> Array:
        """Return the least and greatest paper coordinates, shape (2, 2), m."""
        times = [self.times]
        for i in np.flatnonzero(self.turn_rate * self.speed):  # arcs: where the heading is along a paper axis
            turned = self.turn_rate[i] * (self.times[i + 1] - self.times[i])
            low, high = sorted((self.heading[i], self.heading[i] + turned))
            quarter = 0.5 * math.pi
            headings = quarter * np.arange(math.ceil(low / quarter), math.floor(high / quarter) + 1)
            times.append(self.times[i] + (headings - self.heading[i]) / self.turn_rate[i])
        points = self.at(np.clip(np.concatenate(times), 0.0, self.times[-1]))[0]
        return np.array([points.min(axis=0), points.max(axis=0)])

    def at(self, times: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return position, velocity, acceleration (N, 2), yaw and yaw rate (N,) at times (N,), s."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.speed) - 1)
        return self._within(i, times - self.times[i])

    def ends(self) -> tuple[Array, Array, Array, Array, Array]:
        """Return the same at the end of each piece, before whatever jumps there."""
        return self._within(np.arange(len(self.speed)), np.diff(self.times))

    def _within(self, which: NDArray[np.intp], elapsed: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return the motion at elapsed times (N,), s, within pieces (N,)."""
        count = len(which)
        position, velocity, acceleration = (np.empty((count, 2)) for _ in range(3))
        yaw, yaw_rate = np.empty(count), np.empty(count)
        _run(self._pieces, which, elapsed, position, velocity, acceleration, yaw, yaw_rate)
        return position, velocity, acceleration, yaw, yaw_rate

    @cached_property
    def _pieces(self) -> Array:
        return np.column_stack(
            [self.start, self.heading, self.speed, self.turn_rate, self.yaw, self.yaw_rate]
        )


def distance_home(strokes: Sequence[Stroke]) -> float:
    """Return how far from the origin the strokes end, m; 0 if by no more than round-off."""
    ends = [(stroke.x, stroke.y) for stroke in strokes if not isinstance(stroke, Rest)]
    gap = math.hypot(*ends[-1])
    return gap if gap > _SAME_POINT else 0.0


@dataclass(frozen=True)
class _Piece:
    start: tuple[float, float]
    end: tuple[float, float]
    heading: float
    speed: float
    turn_rate: float
    seconds: float


def _piece(label: str, start: tuple[float, float], stroke: Stroke) -> _Piece:
    if isinstance(stroke, Rest):
        return _Piece(start, start, 0.0, 0.0, 0.0, as_positive(f"{label}: seconds", stroke.seconds))
    speed = as_positive(f"{label}: speed", stroke.speed)
    end = (float(as_array(f"{label}: x", stroke.x, ())), float(as_array(f"{label}: y", stroke.y, ())))
    if isinstance(stroke, Arc):
        return _arc(label, start, end, stroke, speed)
    length, heading = math.dist(start, end), math.atan2(end[1] - start[1], end[0] - start[0])
    if length < _SAME_POINT:
        raise ValueRangeError(f"{label}: has no length: it ends where it starts, at {_text(start)}")
    return _Piece(start, end, heading, speed, 0.0, length / speed)


def _arc(label: str, start: tuple[float, float], end: tuple[float, float], arc: Arc, speed: float) -> _Piece:
    centre = np.array([as_array(f"{label}: centre", c, ()) for c in (arc.centre_x, arc.centre_y)])
    first, second = math.dist(start, centre), math.dist(end, centre)
    if first < _SAME_POINT:
        raise ValueRangeError(f"{label}: has no radius: its centre is its start, {_text(start)}")
    if abs(first - second) > _OFF_CIRCLE * first:
        raise ValueRangeError(
            f"{label}: does not end on its circle: the start {_text(start)} is {first:.6g} m from the centre "
            f"{_text(centre)}, the end {_text(end)} {second:.6g} m (at most {100 * _OFF_CIRCLE:g} % apart)"
        )
    full = math.dist(start, end) < _SAME_POINT
    if not full:  # the nearest centre that both ends are equally far from
        chord = np.subtract(end, start) / math.dist(start, end)
        centre = centre - ((centre - 0.5 * np.add(start, end)) @ chord) * chord
    before, after = np.subtract(start, centre), np.subtract(end, centre)
    side = -1.0 if arc.clockwise else 1.0
    turn = side * math.atan2(before[0] * after[1] - before[1] * after[0], before @ after) % (2 * math.pi)
    angle = 2 * math.pi if full else turn
    radius = math.hypot(*before)
    heading = math.atan2(before[1], before[0]) + side * 0.5 * math.pi
    return _Piece(start, end, heading, speed, side * speed / radius, angle * radius / speed)


def _text(point: Sequence[float] | Array) -> str:
    return f"({point[0]:g}, {point[1]:g})"
