"""A base on two driven wheels, in physics: its parameters, all of them assumed, and its MuJoCo bodies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from msgspec import Meta
from msgspec.structs import asdict

from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.robots.bases import CLEARANCE
from dqcontrol.robots.limits import Inertia
from dqcontrol.robots.serial_arm import SerialArm

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from dqcontrol.robots.bases import DifferentialDrive

FLOOR, THINGS = 1, 2  # what touches what: wheels only the floor, things all but wheels
WHEELS = ("right", "left")

_CHASSIS = (0.22, 0.24, 0.27, 1.0)
_TYRE = (0.10, 0.10, 0.11, 1.0)
_RIM = (0.75, 0.77, 0.80, 1.0)
_POST = (0.80, 0.82, 0.84, 1.0)
_OF_THE_ROBOT = (  # what `Chassis` has
    "mass",
    "radius",
    "height",
    "wheel_mass",
    "wheel_torque",
    "caster_distance",
    "centre_height",
    "centre_ahead",
)
_NOT_NEGATIVE = ("friction", "caster_friction", "rolling_resistance", "caster_gap")
_POSITIVE = (*_OF_THE_ROBOT[:-1], "wheel_time_constant", "ticks")


class WheeledBase(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a differential drive moves in physics: its body, if the robot has another or none, and what it rolls on.

    The geometry of wheels and track is the robot's own. Each wheel touches the floor at one point, below its centre.
    Casters are spheres, one ahead of the axle and one behind it.

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

    Raises
    ------
    ValueRangeError
        If a number is outside of what is allowed.
    """

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

    def __post_init__(self) -> None:
        for field in _POSITIVE:
            if getattr(self, field) is not None:
                as_positive(f"plant.base.{field}", getattr(self, field))
        if self.centre_ahead is not None:
            as_array("plant.base.centre_ahead", self.centre_ahead, ())
        for field in _NOT_NEGATIVE:
            as_positive(f"plant.base.{field}", getattr(self, field), zero_allowed=True)

    def under(self, drive: DifferentialDrive, name: str) -> SolidBase:
        """Return this base with all its numbers, those that are missing from the drive's own chassis.

        Raises
        ------
        ValueRangeError
            If neither has them; ``name`` is that of the robot.
        """
        own = {field: getattr(self, field) for field in _OF_THE_ROBOT}
        found = {
            field: getattr(drive.chassis, field, None) if value is None else value
            for field, value in own.items()
        }
        if drive.chassis is None:
            found["centre_ahead"] = found["centre_ahead"] or 0.0
            if found["height"] is not None:
                found["centre_height"] = found["centre_height"] or CLEARANCE + 0.5 * found["height"]
        missing = [field for field, value in found.items() if value is None and field != "centre_height"]
        if missing:
            raise ValueRangeError(
                f"plant.base: the body of {name} is unknown, and physics needs it; missing: {', '.join(missing)}. "
                "Give them here, or as chassis of the differential drive in the robot's file"
            )
        numbers: dict[str, Any] = asdict(self) | found
        return SolidBase(**numbers)


@dataclass(frozen=True, kw_only=True)
class SolidBase:
    """A wheeled base of which every number is known; they are those of `WheeledBase`."""

    mass: float
    radius: float
    height: float
    centre_ahead: float
    centre_height: float
    wheel_mass: float
    friction: float
    caster_friction: float
    caster_distance: float
    caster_gap: float
    rolling_resistance: float
    wheel_torque: float
    wheel_time_constant: float
    ticks: float


def add_base(spec: Any, base: SolidBase, drive: DifferentialDrive, mount: float) -> Any:
    """Add floor, chassis, wheels and casters to an ``mjSpec``; return the chassis.

    Parameters
    ----------
    spec
        ``mjSpec``.
    base, drive
        Parameters and geometry.
    mount
        Height above the floor of what the base carries, m; a post leads there.
    """
    mujoco = import_mujoco()
    kinds = mujoco.mjtGeom
    ground = spec.worldbody.add_geom(
        name="ground", type=kinds.mjGEOM_PLANE, size=[0, 0, 1], rgba=[0, 0, 0, 0]
    )
    ground.contype, ground.conaffinity, ground.friction = (
        FLOOR | THINGS,
        0,
        [0, 0, 0],
    )  # the other's friction counts
    body = spec.worldbody.add_body(name="base")
    body.add_freejoint(name="base")
    body.mass, body.ipos, body.explicitinertial = base.mass, [base.centre_ahead, 0, base.centre_height], True
    body.inertia = _cylinder(base.mass, base.radius, base.height, 2)
    chassis = body.add_geom(
        name="chassis",
        type=kinds.mjGEOM_CYLINDER,
        size=[base.radius, base.height / 2, 0],
        pos=[0, 0, CLEARANCE + base.height / 2],
        rgba=_CHASSIS,
        mass=0,
    )
    chassis.contype, chassis.conaffinity = 0, THINGS
    if mount > CLEARANCE + base.height:
        ends = [0, 0, CLEARANCE + base.height, 0, 0, mount]
        _shown(body.add_geom(type=kinds.mjGEOM_CYLINDER, fromto=ends, size=[0.03, 0, 0], rgba=_POST, mass=0))
    ball = 0.5 * CLEARANCE
    for name, x, gap in (
        ("front", base.caster_distance, 0.0),
        ("rear", -base.caster_distance, base.caster_gap),
    ):
        _touching(
            body.add_geom(
                name=f"caster_{name}",
                type=kinds.mjGEOM_SPHERE,
                size=[ball, 0, 0],
                pos=[x, 0, ball + gap],
                rgba=_RIM,
                mass=0,
            ),
            base.caster_friction,
        )
    for name, side in zip(WHEELS, (-1, 1), strict=True):
        _add_wheel(body, name, base, drive.wheel_radius, side * drive.half_track)
    return body


def add_wheel_motors(spec: Any, base: SolidBase, drive: DifferentialDrive, mass: float) -> None:
    """Add the wheels' speed controllers; ``mass`` is all that they move, kg."""
    mujoco = import_mujoco()
    inertia = 0.5 * (mass + base.wheel_mass) * drive.wheel_radius**2  # the robot's half and the wheel's own
    gain = inertia / base.wheel_time_constant
    for name in WHEELS:
        motor = spec.add_actuator(
            name=f"wheel_{name}",
            target=f"wheel_{name}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        )
        motor.gainprm[0], motor.biasprm[2] = gain, -gain
        motor.forcerange = (-base.wheel_torque, base.wheel_torque)
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


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
        across, _, around = _cylinder(mass[i], radius, length, 2)
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
    mujoco = import_mujoco()
    wheel = body.add_body(name=f"wheel_{name}", pos=[0, side, radius])
    wheel.mass, wheel.ipos, wheel.explicitinertial = base.wheel_mass, [0, 0, 0], True
    wheel.inertia = _cylinder(base.wheel_mass, radius, 0.3 * radius, 1)
    joint = wheel.add_joint(name=f"wheel_{name}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    joint.frictionloss = base.rolling_resistance
    ball = wheel.add_geom(
        name=f"wheel_{name}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=0, group=4
    )
    _touching(ball, base.friction)
    kind, half = mujoco.mjtGeom.mjGEOM_CYLINDER, 0.12 * radius
    for size, across, colour in ((radius, half, _TYRE), (0.6 * radius, 1.08 * half, _RIM)):
        ends = [0, -across, 0, 0, across, 0]
        _shown(wheel.add_geom(type=kind, fromto=ends, size=[size, 0, 0], rgba=colour, mass=0))
    spoke = [-0.45 * radius, 0, 0, 0.45 * radius, 0, 0]
    _shown(
        wheel.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=spoke, size=[1.2 * half, 0, 0], rgba=_TYRE, mass=0
        )
    )


def _touching(geom: Any, friction: float) -> None:
    """Let a geom roll or slide on the floor."""
    geom.contype, geom.conaffinity, geom.condim, geom.friction = 0, FLOOR, 3, [friction, 0, 0]


def _shown(geom: Any) -> None:
    """Let a geom touch nothing."""
    geom.contype = geom.conaffinity = 0


def _cylinder(mass: float, radius: float, height: float, axis: int) -> list[float]:
    """Return the principal moments of a solid cylinder about its centre, kg m²."""
    moments = [mass * (3 * radius**2 + height**2) / 12] * 3
    moments[axis] = 0.5 * mass * radius**2
    return moments


def yaw_of(quaternion: Any) -> float:
    """Return the heading of a body, rad, from its orientation (4,)."""
    w, x, y, z = quaternion
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
