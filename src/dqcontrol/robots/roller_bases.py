"""Bases on wheels with rollers, mecanum and omni: they move in any direction, each wheel along its rollers' axes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.geometry import Box
from dqcontrol.robots.bases import HolonomicBase

_HALF_WIDTH = 0.4  # of a wheel, as a share of its radius: as physics builds them


class RollerWheel(NamedTuple):
    """A wheel in the axes of its base, at the floor: where, which way it rolls, and the axis of the roller it is on."""

    x: float  # m
    y: float  # m
    heading: float  # rad: of the wheel's rolling
    roller: float  # rad: from the heading to the axis of the roller on the floor; 0 for omni wheels


@dataclass(frozen=True, kw_only=True)
class RollerBase(HolonomicBase):
    """What mecanum and omni bases share: the speeds of their wheels.

    A wheel at p that rolls along d, on rollers with the axis a (unit vectors), does not slip if
    a·(v + ω × p − r ϖ d) = 0, so its speed is ϖ = a·(v + ω × p) / (r a·d).
    """

    wheel_radius: float
    rim_speed: float = math.inf
    wheel_matrix: Array = field(init=False, repr=False, compare=False)

    @property
    def wheels(self) -> tuple[RollerWheel, ...]:
        """Its wheels, in the order of their speeds."""
        raise NotImplementedError

    def __post_init__(self) -> None:
        radius = as_positive("wheel_radius", self.wheel_radius)
        rows = []
        for wheel in self.wheels:
            axis = wheel.heading + wheel.roller
            a = np.array([math.cos(axis), math.sin(axis)])
            rows.append([a[0], a[1], wheel.x * a[1] - wheel.y * a[0]])
            rows[-1] = np.array(rows[-1]) / (radius * math.cos(wheel.roller))
        matrix = np.array(rows)
        matrix.flags.writeable = False
        object.__setattr__(self, "wheel_matrix", matrix)
        if self.rim_speed != math.inf:
            fastest = as_positive("rim_speed", self.rim_speed) / radius
            most = np.hypot(matrix[:, 0], matrix[:, 1]).max()
            object.__setattr__(self, "speed", min(self.speed, float(fastest / most)))
            object.__setattr__(
                self, "turn_rate", min(self.turn_rate, float(fastest / np.abs(matrix[:, 2]).max()))
            )
        super().__post_init__()

    @property
    def around_wheels(self) -> Box:
        """The upright box that holds its wheels, in its own axes, m: the least that its body takes."""
        radius, half = self.wheel_radius, np.zeros(2)
        for wheel in self.wheels:
            along, across = abs(math.cos(wheel.heading)), abs(math.sin(wheel.heading))
            wide = _HALF_WIDTH * radius
            half = np.maximum(
                half,
                [
                    abs(wheel.x) + radius * along + wide * across,
                    abs(wheel.y) + radius * across + wide * along,
                ],
            )
        return Box(algebra.pose([1.0, 0, 0, 0], [0, 0, radius]), np.array([*(2 * half), 2 * radius]))

    def wheel_speeds(self, twist: ArrayLike) -> Array:
        """Return the speed of each wheel, shape (…, k), rad/s.

        Parameters
        ----------
        twist
            Velocity of the base in its own axes, shape (…, 3): v_x, v_y (m/s) and ω (rad/s); `own_twist` turns inputs
            into these axes.

        Raises
        ------
        ShapeError, ValueRangeError
            If the size is wrong, or a number not finite.
        """
        return as_array("twist", twist, (3,)) @ self.wheel_matrix.T

    def from_wheel_speeds(self, speeds: ArrayLike) -> Array:
        """Return the velocity (…, 3) in the base's own axes that fits speeds (…, k) of the wheels, rad/s, best.

        With more than three wheels speeds may contradict each other: then some slip, and this is the least squares
        solution.
        """
        given = as_array("speeds", speeds, (len(self.wheels),))
        return given @ np.linalg.pinv(self.wheel_matrix).T

    @staticmethod
    def own_twist(phi: ArrayLike, rates: ArrayLike) -> Array:
        """Return inputs (ẋ, ẏ, φ̇), shape (…, 3), in the axes of a base that faces φ, shape (…)."""
        given, angle = as_array("rates", rates, (3,)), np.asarray(phi, dtype=np.float64)
        c, s = np.cos(angle), np.sin(angle)
        x, y = given[..., 0], given[..., 1]
        return np.stack([c * x + s * y, c * y - s * x, given[..., 2]], axis=-1)


@dataclass(frozen=True, kw_only=True)
class MecanumBase(RollerBase):
    """A base on four mecanum wheels: configuration (x, y, φ), inputs (ẋ, ẏ, φ̇), as of `HolonomicBase`.

    The rollers stand at 45°; those on the floor point to the middle of the base. Speeds of the wheels, in the order
    front right, front left, rear right, rear left, with v in the base's own axes:
    (v_x + v_y + (l + b) ω)/r, (v_x − v_y − (l + b) ω)/r, (v_x − v_y + (l + b) ω)/r, (v_x + v_y − (l + b) ω)/r.

    Parameters
    ----------
    wheel_radius
        r, m.
    half_track
        b, half the distance between right and left wheels, m.
    half_wheelbase
        l, half the distance between front and rear axle, m.
    rim_speed
        Largest speed of the wheels' rims, m/s: |v_x| + |v_y| + (l + b) |ω| ≤ rim_speed. ``speed`` becomes
        rim_speed / √2 at most, what it is for in the worst direction, and ``turn_rate`` rim_speed / (l + b).
    speed, turn_rate, acceleration, turn_acceleration, size
        As of `HolonomicBase`.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.25)
    >>> base.wheel_speeds([0.0, 0.5, 0.0]).round(9).tolist()  # to the left
    [10.0, -10.0, -10.0, 10.0]
    """

    kind: ClassVar[str] = "mecanum"

    half_track: float
    half_wheelbase: float

    @property
    def wheels(self) -> tuple[RollerWheel, ...]:
        """Front right, front left, rear right, rear left."""
        half, length = self.half_track, self.half_wheelbase
        turn = math.pi / 4
        return (
            RollerWheel(length, -half, 0.0, turn),
            RollerWheel(length, half, 0.0, -turn),
            RollerWheel(-length, -half, 0.0, -turn),
            RollerWheel(-length, half, 0.0, turn),
        )

    def __post_init__(self) -> None:
        for name in ("half_track", "half_wheelbase"):
            as_positive(name, getattr(self, name))
        super().__post_init__()


@dataclass(frozen=True, kw_only=True)
class OmniBase(RollerBase):
    """A base on three or more omni wheels around its middle: configuration (x, y, φ), inputs (ẋ, ẏ, φ̇).

    Wheel i stands at the angle αᵢ = first_angle + 2πi/k, R from the middle, and rolls across that direction: its speed
    is (−sin αᵢ v_x + cos αᵢ v_y + R ω)/r, with v in the base's own axes.

    Parameters
    ----------
    wheel_radius
        r, m.
    wheel_distance
        R, m.
    wheel_count
        k, 3 at least.
    first_angle
        α₀, rad; π/k if omitted, so that three wheels leave the front to two of them.
    rim_speed
        Largest speed of the wheels' rims, m/s; ``speed`` becomes rim_speed at most, ``turn_rate`` rim_speed / R.
    speed, turn_rate, acceleration, turn_acceleration, size
        As of `HolonomicBase`.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive, or there are fewer than three wheels.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.OmniBase(wheel_radius=0.05, wheel_distance=0.2)
    >>> base.wheel_speeds([0.0, 0.0, 1.0]).round(9).tolist()  # on the spot
    [4.0, 4.0, 4.0]
    """

    kind: ClassVar[str] = "omni"

    wheel_distance: float
    wheel_count: int = 3
    first_angle: float | None = None

    @property
    def wheels(self) -> tuple[RollerWheel, ...]:
        """From the first angle on, to the left."""
        first = math.pi / self.wheel_count if self.first_angle is None else self.first_angle
        angles = (first + math.tau * i / self.wheel_count for i in range(self.wheel_count))
        distance = self.wheel_distance
        return tuple(
            RollerWheel(distance * math.cos(a), distance * math.sin(a), a + math.pi / 2, 0.0) for a in angles
        )

    def __post_init__(self) -> None:
        as_positive("wheel_distance", self.wheel_distance)
        if not isinstance(self.wheel_count, int) or not 3 <= self.wheel_count <= 12:
            raise ValueRangeError(
                f"wheel_count: must be 3 … 12, got {self.wheel_count!r}: fewer wheels cannot move it in all directions"
            )
        if self.first_angle is not None:
            as_array("first_angle", self.first_angle, ())
        super().__post_init__()
