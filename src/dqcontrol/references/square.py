"""Squares."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.references.planar import PlanarReference
from dqcontrol.references.plane import Plane, plane_axes
from dqcontrol.references.sample import as_pose
from dqcontrol.references.strokes import PenPath, StraightStroke
from dqcontrol.references.yaml_form import Metres, Positive, Seconds, Yaml


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
    corners: NDArray[np.float64] = field(init=False, repr=False)

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
