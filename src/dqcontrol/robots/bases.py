"""Mobile bases: parts of whole bodies."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.geometry import Box
from dqcontrol.robots.limits import Limits, as_limit
from dqcontrol.robots.serial_arm import SerialArm

DriveKind: TypeAlias = Literal["differential", "mecanum", "omni", "car-like", "tricycle"]

# z of each frame is the axis of x, y, φ in turn: thirds of a turn about (1, 1, 1), whose product is the identity.
_THIRD = np.array([0.5, 0.5, 0.5, 0.5, 0, 0, 0])
CLEARANCE = 0.02  # m; below a chassis

_FRAMES = np.array([_THIRD, _THIRD, -_THIRD, [1.0, 0, 0, 0, 0, 0, 0]])


@dataclass(frozen=True, kw_only=True)
class Chassis:
    """The body of a differential drive: what physics needs to know beside its wheels' radius and track.

    The chassis is a solid cylinder two centimetres above the floor. It stands on the two wheels and on two casters, one
    ahead of the axle and one behind it.

    Parameters
    ----------
    mass
        Of the chassis with all that is fixed to it, without wheels and arm, kg.
    radius, height
        Of the cylinder, m.
    wheel_mass
        Of each wheel, a solid disc, kg.
    wheel_torque
        Largest torque of each wheel's motor, N·m.
    caster_distance
        Of each caster from the axle, m.
    centre_ahead, centre_height
        The chassis' centre of mass ahead of the axle and above the floor, m; the latter is the middle of the cylinder
        if omitted.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive, or ``centre_ahead`` not finite.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> chassis = Chassis(
    ...     mass=60.0, radius=0.27, height=0.3, wheel_mass=2.0, wheel_torque=10.0, caster_distance=0.22
    ... )
    >>> round(chassis.centre_height, 3)
    0.17
    """

    mass: float
    radius: float
    height: float
    wheel_mass: float
    wheel_torque: float
    caster_distance: float
    centre_ahead: float = 0.0
    centre_height: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "radius", "height", "wheel_mass", "wheel_torque", "caster_distance"):
            as_positive(f"chassis.{name}", getattr(self, name))
        as_array("chassis.centre_ahead", self.centre_ahead, ())
        if not as_positive("chassis.centre_height", self.centre_height, zero_allowed=True):
            object.__setattr__(self, "centre_height", CLEARANCE + 0.5 * self.height)


@dataclass(frozen=True)
class HolonomicBase:
    """A base that moves in any direction of its plane: configuration (x, y, φ), inputs (ẋ, ẏ, φ̇). [S17 4.4, 4.5]

    x and y are those of what carries the base (the inertial frame, or the frame of the part before it), and φ turns it
    about z.

    Parameters
    ----------
    speed
        Largest |ẋ| and largest |ẏ|, m/s.
    turn_rate
        Largest |φ̇|, rad/s.
    acceleration, turn_acceleration
        With which its speed and its turning change at most, m/s² and rad/s²; plants with motors keep them: ``servo``.
    size
        Length, width and height of the box that stands for it among the robot's shapes, m; it stands on the floor, its
        middle at (x, y). Without it the base has no shape.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> dqc.WholeBody([dqc.HolonomicBase(), dqc.load_robot("panda")]).input_names[:3]
    ('x', 'y', 'phi')
    """

    kind: ClassVar[str] = "holonomic"
    configuration_size: ClassVar[int] = 3  # x, y and φ

    speed: float = math.inf
    turn_rate: float = math.inf
    acceleration: float = math.inf
    turn_acceleration: float = math.inf
    size: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("speed", "turn_rate", "acceleration", "turn_acceleration"):
            as_limit(name, getattr(self, name))
        if self.size is not None and (as_array("size", self.size, (3,)) <= 0).any():
            raise ValueRangeError(f"size: must be > 0, got {list(self.size)}")

    def joints(self) -> SerialArm:
        """Return the base as an arm: two sliding joints, x and y, and a revolute one, φ."""
        return planar_joints(self.kind.replace(" ", "-") + "-base", self.speed, self.turn_rate)


@dataclass(frozen=True)
class DifferentialDrive:
    """A base on two driven wheels: configuration (x, y, φ), inputs (v, ω). [S17 4.21–4.26]

    It moves along its heading, its x axis, and turns about the middle of the axle: ẋ = v cos φ, ẏ = v sin φ, φ̇ = ω.
    The wheels turn at ω_r = (v + b ω)/r and ω_l = (v − b ω)/r. As for `HolonomicBase`, x and y are those of what
    carries the base.

    Parameters
    ----------
    wheel_radius
        r, m.
    half_track
        b, half the distance between the wheels, m.
    displacement
        d, distance of the displaced point ahead of the axle, m; behind it if negative. It matters only in the form
        ``"unconstrained"`` of `WholeBody`.
    rim_speed
        Largest speed of the wheels' rims, m/s. It limits |v| + b |ω|; so the limits of the inputs, each alone, are
        rim_speed and rim_speed / b.
    acceleration, turn_acceleration
        Largest |v̇| and |ω̇|, m/s² and rad/s²; plants with motors keep them: ``servo`` and ``mobile``.
    chassis
        Its body, for physics.

    Raises
    ------
    ShapeError, ValueRangeError
        If a number is not positive, or the displacement zero.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.DifferentialDrive(wheel_radius=0.039, half_track=0.129, rim_speed=0.5)
    >>> dqc.WholeBody([base]).limits.velocity.round(3).tolist()
    [0.5, 3.876]
    """

    kind: ClassVar[str] = "differential drive"
    configuration_size: ClassVar[int] = 3

    wheel_radius: float
    half_track: float
    displacement: float = 0.1
    rim_speed: float = math.inf
    acceleration: float = math.inf
    turn_acceleration: float = math.inf
    chassis: Chassis | None = None

    def __post_init__(self) -> None:
        as_positive("wheel_radius", self.wheel_radius)
        as_positive("half_track", self.half_track)
        _check_displacement(self.displacement)
        for name in ("rim_speed", "acceleration", "turn_acceleration"):
            as_limit(name, getattr(self, name))

    @property
    def rim_lever(self) -> float:
        """b, by which turning adds to the speed of the fastest driven rim, |v| + b |ω|, m."""
        return self.half_track

    @property
    def turning_radius(self) -> float:
        """0: it turns on the spot."""
        return 0.0

    def joints(self) -> SerialArm:
        """Return the base as an arm, as if it could move sideways: sliding joints x and y, and a revolute one, φ."""
        return planar_joints("differential-drive", self.rim_speed, self.rim_speed / self.half_track)


def planar_joints(name: str, speed: float, turn_rate: float) -> SerialArm:
    """Return sliding joints x and y and a revolute one, φ, with these limits in m/s and rad/s."""
    unlimited = np.full(3, np.inf)
    return SerialArm(
        _FRAMES,
        ["prismatic", "prismatic", "revolute"],
        joint_names=["x", "y", "phi"],
        limits=Limits(-unlimited, unlimited, np.array([speed, speed, turn_rate]), unlimited),
        name=name,
    )


def _check_displacement(value: float) -> None:
    """Raise if a point is on the axle, with which a base cannot move sideways."""
    if float(as_array("displacement", value, ())) == 0:
        raise ValueRangeError(
            "displacement: must not be 0, because the middle of the axle cannot move sideways"
        )


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
            x, y = math.cos(wheel.heading + wheel.roller), math.sin(wheel.heading + wheel.roller)
            rows.append(np.array([x, y, wheel.x * y - wheel.y * x]) / (radius * math.cos(wheel.roller)))
        matrix = np.array(rows)
        matrix.flags.writeable = False
        vars(self).update(wheel_matrix=matrix)
        if self.rim_speed != math.inf:
            fastest = as_positive("rim_speed", self.rim_speed) / radius
            speed = float(fastest / np.hypot(matrix[:, 0], matrix[:, 1]).max())
            turn_rate = float(fastest / np.abs(matrix[:, 2]).max())
            vars(self).update(speed=min(self.speed, speed), turn_rate=min(self.turn_rate, turn_rate))
        super().__post_init__()

    @property
    def around_wheels(self) -> Box:
        """The upright box that holds its wheels, in its own axes, m: the least that its body takes."""
        radius, half = self.wheel_radius, np.zeros(2)
        wide = _HALF_WIDTH * radius
        for wheel in self.wheels:
            along, across = abs(math.cos(wheel.heading)), abs(math.sin(wheel.heading))
            x = abs(wheel.x) + radius * along + wide * across
            y = abs(wheel.y) + radius * across + wide * along
            half = np.maximum(half, [x, y])
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
        return as_array("speeds", speeds, (len(self.wheels),)) @ np.linalg.pinv(self.wheel_matrix).T

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
        signs = ((1, -1), (1, 1), (-1, -1), (-1, 1))
        return tuple(
            RollerWheel(x * self.half_wheelbase, y * self.half_track, 0.0, -x * y * math.pi / 4)
            for x, y in signs
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


@dataclass(frozen=True)
class _SteeredBase:
    """What cars and tricycles share: x and y are of the middle of the axle that is not steered, inputs are v and ω."""

    kind: ClassVar[str]
    configuration_size: ClassVar[int] = 3
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
        for name in ("wheel_radius", "half_track", "wheelbase"):
            as_positive(name, getattr(self, name))
        limit = as_positive("steering_limit", self.steering_limit)
        if limit > self._most:
            raise ValueRangeError(
                f"steering_limit: must be at most {self._most:.4g} rad for a {self.kind} base, got {limit:g}"
                + (" (is it in degrees?)" if limit > 2 else "")
            )
        _check_displacement(self.displacement)
        for name in ("rim_speed", "steering_rate", "acceleration", "turn_acceleration"):
            as_limit(name, getattr(self, name))

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
