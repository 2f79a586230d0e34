"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypedDict

from cyclopts import Parameter, validators

BaseLink = Annotated[str | None, Parameter(help="Start of the chain in a URDF file.")]
TipLink = Annotated[str | None, Parameter(help="End of the chain in a URDF file.")]
Out = Annotated[Path | None, Parameter(name=["--out", "-o"])]
Force = Annotated[bool, Parameter(negative=())]
Port = Annotated[int, Parameter(validator=validators.Number(gte=1024, lte=65535))]


class LogArguments(TypedDict):
    """What functions that read logs take."""

    base_link: str | None
    tip_link: str | None
    joints: list[str] | None
    joint_topic: str | None
    command_topic: str | None
    angles: Literal["rad", "deg"] | None


@Parameter(name="*")
@dataclass(frozen=True)
class LogOptions:
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
    command_topic: Annotated[
        str | None,
        Parameter(help="Topic of JointState or Float64MultiArray with the commanded velocities."),
    ] = None
    angles: Annotated[
        Literal["rad", "deg"] | None,
        Parameter(help="Unit of columns of a table that do not name theirs."),
    ] = None

    def arguments(self) -> LogArguments:
        """Return them as keyword arguments, the joints' names apart from each other."""
        return {
            "base_link": self.base_link,
            "tip_link": self.tip_link,
            "joints": [name.strip() for name in self.joints.split(",")] if self.joints is not None else None,
            "joint_topic": self.joint_topic,
            "command_topic": self.command_topic,
            "angles": self.angles,
        }


DEFAULT_LOG_OPTIONS = LogOptions()
