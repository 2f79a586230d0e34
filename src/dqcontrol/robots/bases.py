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
_FRAMES = np.array([_THIRD, _THIRD, -_THIRD, [1.0, 0, 0, 0, 0, 0, 0]])


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

    def __post_init__(self) -> None:
        _check_limit("speed", self.speed)
        _check_limit("turn_rate", self.turn_rate)

    @property
    def configuration_size(self) -> int:
        """Number of coordinates: x, y and φ."""
        return 3

    def joints(self) -> SerialArm:
        """Return the base as an arm: two sliding joints, x and y, and a revolute one, φ."""
        return _planar("holonomic-base", self.speed, self.turn_rate)


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

    def __post_init__(self) -> None:
        as_positive("wheel_radius", self.wheel_radius)
        as_positive("half_track", self.half_track)
        if float(as_array("displacement", self.displacement, ())) == 0:
            raise ValueRangeError(
                "displacement: must not be 0, because the middle of the axle cannot move sideways"
            )
        _check_limit("rim_speed", self.rim_speed)

    @property
    def configuration_size(self) -> int:
        """Number of coordinates: x, y and φ."""
        return 3

    def joints(self) -> SerialArm:
        """Return the base as an arm, as if it could move sideways: sliding joints x and y, and a revolute one, φ."""
        return _planar("differential-drive", self.rim_speed, self.rim_speed / self.half_track)


def _planar(name: str, speed: float, turn_rate: float) -> SerialArm:
    unlimited = np.full(3, np.inf)
    return SerialArm(
        _FRAMES,
        ["prismatic", "prismatic", "revolute"],
        joint_names=["x", "y", "phi"],
        limits=Limits(-unlimited, unlimited, np.array([speed, speed, turn_rate]), unlimited),
        name=name,
    )


def _check_limit(field: str, value: float) -> None:
    if not (isinstance(value, float) and math.isinf(value) and value > 0):
        as_positive(field, value)
