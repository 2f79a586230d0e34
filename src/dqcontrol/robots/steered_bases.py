"""Bases that steer: cars and tricycles, whose wheels bound how sharply they turn."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.robots.bases import check_limit, planar_joints
from dqcontrol.robots.serial_arm import SerialArm


@dataclass(frozen=True)
class _SteeredBase:
    """What cars and tricycles share: x and y are of the middle of the axle that is not steered, inputs are v and ω."""

    kind: ClassVar[str]
    _most: ClassVar[float]  # rad; of the steering angle

    wheel_radius: float
    half_track: float
    wheelbase: float
    steering_limit: float
    displacement: float = 0.1
    rim_speed: float = math.inf
    steering_rate: float = math.inf
    acceleration: float = math.inf
    turn_acceleration: float = math.inf

    def __post_init__(self) -> None:
        for field in ("wheel_radius", "half_track", "wheelbase"):
            as_positive(field, getattr(self, field))
        limit = as_positive("steering_limit", self.steering_limit)
        if limit > self._most:
            raise ValueRangeError(
                f"steering_limit: must be at most {self._most:.4g} rad for a {self.kind} base, got {limit:g}"
                + (" (is it in degrees?)" if limit > 2 else "")
            )
        if float(as_array("displacement", self.displacement, ())) == 0:
            raise ValueRangeError(
                "displacement: must not be 0, because the middle of the axle cannot move sideways"
            )
        for field in ("rim_speed", "steering_rate", "acceleration", "turn_acceleration"):
            check_limit(field, getattr(self, field))

    @property
    def configuration_size(self) -> int:
        """Number of coordinates: x, y and φ."""
        return 3

    @property
    def rim_lever(self) -> float:
        """Lever l by which turning adds to the speed of the fastest driven rim, |v| + l |ω|, m."""
        raise NotImplementedError

    @property
    def turning_radius(self) -> float:
        """ρ = L / tan δ_max, m: |ω| ≤ |v| / ρ; 0 if the wheel can stand across."""
        return 0.0 if self.steering_limit >= math.pi / 2 else self.wheelbase / math.tan(self.steering_limit)

    def steering_angle(self, v: ArrayLike, omega: ArrayLike) -> Array:
        """Return δ = arctan(L ω / v) of the wheel in the middle, rad, positive to the left.

        Parameters
        ----------
        v, omega
            Inputs of any equal shape, m/s and rad/s.

        Examples
        --------
        >>> import dqcontrol as dqc
        >>> car = dqc.CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.6)
        >>> float(car.steering_angle(-1.0, 1.0).round(3))
        -0.464
        """
        ahead, turning = np.asarray(v, dtype=np.float64), np.asarray(omega, dtype=np.float64)
        sign = np.where(ahead < 0, -1.0, 1.0)
        return np.arctan2(sign * self.wheelbase * turning, np.abs(ahead))

    def joints(self) -> SerialArm:
        """Return the base as an arm, as if it could move sideways: sliding joints x and y, and a revolute one, φ."""
        fastest_turn = self.rim_speed / self.rim_lever
        if self.turning_radius > 0:
            fastest_turn = self.rim_speed / (self.turning_radius + self.rim_lever)
        return planar_joints(self.kind.replace(" ", "-"), self.rim_speed, fastest_turn)


@dataclass(frozen=True)
class CarLikeBase(_SteeredBase):
    """A car: configuration (x, y, φ) of the middle of its rear axle, inputs (v, ω), |ω| ≤ |v| tan δ_max / L.

    It is driven at the rear and steered in front, by Ackermann's linkage: ẋ = v cos φ, ẏ = v sin φ,
    φ̇ = ω = v tan δ / L, where δ is the angle of a wheel in the middle of the front axle. So the same kernels move it
    as differential drives; turns that the wheels cannot be steered to become as sharp as they can. It does not turn on
    the spot. The steering angle follows the inputs at once, as speeds of wheels do; in ``servo`` it takes its time, if
    there is a ``steering_rate``. [De Luca, Oriolo, Samson 1998]

    Parameters
    ----------
    wheel_radius
        r, m.
    half_track
        b, half the distance between the rear wheels, m.
    wheelbase
        L, from the rear axle to the front one, m.
    steering_limit
        δ_max, rad, below π/2.
    displacement
        As of `DifferentialDrive`.
    rim_speed
        Largest speed of the rear wheels' rims, |v| + b |ω|, m/s.
    steering_rate
        Largest |δ̇|, rad/s; kept by ``servo``.
    acceleration, turn_acceleration
        Largest |v̇| and |ω̇|, m/s² and rad/s²; kept by ``servo``.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive, the displacement zero, or the steering limit 90° or more.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> car = dqc.CarLikeBase(0.1, 0.2, wheelbase=0.5, steering_limit=0.6, rim_speed=1.0)
    >>> round(car.turning_radius, 3)
    0.731
    >>> dqc.WholeBody([car]).integrate([0, 0, 0], [0.5, 9.0], 1.0).round(3).tolist()  # as sharp as it can
    [0.462, 0.164, 0.684]
    """

    kind: ClassVar[str] = "car-like"
    _most: ClassVar[float] = math.radians(89)

    @property
    def rim_lever(self) -> float:
        """b: the rear wheels are driven."""
        return self.half_track


@dataclass(frozen=True)
class SteeredTricycle(_SteeredBase):
    """A tricycle whose front wheel is driven and steered: configuration (x, y, φ), inputs (v, ω).

    x and y are of the middle of the rear axle. The front wheel, L ahead of it, rolls at √(v² + L²ω²) and stands at
    δ = arctan(L ω / v). With δ_max = 90° it turns on the spot. Limits bound its rim by |v| + L |ω|, which is up to 1.41
    times stricter than need be: so it is linear in the inputs, as that of the other drives.

    Parameters
    ----------
    wheel_radius
        r, m.
    half_track
        b, half the distance between the rear wheels, m.
    wheelbase
        L, from the rear axle to the front wheel, m.
    steering_limit
        δ_max, rad, π/2 at most.
    displacement
        As of `DifferentialDrive`.
    rim_speed
        Largest speed of the front wheel's rim, m/s.
    steering_rate
        Largest |δ̇|, rad/s; kept by ``servo``.
    acceleration, turn_acceleration
        Largest |v̇| and |ω̇|, m/s² and rad/s²; kept by ``servo``.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive, the displacement zero, or the steering limit above 90°.

    Examples
    --------
    >>> import dqcontrol as dqc, math
    >>> base = dqc.SteeredTricycle(0.1, 0.2, wheelbase=0.5, steering_limit=math.pi / 2)
    >>> base.turning_radius, base.front_wheel_speed(0.0, 1.0).tolist()  # rad/s
    (0.0, 5.0)
    """

    kind: ClassVar[str] = "steered tricycle"
    _most: ClassVar[float] = math.pi / 2 + 1e-12

    @property
    def rim_lever(self) -> float:
        """L: the front wheel is driven."""
        return self.wheelbase

    def front_wheel_speed(self, v: ArrayLike, omega: ArrayLike) -> Array:
        """Return √(v² + L²ω²)/r with the sign of v, rad/s, for inputs of any equal shape."""
        ahead, turning = np.asarray(v, dtype=np.float64), np.asarray(omega, dtype=np.float64)
        sign = np.where(ahead < 0, -1.0, 1.0)
        return sign * np.hypot(ahead, self.wheelbase * turning) / self.wheel_radius
