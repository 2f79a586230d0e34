"""What a mobile robot stands and drives on in physics: two driven wheels with casters, or wheels with rollers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.mobile.odometry import Odometry, RollerOdometry
from dqcontrol.plants.mobile.roller_wheels import add_roller_base
from dqcontrol.plants.mobile.wheeled_base import WHEELS, SolidBase, add_base
from dqcontrol.robots.bases import DifferentialDrive
from dqcontrol.robots.roller_bases import RollerBase


class Foot(NamedTuple):
    """Where a base stands on the floor, in its own axes, m."""

    name: str
    x: float
    y: float


class RunningGear:
    """Wheels in physics: what they look like, how they are told to turn, and what their angles tell.

    Attributes
    ----------
    base
        Its parameters.
    wheels
        Names of the wheels; those of their joints have ``wheel_`` before them.
    radius
        Of the wheels, m.
    slips
        Names of the speeds that `slip` returns.
    inputs
        Number of inputs of the base.
    feet
        Where it stands, counter-clockwise.
    """

    base: SolidBase
    wheels: tuple[str, ...]
    radius: float
    slips: tuple[str, ...]
    inputs: int
    feet: tuple[Foot, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the wheels' joints."""
        return tuple(f"wheel_{name}" for name in self.wheels)

    @property
    def mass(self) -> float:
        """Of chassis and wheels, kg."""
        return len(self.wheels) * self.base.wheel_mass + self.base.mass

    def add_to(self, spec: Any, mount: Array) -> Any:
        """Add it to an ``mjSpec``, with a post up to a point (3,), m; return its chassis."""
        raise NotImplementedError

    def wheel_speeds(self, inputs: Array, heading: float, share: float) -> Array:
        """Return the speeds of the wheels for a share of the base's inputs, rad/s, rims no faster than they may be."""
        raise NotImplementedError

    def odometry(self, start: Array) -> Odometry:
        """Return what adds up the angles of its wheels from a pose x, y and φ on, m and rad."""
        raise NotImplementedError

    def slip(self, velocity: Array, rates: Array) -> Array:
        """Return how fast contacts slide over the floor, m/s.

        Parameters
        ----------
        velocity
            Of the base in its own axes: ahead, to the left (m/s) and turning (rad/s).
        rates
            Of the wheels, rad/s.
        """
        raise NotImplementedError


class DriveGear(RunningGear):
    """A differential drive: wheels right and left, casters ahead of the axle and behind it."""

    wheels: tuple[str, ...] = WHEELS
    slips: tuple[str, ...] = (*WHEELS, "sideways")
    inputs = 2

    def __init__(self, base: SolidBase, drive: DifferentialDrive) -> None:
        self.base = base
        self.radius: float = drive.wheel_radius
        self._drive = drive
        self._fastest = drive.rim_speed / drive.wheel_radius
        assert base.caster_distance is not None
        self.feet: tuple[Foot, ...] = (
            Foot("front caster", base.caster_distance, 0.0),
            Foot("left wheel", 0.0, drive.half_track),
            Foot("rear caster", -base.caster_distance, 0.0),
            Foot("right wheel", 0.0, -drive.half_track),
        )

    def add_to(self, spec: Any, mount: Array) -> Any:
        """Add it; see `RunningGear.add_to`."""
        return add_base(spec, self.base, self._drive, mount)

    def wheel_speeds(self, inputs: Array, heading: float, share: float) -> Array:
        """Return the wheels' speeds for v and ω, along the same arc where the rims would be too fast."""
        v, turning = float(inputs[0]), self._drive.half_track * float(inputs[1])
        right, left = share * (v + turning) / self.radius, share * (v - turning) / self.radius
        scale = min(1.0, self._fastest / max(abs(right), abs(left), 1e-12))
        return np.array([scale * right, scale * left])

    def odometry(self, start: Array) -> Odometry:
        """Return its odometry; see `RunningGear.odometry`."""
        return Odometry(self._drive, start, self.base.ticks, self.base.wheel_errors)

    def slip(self, velocity: Array, rates: Array) -> Array:
        """Return the speeds of the right and the left wheel's contact along the heading, and of the axle across it."""
        forward, across, turn = velocity
        b, r = self._drive.half_track, self.radius
        return np.array([forward + b * turn - r * rates[0], forward - b * turn - r * rates[1], across])


class RollerGear(RunningGear):
    """Mecanum or omni wheels, in the order of `RollerBase.wheels`."""

    inputs = 3

    def __init__(self, base: SolidBase, drive: RollerBase) -> None:
        self.base = base
        self.radius: float = drive.wheel_radius
        self._drive = drive
        self.wheels: tuple[str, ...] = tuple(str(i + 1) for i in range(len(drive.wheels)))
        self.slips: tuple[str, ...] = self.wheels
        self._fastest = drive.rim_speed / drive.wheel_radius
        self._along = self.radius * np.cos([wheel.roller for wheel in drive.wheels])
        feet = [Foot(f"wheel {i + 1}", wheel.x, wheel.y) for i, wheel in enumerate(drive.wheels)]
        self.feet: tuple[Foot, ...] = tuple(sorted(feet, key=lambda foot: math.atan2(foot.y, foot.x)))

    def add_to(self, spec: Any, mount: Array) -> Any:
        """Add it; see `RunningGear.add_to`."""
        return add_roller_base(spec, self.base, self._drive, mount)

    def wheel_speeds(self, inputs: Array, heading: float, share: float) -> Array:
        """Return the wheels' speeds for ẋ, ẏ and φ̇ of a base that faces ``heading``, in the same proportion."""
        speeds = share * self._drive.wheel_speeds(self._drive.own_twist(heading, inputs))
        return speeds * min(1.0, self._fastest / max(float(np.abs(speeds).max()), 1e-12))

    def odometry(self, start: Array) -> Odometry:
        """Return its odometry; see `RunningGear.odometry`."""
        return RollerOdometry(self._drive, start, self.base.ticks, self.base.wheel_errors)

    def slip(self, velocity: Array, rates: Array) -> Array:
        """Return the speed of each wheel's contact along the axis of the roller that it is on."""
        return self._along * (self._drive.wheel_speeds(velocity) - rates)


def running_gear(base: SolidBase, drive: DifferentialDrive | RollerBase) -> RunningGear:
    """Return what a base stands on."""
    return RollerGear(base, drive) if isinstance(drive, RollerBase) else DriveGear(base, drive)
