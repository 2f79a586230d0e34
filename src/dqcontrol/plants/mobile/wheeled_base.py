"""A base on wheels, in physics: its parameters, all of them assumed, and the MuJoCo bodies of two driven wheels."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from msgspec.structs import asdict
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.mobile.odometry import Odometry, RollerOdometry
from dqcontrol.plants.mujoco.mujoco_model import add_geom, add_servo, weigh
from dqcontrol.robots.bases import CLEARANCE, Chassis, DifferentialDrive, RollerBase, RollerWheel
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.limits import Inertia
from dqcontrol.robots.poses import z_onto
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.whole_body import WholeBody

FLOOR, THINGS = 1, 2  # what touches what: wheels only the floor, things all but wheels
WHEELS = ("right", "left")

_CHASSIS = (0.22, 0.24, 0.27, 1.0)
TYRE = (0.10, 0.10, 0.11, 1.0)
RIM = (0.75, 0.77, 0.80, 1.0)
_POST = (0.80, 0.82, 0.84, 1.0)
_OF_THE_ROBOT = tuple(each.name for each in fields(Chassis))
_OF_CASTERS = ("radius", "caster_distance")  # which wheels with rollers do not need


_WheelError = Annotated[float, Meta(ge=-0.5, le=0.5)]


class WheeledBase(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a base on wheels moves in physics: its body, if the robot has another or none, and what it rolls on.

    The geometry of the wheels is the robot's own. The wheels of a differential drive touch the floor at one point each,
    below their centres; casters are spheres, one ahead of the axle and one behind it. Mecanum and omni wheels stand on
    rollers, ellipsoids that turn freely about their axes, as thick as makes the wheel round; such bases have no casters
    and are boxes over their wheels, without a ``radius``.

    Parameters
    ----------
    mass, radius, height, centre_ahead, centre_height, wheel_mass, caster_distance, wheel_torque
        As of `Chassis`; those of the robot's own chassis if omitted.
    friction, caster_friction
        Coulomb's coefficients of wheels and casters on the floor.
    caster_gap
        How far the caster behind the axle is above the floor, m, so that the wheels bear the load.
    rolling_resistance
        Torque against each wheel's turning, N·m.
    wheel_time_constant
        With which the speed controllers of the wheels let the unloaded robot follow, s.
    ticks
        Counts of a wheel's encoder in a turn; the speed controllers do not feel them, the odometry does.
    wheel_errors
        By which share the odometry takes each wheel, right and left (or in the order of a `MecanumBase` or an
        `OmniBase`), for larger than it is: it drifts. None if omitted.
    roller_count
        Of rollers a wheel.
    roller_friction
        Torque against each roller's turning, N·m.

    Raises
    ------
    ValueRangeError
        If a number is outside of what is allowed.
    """

    spec_key: ClassVar[str] = "plant.base"
    mass: Annotated[float, Meta(gt=0, le=1e4, description="kg")] | None = None
    radius: Annotated[float, Meta(gt=0, le=10, description="m")] | None = None
    height: Annotated[float, Meta(gt=0, le=10, description="m")] | None = None
    centre_ahead: Annotated[float, Meta(ge=-10, le=10, description="m")] | None = None
    centre_height: Annotated[float, Meta(gt=0, le=10, description="m")] | None = None
    wheel_mass: Annotated[float, Meta(gt=0, le=1e3, description="kg")] | None = None
    friction: Annotated[float, Meta(ge=0, le=10)] = 0.8
    caster_friction: Annotated[float, Meta(ge=0, le=10)] = 0.02
    caster_distance: Annotated[float, Meta(gt=0, le=10, description="m")] | None = None
    caster_gap: Annotated[float, Meta(ge=0, le=0.1, description="m")] = 0.001
    rolling_resistance: Annotated[float, Meta(ge=0, le=100, description="N·m")] = 0.005
    wheel_torque: Annotated[float, Meta(gt=0, le=1e4, description="N·m")] | None = None
    wheel_time_constant: Annotated[float, Meta(gt=0, le=10, description="s")] = 0.02
    ticks: Annotated[float, Meta(gt=0, le=1e7, description="counts a turn")] = 508.8
    wheel_errors: Annotated[tuple[_WheelError, ...], Meta(max_length=12)] = ()
    roller_count: Annotated[int, Meta(ge=8, le=32, description="a wheel")] = 12  # fewer make no round wheel
    roller_friction: Annotated[float, Meta(ge=0, le=10, description="N·m")] = 1e-4

    def body_of(self, robot: Robot) -> Robot:
        """Return a robot whose drive has this base as its chassis, if that is wider than its own or it has none."""
        drive = robot.parts[0] if isinstance(robot, WholeBody) else None
        own = getattr(drive, "chassis", None)
        if not isinstance(drive, DifferentialDrive) or (self.radius or 0.0) <= (own.radius if own else 0.0):
            return robot
        assert isinstance(robot, WholeBody)
        solid = self.under(drive, robot.name)
        chassis = Chassis(**{field: getattr(solid, field) for field in _OF_THE_ROBOT})
        return WholeBody([replace(drive, chassis=chassis), *robot.parts[1:]], robot.name, robot.form)

    def under(self, drive: DifferentialDrive | RollerBase, name: str) -> SolidBase:
        """Return this base with all its numbers, those that are missing from the drive's own chassis.

        Raises
        ------
        ValueRangeError
            If neither has them, or there are numbers of what the base does not have; ``name`` is that of the robot.
        """
        chassis = getattr(drive, "chassis", None)
        own = {field: getattr(self, field) for field in _OF_THE_ROBOT}
        found = {key: getattr(chassis, key, None) if value is None else value for key, value in own.items()}
        source = "Give them here, or as chassis of the differential drive in the robot's file"
        if isinstance(drive, RollerBase):
            source = "Give them here"
            for field in _OF_CASTERS:
                if found.pop(field) is not None:
                    raise ValueRangeError(
                        f"plant.base.{field}: leave it out; {name} stands on {drive.kind} wheels, without casters, and "
                        "its body is a box over them"
                    )
        if chassis is None:
            found["centre_ahead"] = found["centre_ahead"] or 0.0
            if found["height"] is not None:
                found["centre_height"] = found["centre_height"] or CLEARANCE + 0.5 * found["height"]
        missing = [field for field, value in found.items() if value is None and field != "centre_height"]
        if missing:
            raise ValueRangeError(
                f"plant.base: the body of {name} is unknown, and physics needs it; missing: {', '.join(missing)}. "
                f"{source}"
            )
        wheels = len(drive.wheels) if isinstance(drive, RollerBase) else len(WHEELS)
        if len(self.wheel_errors) not in (0, wheels):
            raise ValueRangeError(
                f"plant.base.wheel_errors: expected {wheels} numbers, one a wheel, got {len(self.wheel_errors)}"
            )
        numbers: dict[str, Any] = asdict(self) | found
        numbers["wheel_errors"] = self.wheel_errors or (0.0,) * wheels
        return SolidBase(**numbers)


class SolidBase(WheeledBase, frozen=True, kw_only=True):
    """A wheeled base of which every number is known; on rollers ``radius`` and ``caster_distance`` are None."""

    mass: float = 0.0
    height: float = 0.0
    centre_ahead: float = 0.0
    centre_height: float = 0.0
    wheel_mass: float = 0.0
    wheel_torque: float = 0.0


def add_floor(spec: Any) -> None:
    """Add a floor, on which the friction of what stands on it counts."""
    ground = add_geom(spec.worldbody, "PLANE", [0, 0, 1], name="ground", rgba=[0, 0, 0, 0])
    ground.contype, ground.friction = FLOOR | THINGS, [0, 0, 0]


def add_chassis(
    spec: Any, base: SolidBase, kind: str, size: ArrayLike, inertia: ArrayLike, mount: Array
) -> Any:
    """Add a free chassis, that things touch and the floor does not, with a post up to what it carries; return it.

    Parameters
    ----------
    spec
        ``mjSpec``.
    base
        Its masses and height.
    kind, size
        MuJoCo's, of its geom.
    inertia
        About its centre of mass, along its axes, shape (3,), kg m².
    mount
        Where what it carries begins, shape (3,), m.
    """
    body = spec.worldbody.add_body(name="base")
    body.add_freejoint(name="base")
    weigh(body, base.mass, [base.centre_ahead, 0, base.centre_height], inertia)
    middle = [0, 0, CLEARANCE + base.height / 2]
    add_geom(body, kind, size, name="chassis", pos=middle, rgba=_CHASSIS, conaffinity=THINGS)
    x, y, top = mount
    if top > CLEARANCE + base.height:
        add_geom(body, "CYLINDER", [0.03], fromto=[x, y, CLEARANCE + base.height, x, y, top], rgba=_POST)
    return body


def with_assumed_inertia(arm: SerialArm, masses: ArrayLike, radius: float) -> SerialArm:
    """Return the arm with solid rods from each joint to the next (balls where they coincide) as its links.

    Parameters
    ----------
    arm
        Any arm; its own inertias are lost.
    masses
        One for all links, or one a link, kg.
    radius
        Of the rods, m.
    """
    n = arm.configuration_size
    mass = np.broadcast_to(np.asarray(masses, dtype=np.float64), n)
    ends = arm.chain[1:, 4:7]
    tensors = np.empty((n, 3, 3))
    for i, end in enumerate(ends):
        length = float(np.linalg.norm(end))
        if length < radius:
            tensors[i] = 0.4 * mass[i] * radius**2 * np.eye(3)
            continue
        along = np.outer(end, end) / length**2
        across, _, around = solid_cylinder(mass[i], radius, length, 2)
        tensors[i] = around * along + across * (np.eye(3) - along)
    return SerialArm(
        arm.chain[:, :7],
        arm.joint_types,
        limits=arm.limits,
        joint_names=arm.joint_names,
        name=arm.name,
        inertia=Inertia(mass.copy(), 0.5 * ends, tensors),
    )


def _add_wheel(body: Any, name: str, base: SolidBase, radius: float, side: float) -> None:
    wheel = body.add_body(name=f"wheel_{name}", pos=[0, side, radius])
    weigh(wheel, base.wheel_mass, [0, 0, 0], solid_cylinder(base.wheel_mass, radius, 0.3 * radius, 1))
    _add_axle(wheel, f"wheel_{name}", base)
    touching(add_geom(wheel, "SPHERE", [radius], name=f"wheel_{name}", group=4), base.friction)
    half = 0.12 * radius
    for size, across, colour in ((radius, half, TYRE), (0.6 * radius, 1.08 * half, RIM)):
        add_geom(wheel, "CYLINDER", [size], fromto=[0, -across, 0, 0, across, 0], rgba=colour)
    spoke = [-0.45 * radius, 0, 0, 0.45 * radius, 0, 0]
    add_geom(wheel, "CAPSULE", [1.2 * half], fromto=spoke, rgba=TYRE)


def _add_axle(wheel: Any, name: str, base: SolidBase) -> None:
    """Let a wheel turn about its axis y."""
    joint = wheel.add_joint(name=name, type=import_mujoco().mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    joint.frictionloss = base.rolling_resistance


def touching(geom: Any, friction: float) -> None:
    """Let a geom roll or slide on the floor."""
    geom.contype, geom.conaffinity, geom.condim, geom.friction = 0, FLOOR, 3, [friction, 0, 0]


def solid_cylinder(mass: float, radius: float, height: float, axis: int) -> list[float]:
    """Return the principal moments of a solid cylinder about its centre, kg m²."""
    moments = [mass * (3 * radius**2 + height**2) / 12] * 3
    moments[axis] = 0.5 * mass * radius**2
    return moments


def yaw_of(quaternion: Any) -> float:
    """Return the heading of a body, rad, from its orientation (4,)."""
    w, x, y, z = quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


_ROLLER = 0.25  # of the wheel's radius: the rollers' own, in their middle
_ROLLERS_SHARE = 0.3  # of the wheel's mass


def _add_roller_wheel(body: Any, name: str, wheel: RollerWheel, base: SolidBase, radius: float) -> None:
    """Add a hub that turns about its axle, and the rollers on it."""
    half = 0.5 * wheel.heading
    hub = body.add_body(name=name, pos=[wheel.x, wheel.y, radius])
    hub.quat = [math.cos(half), 0, 0, math.sin(half)]
    hub_mass, thick = (1 - _ROLLERS_SHARE) * base.wheel_mass, _ROLLER * radius
    weigh(hub, hub_mass, [0, 0, 0], solid_cylinder(hub_mass, radius, 0.6 * radius, 1))
    _add_axle(hub, name, base)
    out = radius - thick
    long = math.sqrt(thick * out) / math.cos(wheel.roller)  # as its curvature along the wheel is the wheel's
    ends = [0, -0.5 * long, 0, 0, 0.5 * long, 0]
    add_geom(hub, "CYLINDER", [out - 0.5 * thick], fromto=ends, rgba=RIM)
    mass = _ROLLERS_SHARE * base.wheel_mass / base.roller_count
    for k in range(base.roller_count):
        angle = math.tau * k / base.roller_count
        along = np.array([math.cos(angle), 0.0, math.sin(angle)])
        axis = math.cos(wheel.roller) * along + math.sin(wheel.roller) * np.array([0.0, 1.0, 0.0])
        place = [out * math.sin(angle), 0.0, -out * math.cos(angle)]
        roller = hub.add_body(name=f"{name}_roller_{k + 1}", pos=place, quat=z_onto(axis)[:4])
        weigh(roller, mass, [0, 0, 0], [mass * thick**2] * 3)
        turning = roller.add_joint(type=import_mujoco().mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        turning.frictionloss = base.roller_friction
        touching(add_geom(roller, "ELLIPSOID", [thick, thick, long], rgba=TYRE), base.friction)


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

    wheels: tuple[str, ...]
    slips: tuple[str, ...]
    inputs: int
    feet: tuple[Foot, ...]

    def __init__(self, base: SolidBase, drive: DifferentialDrive | RollerBase) -> None:
        self.base = base
        self.radius: float = drive.wheel_radius
        self._fastest = drive.rim_speed / drive.wheel_radius

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

    def add_motors(self, spec: Any, mass: float) -> None:
        """Add the speed controllers of the wheels; ``mass`` is all that they move, kg."""
        base, count = self.base, len(self.wheels)
        # the robot's share and the wheel's own
        inertia = (mass + 0.5 * count * base.wheel_mass) / count * self.radius**2
        gain = inertia / base.wheel_time_constant
        for name in self.joints:
            motor = add_servo(spec, name, base.wheel_torque)
            motor.gainprm[0], motor.biasprm[2] = gain, -gain

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
        super().__init__(base, drive)
        self._drive = drive
        assert base.caster_distance is not None
        self._caster = base.caster_distance
        self.feet: tuple[Foot, ...] = (
            Foot("front caster", self._caster, 0.0),
            Foot("left wheel", 0.0, drive.half_track),
            Foot("rear caster", -self._caster, 0.0),
            Foot("right wheel", 0.0, -drive.half_track),
        )

    def add_to(self, spec: Any, mount: Array) -> Any:
        """Add chassis, two wheels and casters; see `RunningGear.add_to`."""
        base = self.base
        assert base.radius is not None
        inertia = solid_cylinder(base.mass, base.radius, base.height, 2)
        size = [base.radius, base.height / 2, 0]
        body = add_chassis(spec, base, "CYLINDER", size, inertia, mount)
        ball = 0.5 * CLEARANCE
        for name, x, gap in (("front", self._caster, 0.0), ("rear", -self._caster, base.caster_gap)):
            caster = add_geom(body, "SPHERE", [ball], name=f"caster_{name}", pos=[x, 0, ball + gap], rgba=RIM)
            touching(caster, base.caster_friction)
        for name, side in zip(WHEELS, (-1, 1), strict=True):
            _add_wheel(body, name, base, self.radius, side * self._drive.half_track)
        return body

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
        super().__init__(base, drive)
        self._drive = drive
        self.slips = self.wheels = tuple(str(i + 1) for i in range(len(drive.wheels)))
        self._along = self.radius * np.cos([wheel.roller for wheel in drive.wheels])
        feet = [Foot(f"wheel {i + 1}", wheel.x, wheel.y) for i, wheel in enumerate(drive.wheels)]
        self.feet: tuple[Foot, ...] = tuple(sorted(feet, key=lambda foot: math.atan2(foot.y, foot.x)))

    def add_to(self, spec: Any, mount: Array) -> Any:
        """Add a box on wheels with rollers; see `RunningGear.add_to`.

        A roller is an ellipsoid about its axis, as thick as makes its wheel round: of two neighbours one touches the
        floor, or both. Rollers turn freely.
        """
        base, wheels = self.base, self._drive.wheels
        half = np.array([*np.abs([[wheel.x, wheel.y] for wheel in wheels]).max(axis=0), base.height / 2])
        inertia = base.mass / 3 * (np.sum(half**2) - half**2)
        size = half - [0, 0.4 * self.radius, 0]  # between its wheels
        body = add_chassis(spec, base, "BOX", size, inertia, mount)
        for name, wheel in zip(self.joints, wheels, strict=True):
            _add_roller_wheel(body, name, wheel, base, self.radius)
        return body

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
