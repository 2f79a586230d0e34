"""Running gear in physics: two driven wheels with casters, or wheels with rollers."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.mobile.odometry import Odometry, RollerOdometry
from dqcontrol.plants.mobile.wheeled_base import (
    RIM,
    TYRE,
    WHEELS,
    SolidBase,
    add_base,
    add_chassis,
    shown,
    solid_cylinder,
    touching,
)
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.robots.bases import DifferentialDrive, RollerBase, RollerWheel
from dqcontrol.robots.kinematics.axes import z_onto

_ROLLER = 0.25  # of the wheel's radius: the rollers' own, in their middle
_ROLLERS_SHARE = 0.3  # of the wheel's mass


def add_roller_base(spec: Any, base: SolidBase, drive: RollerBase, mount: Array) -> Any:
    """Add a box on wheels with rollers to an ``mjSpec``; return the box.

    A roller is an ellipsoid about its axis, as thick as makes its wheel round: of two neighbours one touches the floor,
    or both. Rollers turn freely.

    Parameters
    ----------
    spec
        ``mjSpec``.
    base, drive
        Parameters and geometry.
    mount
        Where what the base carries begins, shape (3,), m; a post leads there.
    """
    half = np.array([*np.abs([[wheel.x, wheel.y] for wheel in drive.wheels]).max(axis=0), base.height / 2])
    inertia = base.mass / 3 * (np.sum(half**2) - half**2)
    size = half - [0, 0.4 * drive.wheel_radius, 0]  # between its wheels
    body = add_chassis(spec, base, import_mujoco().mjtGeom.mjGEOM_BOX, size, inertia, mount)
    for i, wheel in enumerate(drive.wheels):
        _add_wheel(body, f"wheel_{i + 1}", wheel, base, drive.wheel_radius)
    return body


def _add_wheel(body: Any, name: str, wheel: RollerWheel, base: SolidBase, radius: float) -> None:
    """Add a hub that turns about its axle, and the rollers on it."""
    mujoco, half = import_mujoco(), 0.5 * wheel.heading
    hub = body.add_body(
        name=name, pos=[wheel.x, wheel.y, radius], quat=[math.cos(half), 0, 0, math.sin(half)]
    )
    hub_mass, thick = (1 - _ROLLERS_SHARE) * base.wheel_mass, _ROLLER * radius
    hub.mass, hub.ipos, hub.explicitinertial = hub_mass, [0, 0, 0], True
    hub.inertia = solid_cylinder(hub_mass, radius, 0.6 * radius, 1)
    joint = hub.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    joint.frictionloss = base.rolling_resistance
    out = radius - thick
    long = math.sqrt(thick * out) / math.cos(wheel.roller)  # as its curvature along the wheel is the wheel's
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    ends = [0, -0.5 * long, 0, 0, 0.5 * long, 0]
    shown(hub.add_geom(type=cylinder, fromto=ends, size=[out - 0.5 * thick, 0, 0], rgba=RIM, mass=0))
    mass = _ROLLERS_SHARE * base.wheel_mass / base.roller_count
    for k in range(base.roller_count):
        angle = math.tau * k / base.roller_count
        along = np.array([math.cos(angle), 0.0, math.sin(angle)])
        axis = math.cos(wheel.roller) * along + math.sin(wheel.roller) * np.array([0.0, 1.0, 0.0])
        place = [out * math.sin(angle), 0.0, -out * math.cos(angle)]
        roller = hub.add_body(name=f"{name}_roller_{k + 1}", pos=place, quat=z_onto(axis)[:4])
        roller.mass, roller.ipos, roller.explicitinertial = mass, [0, 0, 0], True
        roller.inertia = [mass * thick**2] * 3
        turning = roller.add_joint(type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        turning.frictionloss = base.roller_friction
        ellipsoid = mujoco.mjtGeom.mjGEOM_ELLIPSOID
        touching(roller.add_geom(type=ellipsoid, size=[thick, thick, long], rgba=TYRE, mass=0), base.friction)


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
