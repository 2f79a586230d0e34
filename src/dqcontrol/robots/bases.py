"""Mobile bases: parts of whole bodies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.serial_arm import SerialArm

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
        for field in ("mass", "radius", "height", "wheel_mass", "wheel_torque", "caster_distance"):
            as_positive(f"chassis.{field}", getattr(self, field))
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

    speed: float = math.inf
    turn_rate: float = math.inf
    acceleration: float = math.inf
    turn_acceleration: float = math.inf
    size: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        for field in ("speed", "turn_rate", "acceleration", "turn_acceleration"):
            check_limit(field, getattr(self, field))
        if self.size is not None and (as_array("size", self.size, (3,)) <= 0).any():
            raise ValueRangeError(f"size: must be > 0, got {list(self.size)}")

    @property
    def configuration_size(self) -> int:
        """Number of coordinates: x, y and φ."""
        return 3

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
        if float(as_array("displacement", self.displacement, ())) == 0:
            raise ValueRangeError(
                "displacement: must not be 0, because the middle of the axle cannot move sideways"
            )
        for field in ("rim_speed", "acceleration", "turn_acceleration"):
            check_limit(field, getattr(self, field))

    @property
    def configuration_size(self) -> int:
        """Number of coordinates: x, y and φ."""
        return 3

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


def check_limit(field: str, value: float) -> None:
    """Raise unless a limit is positive; infinity is none."""
    if not (isinstance(value, float) and math.isinf(value) and value > 0):
        as_positive(field, value)
