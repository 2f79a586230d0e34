"""Our files of trees: YAML with joints that say what carries them, and named frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.errors import Error, FileFormatError, ValueRangeError, error_prefix, unknown_name
from dqcontrol.files.yaml_file import convert
from dqcontrol.robots.files import robot_file
from dqcontrol.robots.files.link_tree import LinkBody, LinkJoint, LinkTree, Mimic
from dqcontrol.robots.poses import pose8, shift
from dqcontrol.robots.robot import Robot
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.tree_robot import Root, TreeRobot
from dqcontrol.robots.two_arms import TwoArms, TwoArmsTask
from dqcontrol.robots.whole_body import WholeBody

LoadRobot = Callable[[str | Path, str | None, str | None], Robot]


class ArmOfTwo(robot_file.FilePart):
    """An arm, as `load_robot` takes it; files relative to this one.

    ``base`` is the pose of its base frame where both arms stand, ``tool`` that of its end effector at its end.
    ``mirrored`` gives the mirror image in the plane y = 0 of where it stands: a left arm of a right one.
    """

    robot: Annotated[str, Meta(min_length=1)]
    base_link: str | None = None
    tip_link: str | None = None
    base: robot_file.FixedPose = msgspec.field(default_factory=robot_file.FixedPose)
    tool: robot_file.FixedPose = msgspec.field(default_factory=robot_file.FixedPose)
    mirrored: bool = False


class TwoArmsFile(robot_file.NamedFile):
    """A file of two arms. ``angles`` is the unit of every angle in it; ``base`` carries both arms."""

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
    try:
        parts = {}
        for field in ("left", "right", "base"):
            part = getattr(file, field)
            with error_prefix(field):
                parts[field] = part and _arm(part, Path(path).parent, file.unit, load)
        return TwoArms(**parts, task=file.task, root=file.root, name=file.name)
    except Error as error:
        raise FileFormatError(f"{path}: {error}") from None


def _arm(part: ArmOfTwo, folder: Path, unit: float, load: LoadRobot) -> Robot:
    near = folder / part.robot
    robot = load(near if near.is_file() else part.robot, part.base_link, part.tip_link)
    if isinstance(robot, TreeRobot):
        raise ValueRangeError(f"robot: '{part.robot}' is a tree; an arm is a chain of it: give 'tip_link'")
    base, tool = (pose8(robot_file.fixed_pose(key, getattr(part, key), unit)) for key in ("base", "tool"))
    if isinstance(robot, WholeBody):
        if part.mirrored:
            raise ValueRangeError(f"mirrored: '{part.robot}' is a whole body; only arms have mirror images")
        # a drive that comes first is one that physics knows
        stands = [] if part.base == robot_file.FixedPose() else [base]
        return WholeBody([*stands, robot, tool], robot.name, robot.form)
    if not isinstance(robot, SerialArm):
        raise ValueRangeError(f"robot: '{part.robot}' is no arm")
    joined = SerialArm.join([base, robot, tool], robot.name)
    return joined.mirrored() if part.mirrored else joined


_BASE = "base"


class MimicPart(robot_file.FilePart):
    """What a joint follows: multiplier · q + offset."""

    joint: Annotated[str, Meta(min_length=1)]
    multiplier: float = 1.0
    offset: robot_file.Position = 0.0


class TreeJoint(robot_file.FilePart):
    """One joint: the pose of its frame in that of the joint that carries it (the base if omitted); about or along z."""

    name: Annotated[str, Meta(min_length=1)]
    type: Literal["revolute", "prismatic"] = "revolute"
    carrier: str | None = None
    pose: robot_file.FixedPose = msgspec.field(default_factory=robot_file.FixedPose)
    limits: robot_file.JointLimits = msgspec.field(default_factory=robot_file.JointLimits)
    mimic: MimicPart | None = None
    offset: robot_file.Position = 0.0
    inertia: robot_file.JointInertia | None = None


class TreeFrame(robot_file.FilePart):
    """A named frame: its pose in the frame of a joint after its motion (of the base if omitted)."""

    name: Annotated[str, Meta(min_length=1)]
    joint: str | None = None
    pose: robot_file.FixedPose = msgspec.field(default_factory=robot_file.FixedPose)


class TreeFile(robot_file.NamedFile):
    """A file of a tree. ``angles`` is the unit of every angle in it; joints come after what carries them."""

    joints: Annotated[list[TreeJoint], Meta(min_length=1, max_length=1000)]
    frames: Annotated[list[TreeFrame], Meta(min_length=1, max_length=10_000)]
    task: str | None = None
    description: str = ""
    sources: list[str] = []


def tree_from(path: str | Path, data: Any) -> TreeRobot:
    """Make a tree of the plain data of a file; the task is the frame that it names, or the first.

    Raises
    ------
    FileFormatError
        If the data is malformed, or says something impossible: ``path: field: …``.
    """
    file = convert(path, data, TreeFile)
    try:
        return _links(path, file).tree().with_task(file.task or file.frames[0].name)
    except Error as error:
        text = str(error)
        raise FileFormatError(text if text.startswith(f"{path}:") else f"{path}: {text}") from None


def plain_tree(robot: TreeRobot) -> dict[str, Any]:
    """Return the content of a file for a tree, from which `tree_from` makes it again."""
    table, names, joints = robot.joints, robot.joints.names, []
    for i, name in enumerate(names):
        at = int(table.coordinate[i])
        leader, multiplier, offset = robot.joint_names[at], float(table.multiplier[i]), float(table.offset[i])
        joint: dict[str, Any] = {"name": name, "type": "prismatic" if table.kind[i] else "revolute"}
        if table.parent[i] >= 0:
            joint["carrier"] = names[int(table.parent[i])]
        joint["pose"] = robot_file.plain_pose(table.fixed[i])
        if leader == name:
            joint["limits"] = robot_file.plain_limits(robot.limits, at)
            if offset:
                joint["offset"] = offset
        else:
            joint["mimic"] = {"joint": leader, "multiplier": multiplier, "offset": offset}
        if robot.inertia is not None and robot.inertia.mass[i] > 0:
            joint["inertia"] = robot_file.plain_inertia(robot.inertia, i)
        joints.append(joint)
    frames = []
    for name, frame in robot.named_frames.items():
        if name == _BASE and frame.joint < 0:
            continue
        carried = {"joint": names[frame.joint]} if frame.joint >= 0 else {}
        frames.append({"name": name, **carried, "pose": robot_file.plain_pose(frame.pose)})
    return {
        "name": robot.name,
        "angles": "radians",
        "joints": joints,
        "frames": frames,
        "task": robot.task.frames[0],
    }


def _links(path: str | Path, file: TreeFile) -> LinkTree:
    """Return a file as links and joints: each joint carries a link of its name, each frame is one."""
    links: list[LinkJoint] = []
    bodies, known, unit = {}, [_BASE], file.unit
    for i, joint in enumerate(file.joints):
        where = f"joints[{i}]"
        if joint.name in known:
            raise FileFormatError(f"{where}.name: '{joint.name}' is already the name of another joint")
        carrier = joint.carrier or _BASE
        if carrier not in known:
            raise unknown_name(f"{where}.carrier", carrier, known)
        scale = unit if joint.type == "revolute" else 1.0
        mimic = joint.mimic
        links.append(
            LinkJoint(
                joint.name,
                joint.type,
                f"{carrier} link",
                f"{joint.name} link",
                robot_file.fixed_pose(f"{where}.pose", joint.pose, unit),
                shift(),
                *joint.limits.bounds(scale),
                mimic and Mimic(mimic.joint, mimic.multiplier, mimic.offset * scale),
                joint.offset * scale,
            )
        )
        if joint.inertia is not None:
            body = joint.inertia
            bodies[f"{joint.name} link"] = LinkBody(
                body.mass, np.array(body.center, np.float64), body.tensor.matrix
            )
        known.append(joint.name)
    for i, frame in enumerate(file.frames):
        with error_prefix(f"frames[{i}]"):
            if (carrier := frame.joint or _BASE) not in known:
                raise unknown_name("joint", carrier, known)
            place = robot_file.fixed_pose("pose", frame.pose, unit)
        links.append(LinkJoint(f"{frame.name} fixed", "fixed", f"{carrier} link", frame.name, place))

    def error(name: str, text: str) -> Error:
        return FileFormatError(f"{path}: joint '{name}': {text}")

    return LinkTree(file.name, str(path), f"{_BASE} link", tuple(links), bodies, error)
