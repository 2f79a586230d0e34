"""Options that several commands share."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, Token, validators

from dqcontrol.files.units import number_in, unsaid_unit


def in_unit(unit: str, like: str) -> Parameter:
    """Return what makes numbers in a unit of SI of an option, which may say another, as ``30ms`` or ``35deg``.

    Parameters
    ----------
    unit
        Of a plain number.
    like
        An example with a unit.
    """

    def number(token: Token, *, several: bool) -> float:
        found = number_in(token.value, unit)
        if found is None:
            raise ValueError(f"expected a number in {unit}, or with a unit as {like}, got '{token.value}'")
        option = token.keyword or ""
        name = option.lstrip("-").replace("-", "_")
        if _is_number(token.value) and (asked := unsaid_unit(name, found, unit)):
            raise ValueError(f"{option}: {asked}" if several else asked)
        return found

    def converted(_type: Any, tokens: tuple[Token, ...]) -> float | tuple[float, ...]:
        found = tuple(number(token, several=len(tokens) > 1) for token in tokens)
        return found[0] if len(found) == 1 else found

    return Parameter(converter=converted, allow_leading_hyphen=True, metavar=f"<{unit}>")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def numbers(option: str, text: str | None, unit: str) -> list[float] | None:
    """Return the numbers of a list with commas, each in a unit of SI or with its own."""
    from dqcontrol.errors import ValueRangeError  # only now: it loads NumPy

    if text is None:
        return None
    found = [number_in(word, unit) for word in text.split(",")]
    for word, number in zip(text.split(","), found, strict=True):
        if number is None or not math.isfinite(number):
            raise ValueRangeError(f"--{option}: expected numbers in {unit} with commas, got '{word}'")
    return [number for number in found if number is not None]


SECONDS = in_unit("s", "8ms")
ANGLES = in_unit("rad", "35deg")
METRES = in_unit("m", "300mm")
SPEED = in_unit("m/s", "100mm/s")  # of the end effector
Seconds = Annotated[float, SECONDS]

BaseLink = Annotated[str | None, Parameter(help="Start of the chain in a URDF file.")]
TipLink = Annotated[str | None, Parameter(help="End of the chain in a URDF file.")]
Out = Annotated[Path | None, Parameter(name=["--out", "-o"])]
Switch = Annotated[bool, Parameter(negative=())]
Force = Switch
ReplaceResults = Annotated[bool, Parameter(negative=(), help="Replace an earlier folder of results.")]
Jobs = Annotated[
    int | None,
    Parameter(
        help="Processes that work in parallel; default: as many as there are processors, if there is enough to do."
    ),
]
LoggedRobot = Annotated[str, Parameter(help="Name, .yaml or .urdf file, or example-robot-data:PATH.")]
RosArguments = Annotated[str, Parameter(allow_leading_hyphen=True, help="After --: as after --ros-args.")]
Port = Annotated[int, Parameter(validator=validators.Number(gte=1024, lte=65535))]


@Parameter(name="*")
@dataclass(frozen=True)
class JointOptions:
    """Where the joints stand in a log, and the ends of their chain."""

    base_link: BaseLink = None
    tip_link: TipLink = None
    joints: Annotated[
        str | None,
        Parameter(
            help="Names of the robot's joints in the log, if it has others: a,b,c in the robot's order."
        ),
    ] = None
    joint_topic: Annotated[str | None, Parameter(help="Topic of JointState with the measured positions.")] = (
        None
    )
    angles: Annotated[
        Literal["rad", "deg"] | None, Parameter(help="Unit of columns of a table that do not name theirs.")
    ] = None

    def arguments(self) -> dict[str, Any]:
        """Return them as keyword arguments of functions that read logs, the joints' names apart from each other."""
        names = None if self.joints is None else [name.strip() for name in self.joints.split(",")]
        return asdict(self) | {"joints": names}


@Parameter(name="*")
@dataclass(frozen=True)
class LogOptions(JointOptions):
    """And where the commands stand."""

    command_topic: Annotated[
        str | None, Parameter(help="Topic of JointState or Float64MultiArray with the commanded velocities.")
    ] = None


DEFAULT_JOINT_OPTIONS, DEFAULT_LOG_OPTIONS = JointOptions(), LogOptions()
