"""Our files of two arms: YAML with a left and a right one, and what carries them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from dqcontrol.algebra.conversions import pose
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, ValueRangeError, error_prefix
from dqcontrol.files.yaml_file import convert
from dqcontrol.robots.files.robot_file import FilePart, FixedPose, fixed_pose
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.tree_robot import Root, TreeRobot
from dqcontrol.robots.two_arms import TwoArms, TwoArmsTask
from dqcontrol.robots.whole_body import WholeBody

LoadRobot = Callable[[str | Path, str | None, str | None], Robot]


class ArmOfTwo(FilePart):
    """An arm, as `load_robot` takes it; files relative to this one.

    ``base`` is the pose of its base frame where both arms stand, ``tool`` that of its end effector at its end.
    ``mirrored`` gives the mirror image in the plane y = 0 of where it stands: a left arm of a right one.
    """

    robot: Annotated[str, Meta(min_length=1)]
    base_link: str | None = None
    tip_link: str | None = None
    base: FixedPose = msgspec.field(default_factory=FixedPose)
    tool: FixedPose = msgspec.field(default_factory=FixedPose)
    mirrored: bool = False


class TwoArmsFile(FilePart):
    """A file of two arms. ``angles`` is the unit of every angle in it; ``base`` carries both arms."""

    name: Annotated[str, Meta(min_length=1)]
    angles: Literal["degrees", "radians"]
    left: ArmOfTwo
    right: ArmOfTwo
    base: ArmOfTwo | None = None
    task: TwoArmsTask = "relative"
    root: Root = "midpoint"
    description: str = ""
    sources: list[str] = []


def two_arms_from(path: str | Path, data: Any, load: LoadRobot) -> TwoArms:
    """Make two arms of the plain data of a file.

    Parameters
    ----------
    path
        The file, for messages and for the places of other files.
    data
        What fits `TwoArmsFile`.
    load
        Loads a robot from a source and the names of its links.

    Raises
    ------
    FileFormatError
        If the data is malformed, or says something impossible: ``path: field: …``.
    """
    file = convert(path, data, TwoArmsFile)
    unit = math.pi / 180 if file.angles == "degrees" else 1.0
    try:
        parts = {}
        for field in ("left", "right", "base"):
            part = getattr(file, field)
            with error_prefix(field):
                parts[field] = part and _arm(part, Path(path).parent, unit, load)
        return TwoArms(**parts, task=file.task, root=file.root, name=file.name)
    except Error as error:
        raise FileFormatError(f"{path}: {error}") from None


def _arm(part: ArmOfTwo, folder: Path, unit: float, load: LoadRobot) -> Robot:
    near = folder / part.robot
    robot = load(near if near.is_file() else part.robot, part.base_link, part.tip_link)
    if isinstance(robot, TreeRobot):
        raise ValueRangeError(f"robot: '{part.robot}' is a tree; an arm is a chain of it: give 'tip_link'")
    base, tool = _pose("base", part.base, unit), _pose("tool", part.tool, unit)
    if isinstance(robot, WholeBody):
        if part.mirrored:
            raise ValueRangeError(f"mirrored: '{part.robot}' is a whole body; only arms have mirror images")
        stands = (
            [] if part.base == FixedPose() else [base]
        )  # a drive that comes first is one that physics knows
        return WholeBody([*stands, robot, tool], robot.name, robot.form)
    if not isinstance(robot, SerialArm):
        raise ValueRangeError(f"robot: '{part.robot}' is no arm")
    joined = SerialArm.join([base, robot, tool], robot.name)
    return joined.mirrored() if part.mirrored else joined


def _pose(field: str, given: FixedPose, unit: float) -> Array:
    at = fixed_pose(field, given, unit)
    return pose(at[:4], at[4:])
