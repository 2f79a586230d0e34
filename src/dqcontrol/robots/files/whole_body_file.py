"""Our files of whole bodies: YAML with a list of parts."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from msgspec import Meta
from msgspec.structs import asdict

from dqcontrol.algebra.conversions import pose
from dqcontrol.errors import Error, FileFormatError, error_prefix
from dqcontrol.files.yaml_file import convert
from dqcontrol.robots.bases import (
    CarLikeBase,
    Chassis,
    DifferentialDrive,
    HolonomicBase,
    MecanumBase,
    OmniBase,
    SteeredTricycle,
)
from dqcontrol.robots.files.robot_file import FilePart, FixedPose, Length, Positive, fixed_pose
from dqcontrol.robots.inverse.found_base import DriveKind
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.whole_body import Form, WholeBody

LoadArm = Callable[[str | Path, str | None, str | None], SerialArm]
LoadMobile = Callable[..., WholeBody]


class _WholeBodyPart(FilePart, tag_field="kind"):
    """Base of all parts of a whole body; ``kind`` tells them apart."""


class ChassisPart(FilePart):
    """As `Chassis`."""

    mass: Annotated[Positive, Meta(description="kg")]
    radius: Annotated[Positive, Meta(description="m")]
    height: Annotated[Positive, Meta(description="m")]
    wheel_mass: Annotated[Positive, Meta(description="kg")]
    wheel_torque: Annotated[Positive, Meta(description="N·m")]
    caster_distance: Annotated[Positive, Meta(description="m")]
    centre_ahead: Length = 0.0
    centre_height: Annotated[Positive, Meta(description="m")] | None = None


class DrivePart(_WholeBodyPart, tag="differential-drive"):
    """As `DifferentialDrive`."""

    wheel_radius: Annotated[Positive, Meta(description="m")]
    half_track: Annotated[Positive, Meta(description="m")]
    displacement: Length = 0.1
    rim_speed: Annotated[Positive, Meta(description="m/s")] | None = None
    acceleration: Annotated[Positive, Meta(description="m/s²")] | None = None
    turn_acceleration: (
        Annotated[Positive, Meta(description="per second squared, in the file's unit of angles")] | None
    ) = None
    chassis: ChassisPart | None = None


class HolonomicPart(_WholeBodyPart, tag="holonomic-base"):
    """As `HolonomicBase`."""

    speed: Annotated[Positive, Meta(description="m/s")] | None = None
    turn_rate: Annotated[Positive, Meta(description="per second, in the file's unit of angles")] | None = None
    acceleration: Annotated[Positive, Meta(description="m/s²")] | None = None
    turn_acceleration: (
        Annotated[Positive, Meta(description="per second squared, in the file's unit of angles")] | None
    ) = None
    size: Annotated[tuple[Positive, Positive, Positive], Meta(description="m")] | None = None


class _SteeredPart(_WholeBodyPart):
    """What cars and tricycles share."""

    wheel_radius: Annotated[Positive, Meta(description="m")]
    half_track: Annotated[Positive, Meta(description="m")]
    wheelbase: Annotated[Positive, Meta(description="m")]
    steering_limit: Annotated[Positive, Meta(description="in the file's unit of angles")]
    displacement: Length = 0.1
    rim_speed: Annotated[Positive, Meta(description="m/s")] | None = None
    steering_rate: (
        Annotated[Positive, Meta(description="per second, in the file's unit of angles")] | None
    ) = None
    acceleration: Annotated[Positive, Meta(description="m/s²")] | None = None
    turn_acceleration: (
        Annotated[Positive, Meta(description="per second squared, in the file's unit of angles")] | None
    ) = None


class CarPart(_SteeredPart, tag="car-like"):
    """As `CarLikeBase`."""


class TricyclePart(_SteeredPart, tag="steered-tricycle"):
    """As `SteeredTricycle`."""


class _RollerPart(_WholeBodyPart):
    """What mecanum and omni bases share."""

    wheel_radius: Annotated[Positive, Meta(description="m")]
    rim_speed: Annotated[Positive, Meta(description="m/s")] | None = None
    speed: Annotated[Positive, Meta(description="m/s")] | None = None
    turn_rate: Annotated[Positive, Meta(description="per second, in the file's unit of angles")] | None = None
    acceleration: Annotated[Positive, Meta(description="m/s²")] | None = None
    turn_acceleration: (
        Annotated[Positive, Meta(description="per second squared, in the file's unit of angles")] | None
    ) = None
    size: Annotated[tuple[Positive, Positive, Positive], Meta(description="m")] | None = None


class MecanumPart(_RollerPart, tag="mecanum-base", kw_only=True):
    """As `MecanumBase`."""

    half_track: Annotated[Positive, Meta(description="m")]
    half_wheelbase: Annotated[Positive, Meta(description="m")]


class OmniPart(_RollerPart, tag="omni-base", kw_only=True):
    """As `OmniBase`."""

    wheel_distance: Annotated[Positive, Meta(description="m")]
    wheel_count: Annotated[int, Meta(ge=3, le=12)] = 3
    first_angle: Annotated[float, Meta(description="in the file's unit of angles")] | None = None


class ArmPart(_WholeBodyPart, tag="arm"):
    """An arm, as `load_robot` takes it; files relative to this one. With ``reversed`` it is held by its tool."""

    robot: Annotated[str, Meta(min_length=1)]
    base_link: str | None = None
    tip_link: str | None = None
    reversed: bool = False


class MobileRobotPart(_WholeBodyPart, tag="mobile-robot"):
    """A base and its arm as `load_robot` finds them in a URDF or MJCF file; files relative to this one."""

    robot: Annotated[str, Meta(min_length=1)]
    tip_link: str | None = None
    drive: DriveKind | None = None
    wheel_radius: Annotated[Positive, Meta(description="m")] | None = None
    track: Annotated[Positive, Meta(description="m")] | None = None
    steering_limit: Annotated[Positive, Meta(description="in the file's unit of angles")] | None = None


class PosePart(FixedPose, tag_field="kind", tag="pose"):
    """A fixed pose between parts."""


AnyPart: TypeAlias = (
    DrivePart
    | CarPart
    | TricyclePart
    | HolonomicPart
    | MecanumPart
    | OmniPart
    | ArmPart
    | MobileRobotPart
    | PosePart
)


class WholeBodyFile(FilePart):
    """A file of a whole body. ``angles`` is the unit of every angle in it; ``parts`` are in order from the ground."""

    name: Annotated[str, Meta(min_length=1)]
    angles: Literal["degrees", "radians"]
    parts: Annotated[list[AnyPart], Meta(min_length=1, max_length=100)]
    form: Form = "constrained"
    description: str = ""
    sources: list[str] = []


def whole_body_from(path: str | Path, data: Any, load_arm: LoadArm, load_mobile: LoadMobile) -> WholeBody:
    """Make a whole body of the plain data of a file.

    Parameters
    ----------
    path
        The file, for messages and for the places of other files.
    data
        What fits `WholeBodyFile`.
    load_arm
        Loads an arm from a source and the names of its links.
    load_mobile
        Loads a base with its arm, see `dqcontrol.load_robot`.

    Raises
    ------
    FileFormatError
        If the data is malformed, or says something impossible: ``path: field: …``.
    """
    file = convert(path, data, WholeBodyFile)
    unit = math.pi / 180 if file.angles == "degrees" else 1.0
    try:
        parts = []
        for i, part in enumerate(file.parts):
            with error_prefix(f"parts[{i}]"):
                if isinstance(part, MobileRobotPart):
                    parts.append(_mobile(part, Path(path).parent, unit, load_mobile))
                else:
                    parts.append(_part(f"parts[{i}]", part, Path(path).parent, unit, load_arm))
        return WholeBody(parts, file.name, file.form)
    except Error as error:
        raise FileFormatError(f"{path}: {error}") from None


def _part(field: str, part: Any, folder: Path, unit: float, load_arm: LoadArm) -> Any:
    if isinstance(part, DrivePart):
        return DifferentialDrive(
            part.wheel_radius,
            part.half_track,
            part.displacement,
            part.rim_speed or math.inf,
            part.acceleration or math.inf,
            (part.turn_acceleration or math.inf) * unit,
            _chassis(part.chassis),
        )
    if isinstance(part, _SteeredPart):
        made = CarLikeBase if isinstance(part, CarPart) else SteeredTricycle
        return made(
            part.wheel_radius,
            part.half_track,
            part.wheelbase,
            part.steering_limit * unit,
            part.displacement,
            part.rim_speed or math.inf,
            (part.steering_rate or math.inf) * unit,
            part.acceleration or math.inf,
            (part.turn_acceleration or math.inf) * unit,
        )
    if isinstance(part, HolonomicPart | _RollerPart):
        return _holonomic(part, unit)
    if isinstance(part, PosePart):
        at = fixed_pose(field, part, unit)
        return pose(at[:4], at[4:])
    near = folder / part.robot
    arm = load_arm(near if near.is_file() else part.robot, part.base_link, part.tip_link)
    return arm.reversed() if part.reversed else arm


def _mobile(part: MobileRobotPart, folder: Path, unit: float, load_mobile: LoadMobile) -> WholeBody:
    near = folder / part.robot
    limit = None if part.steering_limit is None else part.steering_limit * unit
    return load_mobile(
        near if near.is_file() else part.robot,
        tip_link=part.tip_link,
        drive=part.drive or "found",
        wheel_radius=part.wheel_radius,
        track=part.track,
        steering_limit=limit,
    )


def _holonomic(part: HolonomicPart | _RollerPart, unit: float) -> HolonomicBase:
    given: dict[str, Any] = {
        "speed": part.speed or math.inf,
        "turn_rate": (part.turn_rate or math.inf) * unit,
        "acceleration": part.acceleration or math.inf,
        "turn_acceleration": (part.turn_acceleration or math.inf) * unit,
        "size": part.size,
    }
    if isinstance(part, HolonomicPart):
        return HolonomicBase(**given)
    wheels: dict[str, Any] = given | {
        "wheel_radius": part.wheel_radius,
        "rim_speed": part.rim_speed or math.inf,
    }
    if isinstance(part, MecanumPart):
        return MecanumBase(half_track=part.half_track, half_wheelbase=part.half_wheelbase, **wheels)
    assert isinstance(part, OmniPart)
    first = None if part.first_angle is None else part.first_angle * unit
    return OmniBase(
        wheel_distance=part.wheel_distance, wheel_count=part.wheel_count, first_angle=first, **wheels
    )


def _chassis(part: ChassisPart | None) -> Chassis | None:
    if part is None:
        return None
    numbers = asdict(part)
    return Chassis(**(numbers | {"centre_height": part.centre_height or 0.0}))
