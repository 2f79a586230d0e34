"""Our files of whole bodies: YAML with a list of parts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeAlias

from msgspec import Meta
from msgspec.structs import asdict

from dqcontrol.errors import Error, FileFormatError, error_prefix
from dqcontrol.files.yaml_file import convert
from dqcontrol.robots import bases
from dqcontrol.robots.files.robot_file import FilePart, FixedPose, Length, NamedFile, Positive, fixed_pose
from dqcontrol.robots.poses import pose8
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.whole_body import Form, WholeBody

LoadArm = Callable[[str | Path, str | None, str | None], SerialArm]
LoadMobile = Callable[..., WholeBody]

_Metres = Annotated[Positive, Meta(description="m")]
_Speed = Annotated[Positive, Meta(description="m/s")]
_Acceleration = Annotated[Positive, Meta(description="m/s²")]
_Angle = Annotated[Positive, Meta(description="in the file's unit of angles")]
_TurnRate = Annotated[Positive, Meta(description="per second, in the file's unit of angles")]
_TurnAcceleration = Annotated[Positive, Meta(description="per second squared, in the file's unit of angles")]
_SCALED = ("turn_rate", "turn_acceleration", "steering_rate", "steering_limit", "first_angle")  # in that unit


class _WholeBodyPart(FilePart, tag_field="kind"):
    """Base of all parts of a whole body; ``kind`` tells them apart."""


class ChassisPart(FilePart):
    """As `Chassis`."""

    mass: Annotated[Positive, Meta(description="kg")]
    radius: _Metres
    height: _Metres
    wheel_mass: Annotated[Positive, Meta(description="kg")]
    wheel_torque: Annotated[Positive, Meta(description="N·m")]
    caster_distance: _Metres
    centre_ahead: Length = 0.0
    centre_height: _Metres | None = None


class DrivePart(_WholeBodyPart, tag="differential-drive"):
    """As `DifferentialDrive`."""

    wheel_radius: _Metres
    half_track: _Metres
    displacement: Length = 0.1
    rim_speed: _Speed | None = None
    acceleration: _Acceleration | None = None
    turn_acceleration: _TurnAcceleration | None = None
    chassis: ChassisPart | None = None


class HolonomicPart(_WholeBodyPart, tag="holonomic-base"):
    """As `HolonomicBase`."""

    speed: _Speed | None = None
    turn_rate: _TurnRate | None = None
    acceleration: _Acceleration | None = None
    turn_acceleration: _TurnAcceleration | None = None
    size: Annotated[tuple[Positive, Positive, Positive], Meta(description="m")] | None = None


class _SteeredPart(_WholeBodyPart):
    """What cars and tricycles share."""

    wheel_radius: _Metres
    half_track: _Metres
    wheelbase: _Metres
    steering_limit: _Angle
    displacement: Length = 0.1
    rim_speed: _Speed | None = None
    steering_rate: _TurnRate | None = None
    acceleration: _Acceleration | None = None
    turn_acceleration: _TurnAcceleration | None = None


class CarPart(_SteeredPart, tag="car-like"):
    """As `CarLikeBase`."""


class TricyclePart(_SteeredPart, tag="steered-tricycle"):
    """As `SteeredTricycle`."""


class _RollerPart(_WholeBodyPart):
    """What mecanum and omni bases share."""

    wheel_radius: _Metres
    rim_speed: _Speed | None = None
    speed: _Speed | None = None
    turn_rate: _TurnRate | None = None
    acceleration: _Acceleration | None = None
    turn_acceleration: _TurnAcceleration | None = None
    size: Annotated[tuple[Positive, Positive, Positive], Meta(description="m")] | None = None


class MecanumPart(_RollerPart, tag="mecanum-base", kw_only=True):
    """As `MecanumBase`."""

    half_track: _Metres
    half_wheelbase: _Metres


class OmniPart(_RollerPart, tag="omni-base", kw_only=True):
    """As `OmniBase`."""

    wheel_distance: _Metres
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
    drive: bases.DriveKind | None = None
    wheel_radius: _Metres | None = None
    track: _Metres | None = None
    steering_limit: _Angle | None = None


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


class WholeBodyFile(NamedFile):
    """A file of a whole body. ``angles`` is the unit of every angle in it; ``parts`` are in order from the ground."""

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
    folder = Path(path).parent
    try:
        parts = []
        for i, part in enumerate(file.parts):
            with error_prefix(f"parts[{i}]"):
                if isinstance(part, MobileRobotPart):
                    parts.append(_mobile(part, folder, file.unit, load_mobile))
                else:
                    parts.append(_part(f"parts[{i}]", part, folder, file.unit, load_arm))
        return WholeBody(parts, file.name, file.form)
    except Error as error:
        raise FileFormatError(f"{path}: {error}") from None


_BASES: dict[type, Callable[..., Any]] = {
    DrivePart: bases.DifferentialDrive,
    CarPart: bases.CarLikeBase,
    TricyclePart: bases.SteeredTricycle,
    HolonomicPart: bases.HolonomicBase,
    MecanumPart: bases.MecanumBase,
    OmniPart: bases.OmniBase,
}


def _part(field: str, part: Any, folder: Path, unit: float, load_arm: LoadArm) -> Any:
    if type(part) in _BASES:
        given = _given(part)
        given |= {name: unit * given[name] for name in _SCALED if name in given}
        if "chassis" in given:
            given["chassis"] = bases.Chassis(**_given(given["chassis"]))
        return _BASES[type(part)](**given)
    if isinstance(part, PosePart):
        return pose8(fixed_pose(field, part, unit))
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


def _given(part: Any) -> dict[str, Any]:
    """Return what a part of a file says; what it leaves out is as the base has it."""
    return {name: value for name, value in asdict(part).items() if value is not None}
