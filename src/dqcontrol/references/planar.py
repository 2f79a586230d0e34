"""Motions in a plane: circles, arcs, spirals, squares, a search outwards; planes and strokes in them."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive, unknown_name
from dqcontrol.references.reference import Metres, Positive, Reference, Seconds, Vector, Yaml, corners_between
from dqcontrol.references.sample import TWIST, as_pose, motion_samples, turned
from dqcontrol.references.strokes import PenPath, StraightStroke


class PlanarReference(Reference):
    """A reference that traces strokes on a plane, its orientation fixed or turning with the stroke.

    Attributes
    ----------
    trace
        The strokes over time, in paper coordinates.
    """

    trace: PenPath
    _start: Array
    _axes: Array
    _follow: bool
    _advance: Array

    def _place(
        self, trace: PenPath, start: Array, axes: Array, *, follow: bool = False, advance: Array | None = None
    ) -> None:
        """Hold the paper's origin at the start pose (8,); advance (3,), m/s, moves the paper meanwhile."""
        advance = np.zeros(3) if advance is None else advance
        vars(self).update(trace=trace, start=start, duration=float(trace.times[-1]))
        vars(self).update(_start=start, _axes=axes, _follow=follow, _advance=advance)
        ends = self._samples(trace.times[1:], trace.ends())[:, TWIST]
        starts = self._samples(trace.times[1:-1], trace.at(trace.times[1:-1]))[:, TWIST]
        after = np.concatenate([starts, np.zeros((1, 6))])
        vars(self).update(corners=corners_between(ends, after, trace.times[1:]))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return self._samples(times, self.trace.at(times))

    def sheet(self) -> dict[str, Array | float]:
        """Return how the paper is held, by the names of `computed_path.PathHead`."""
        return {
            "start": self._start,
            "axes": self._axes.ravel(),
            "advance": self._advance,
            "follow": float(self._follow),
            "follow_from": float(self.trace.yaw[0]),
        }

    def _samples(self, times: Array, traced: tuple[Array, Array, Array, Array, Array]) -> Array:
        position, velocity, acceleration, yaw, rate = traced
        p = translation(self._start) + position @ self._axes + times[:, None] * self._advance
        v = velocity @ self._axes + self._advance
        a = acceleration @ self._axes
        r = self._start[:4]
        if not self._follow:
            return motion_samples(p, v, a, r)
        normal = np.cross(self._axes[0], self._axes[1])
        return motion_samples(p, v, a, turned(r, normal, yaw - self.trace.yaw[0]), rate[:, None] * normal)


AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
PLANES = ("xy", "xz", "yz")

Plane = Annotated[
    str | ArrayLike,
    Yaml(
        Annotated[
            Literal["xy", "xz", "yz"] | tuple[Vector, Vector],
            Meta(description="base axes, or two perpendicular vectors: to the right and up"),
        ]
    ),
]
Axis = Annotated[str | ArrayLike, Yaml(Literal["x", "y", "z"] | Vector)]


def plane_axes(field: str, plane: Plane) -> NDArray[np.float64]:
    """Return the two unit axes (2, 3) of a plane: u to the right, v up; its normal is u × v.

    Parameters
    ----------
    field
        Name for the error message.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors of any length, (2, 3), inertial frame.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the name is unknown, or the vectors are no vectors, zero or not perpendicular.

    Examples
    --------
    >>> plane_axes("plane", "xz").tolist()
    [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    """
    if isinstance(plane, str):
        if plane not in PLANES:
            raise unknown_name(field, plane, PLANES)
        return np.array([AXES[plane[0]], AXES[plane[1]]])
    axes = as_array(field, plane, (2, 3))
    if axes.shape != (2, 3):
        raise ShapeError(f"{field}: expected shape (2, 3), got {axes.shape}")
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if (lengths < 1e-9).any():
        raise ValueRangeError(f"{field}: must have no zero axis, got {axes.tolist()}")
    axes = axes / lengths
    if abs(axes[0] @ axes[1]) > 1e-6:
        angle = np.degrees(np.arccos(axes[0] @ axes[1]))
        raise ValueRangeError(f"{field}: must have perpendicular axes, got {angle:.6g} degrees between them")
    axes[1] -= (axes[0] @ axes[1]) * axes[0]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def plane_across(field: str, axis: str | ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the plane (2, 3) across an axis, and the unit axis (3,).

    v is the vertical z without its part along the axis (y if the axis is vertical); u is perpendicular to
    both, with its first non-zero component positive. So ``"x"`` gives the plane yz, ``"y"`` xz, ``"z"`` xy.

    Parameters
    ----------
    field
        Name for the error message.
    axis
        ``"x"``, ``"y"``, ``"z"`` or a vector (3,), inertial frame.

    Raises
    ------
    UnknownNameError, ShapeError, ValueRangeError
        If the name is unknown, or the vector is no vector or zero.
    """
    if isinstance(axis, str):
        if axis not in AXES:
            raise unknown_name(field, axis, AXES)
        axis = AXES[axis]
    along = as_array(field, axis, (3,))
    length = np.linalg.norm(along)
    if along.shape != (3,) or length < 1e-9:
        raise ValueRangeError(
            f"{field}: expected 'x', 'y', 'z' or a non-zero vector (3,), got {along.tolist()}"
        )
    along = along / length
    up = np.array(AXES["z"] if abs(along[2]) < 1 - 1e-9 else AXES["y"])
    v = up - (up @ along) * along
    v /= np.linalg.norm(v)
    u = np.cross(v, along)
    first = u[np.argmax(np.abs(u) > 1e-9)]
    return np.array([u if first > 0 else -u, v]) + 0.0, along


@dataclass(frozen=True, eq=False, repr=False)
class Circle(PlanarReference):
    """Run around a circle at constant speed, with constant orientation [P16 5.7].

    With u and v the axes of the plane, p = p₀ + r(sin θ u + (cos θ − 1) v), θ from 0 to 2π ``turns``: the
    start is the circle's uppermost point.

    Parameters
    ----------
    start
        Pose at time 0, on the circle: unit dual quaternion, `DualQuaternion` or (8,), inertial frame, m.
    radius
        m.
    duration
        s, for all turns.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors (2, 3), inertial frame: u (to the right),
        v (up).
    turns
        How often round; need not be whole.
    clockwise
        Direction, seen with u to the right and v up.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If the start is no unit dual quaternion, a number is not positive, or the plane is none.

    Examples
    --------
    >>> circle = Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=0.07, duration=60.0)
    >>> circle.at(15.0).pose[[5, 7]].round(4).tolist()  # a quarter: 7 cm to the right, 7 cm down
    [0.035, -0.035]
    """

    kind = "circle"

    start: ArrayLike
    _: KW_ONLY
    radius: Metres
    duration: Seconds
    plane: Plane = "xz"
    turns: Positive = 1.0
    clockwise: bool = True

    def __post_init__(self) -> None:
        start = as_pose("start", self.start)
        trace = _around(self.radius, self.duration, self.turns, self.clockwise)
        self._place(trace, start, plane_axes("plane", self.plane))


@dataclass(frozen=True, eq=False, repr=False)
class Spiral(PlanarReference):
    """Run around a circle while advancing across it, with constant orientation [P16 5.10, 5.12].

    The circle is that of `Circle` on the plane across the axis; the advance is a ramp from 0 to ``length``
    (the source prints a constant).

    Parameters
    ----------
    start
        Pose at time 0: unit dual quaternion, `DualQuaternion` or shape (8,), inertial frame, m.
    radius
        m.
    length
        How far along the axis, m; may be negative.
    duration
        s, for all turns.
    axis
        ``"x"`` (circles on yz), ``"y"`` (on xz), ``"z"`` (on xy), or a vector (3,), inertial frame; the
        circles then start at their highest point.
    turns
        How often round; need not be whole.
    clockwise
        Direction, seen with the horizontal axis of the circle's plane to the right.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If the start is no unit dual quaternion, a number is not positive, or the axis is none.

    Examples
    --------
    >>> spiral = Spiral([1, 0, 0, 0, 0, 0, 0, 0], radius=0.07, length=0.07, axis="y", turns=3, duration=24.0)
    >>> abs(spiral.at(24.0).pose[5:]).round(4).tolist()  # half the position
    [0.0, 0.035, 0.0]
    """

    kind = "spiral"

    start: ArrayLike
    _: KW_ONLY
    radius: Metres
    length: Annotated[float, Meta(description="m")]
    duration: Seconds
    axis: Axis = "y"
    turns: Positive = 3.0
    clockwise: bool = True

    def __post_init__(self) -> None:
        start = as_pose("start", self.start)
        trace = _around(self.radius, self.duration, self.turns, self.clockwise)
        axes, along = plane_across("axis", self.axis)
        advance = float(as_array("length", self.length, ())) / trace.times[-1] * along
        self._place(trace, start, axes, advance=advance)


def _around(radius: float, duration: float, turns: float, clockwise: bool) -> PenPath:
    """Return the trace that starts at the top of a circle."""
    radius, duration = as_positive("radius", radius), as_positive("duration", duration)
    rate = 2 * math.pi * as_positive("turns", turns) / duration
    heading = np.array([0.0 if clockwise else math.pi])
    turn_rate = np.array([-rate if clockwise else rate])
    speed, times = np.array([rate * radius]), np.array([0.0, duration])
    return PenPath(np.zeros((1, 2)), heading, speed, turn_rate, heading, turn_rate, times)


@dataclass(frozen=True, eq=False, repr=False)
class Square(PlanarReference):
    """Run around a square, each side at constant speed, with constant orientation [P16 appendix C].

    With u (to the right) and v (up) the axes of the plane, a clockwise square starts at its upper left corner
    and runs along u, −v, −u and v; a counterclockwise one starts at its upper right corner and runs along −u,
    −v, u and v.

    Parameters
    ----------
    start
        Pose at time 0: unit dual quaternion, `DualQuaternion` or shape (8,), inertial frame, m.
    side
        m.
    duration
        s, for the whole square.
    shares
        How the duration is shared among the four sides, shape (4,), any positive numbers.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors (2, 3), inertial frame: u, v.
    clockwise
        Direction, seen with u to the right and v up.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If the start is no unit dual quaternion, a number is not positive, or the plane is none.

    Examples
    --------
    >>> square = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=40.0, shares=[5, 3, 5, 3])
    >>> square.corners.tolist()
    [12.5, 20.0, 32.5, 40.0]
    """

    kind = "square"

    start: ArrayLike
    _: KW_ONLY
    side: Metres
    duration: Seconds
    shares: Annotated[ArrayLike, Yaml(tuple[Positive, Positive, Positive, Positive])] = (1.0, 1.0, 1.0, 1.0)
    plane: Plane = "xz"
    clockwise: bool = True

    def __post_init__(self) -> None:
        start = as_pose("start", self.start)
        side = as_positive("side", self.side)
        shares = as_array("shares", self.shares)
        if shares.shape != (4,):
            raise ShapeError(f"shares: expected shape (4,), got {shares.shape}")
        if (shares <= 0).any():
            raise ValueRangeError(f"shares: must be > 0, got {shares.tolist()}")
        seconds = as_positive("duration", self.duration) * shares / shares.sum()
        across = side if self.clockwise else -side
        ends = ((across, 0.0), (across, -side), (0.0, -side), (0.0, 0.0))
        speeds = (side / seconds).tolist()
        trace = PenPath.of([StraightStroke(*end, speed) for end, speed in zip(ends, speeds, strict=True)])
        self._place(trace, start, plane_axes("plane", self.plane))


_NEWTON = 6  # steps from the guess below to rounding, at any angle
_MOST_TURNS = 10_000  # more are a slip in the unit of the pitch


@dataclass(frozen=True, eq=False, repr=False)
class Search(Reference):
    """Outwards on a plane by Archimedes' spiral, at constant speed and orientation, as who searches a hole.

    p = p₀ + a θ (cos θ u + sin θ v) with a = pitch/2π, u and v the axes of the plane, and θ from 0 on so that
    the way a/2 (θ √(1 + θ²) + arsinh θ) grows by ``speed``.

    Parameters
    ----------
    start
        Pose at time 0, the middle: unit dual quaternion, `DualQuaternion` or (8,), inertial frame, m.
    radius
        Where it ends, m.
    pitch
        Between two turns, m: what is looked for must not be narrower.
    speed
        m/s.
    plane
        ``"xy"``, ``"xz"`` or ``"yz"``, or two perpendicular vectors (2, 3), inertial frame: u and v.

    Raises
    ------
    ShapeError, ValueRangeError, UnknownNameError
        If the start is no unit dual quaternion, a number is not positive, or the plane is none.

    Examples
    --------
    >>> search = Search([1, 0, 0, 0, 0, 0, 0, 0], radius=0.003, pitch=0.001, speed=0.006)
    >>> round(search.duration, 2)  # s, for three turns
    4.77
    """

    kind = "search"

    start: ArrayLike
    _: KW_ONLY
    radius: Metres
    pitch: Metres
    speed: Annotated[float, Meta(gt=0, description="m/s")]
    plane: Plane = "xy"
    _axes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        growth = as_positive("pitch", self.pitch) / (2 * math.pi)  # m/rad
        last = as_positive("radius", self.radius) / growth
        if last > 2 * math.pi * _MOST_TURNS:
            raise ValueRangeError(
                f"pitch: {self.pitch:g} m makes {last / (2 * math.pi):.0f} turns, at most {_MOST_TURNS}"
            )
        way = 0.5 * growth * (last * math.hypot(1.0, last) + math.asinh(last))
        start, duration = as_pose("start", self.start), way / as_positive("speed", self.speed)
        axes = plane_axes("plane", self.plane)
        vars(self).update(start=start, duration=duration, corners=np.array([duration]), _axes=axes)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        growth = self.pitch / (2 * math.pi)
        way = times * (self.speed / growth)
        angle = way / np.sqrt(1.0 + 0.5 * way)  # right where it is small, and where it is large
        for _ in range(_NEWTON):
            root = np.sqrt(1.0 + angle * angle)
            angle -= (0.5 * (angle * root + np.arcsinh(angle)) - way) / root
        square = 1.0 + angle * angle
        rate = self.speed / (growth * np.sqrt(square))
        more = -angle * rate * rate / square
        out, along = self._turned(angle), self._turned(angle + 0.5 * math.pi)  # radial and across
        slope = out + angle[:, None] * along
        bend = 2 * along - angle[:, None] * out
        return motion_samples(
            translation(self.start) + growth * angle[:, None] * out,
            growth * rate[:, None] * slope,
            growth * (more[:, None] * slope + (rate * rate)[:, None] * bend),
            rotation(self.start),
        )

    def _turned(self, angle: Array) -> Array:
        """Return unit vectors (N, 3) at angles (N,) on the plane."""
        return np.cos(angle)[:, None] * self._axes[0] + np.sin(angle)[:, None] * self._axes[1]
