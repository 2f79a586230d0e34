"""Circles, and the spirals that they become when they advance."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import as_array, as_positive
from dqcontrol.references.planar import PlanarReference
from dqcontrol.references.plane import Axis, Plane, plane_across, plane_axes
from dqcontrol.references.sample import as_pose
from dqcontrol.references.strokes import PenPath
from dqcontrol.references.yaml_form import Metres, Positive, Seconds


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
    corners: NDArray[np.float64] = field(init=False, repr=False)

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
    corners: NDArray[np.float64] = field(init=False, repr=False)

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
