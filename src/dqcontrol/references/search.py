"""A spiral that searches."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.references.plane import Plane, plane_axes
from dqcontrol.references.reference import Reference
from dqcontrol.references.rigid_motion import motion_samples
from dqcontrol.references.sample import as_pose
from dqcontrol.references.yaml_form import Metres

_NEWTON = 6  # steps from the guess below to rounding, at any angle
_MOST_TURNS = 10_000


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
    4.75
    """

    kind = "search"

    start: ArrayLike
    _: KW_ONLY
    radius: Metres
    pitch: Metres
    speed: Annotated[float, Meta(gt=0, description="m/s")]
    plane: Plane = "xy"
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    _axes: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        growth = as_positive("pitch", self.pitch) / (2 * math.pi)  # m/rad
        last = as_positive("radius", self.radius) / growth
        if last > 2 * math.pi * _MOST_TURNS:
            raise ValueRangeError(
                f"pitch: {self.pitch:g} m makes {last / (2 * math.pi):.0f} turns, at most {_MOST_TURNS}"
            )
        way = 0.5 * growth * (last * math.hypot(1.0, last) + math.asinh(last))
        values = {
            "start": as_pose("start", self.start),
            "duration": way / as_positive("speed", self.speed),
            "_axes": plane_axes("plane", self.plane),
        }
        for name, value in {**values, "corners": np.array([values["duration"]])}.items():
            object.__setattr__(self, name, value)

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
