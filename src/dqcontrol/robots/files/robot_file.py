"""Our robot files: YAML with Denavit–Hartenberg or DENSO rows, or with fixed poses and axes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from dqcontrol.algebra import as_unit_quaternion
from dqcontrol.algebra.conversions import pose
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, error_prefix, unknown_name
from dqcontrol.files.input_file import read_text
from dqcontrol.files.yaml_file import convert, parse_yaml
from dqcontrol.geometry import Box, Capsule, Sphere
from dqcontrol.robots import poses
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.link_shapes import LinkShape, LinkShapes
from dqcontrol.robots.serial_arm import SerialArm, chain_from_denso, chain_from_dh

Length = Annotated[float, Meta(ge=-1e3, le=1e3, description="m")]
Angle = Annotated[float, Meta(ge=-1e4, le=1e4, description="in the file's unit of angles")]
Position = Annotated[float, Meta(description="in the file's unit of angles, or m if prismatic")]
Positive = Annotated[float, Meta(gt=0)]
Mass = Annotated[float, Meta(ge=0, description="kg")]
Moment = Annotated[float, Meta(description="kg m²")]
Vector = tuple[Length, Length, Length]

_ROWS = {"dh": "DH", "denso": "DENSO"}  # keys of table rows


class FilePart(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of a robot file."""


class NamedFile(FilePart):
    """What all robots' files begin with; ``angles`` is the unit of every angle in one."""

    name: Annotated[str, Meta(min_length=1)]
    angles: Literal["degrees", "radians"]

    @property
    def unit(self) -> float:
        """Its unit of angles, rad."""
        return math.pi / 180 if self.angles == "degrees" else 1.0


class DHRow(FilePart):
    """One row of a Denavit–Hartenberg table; the joint variable adds to theta, or to d if prismatic."""

    theta: Angle = 0.0
    d: Length = 0.0
    a: Length = 0.0
    alpha: Angle = 0.0


class DensoRow(FilePart):
    """One row of a table in DENSO's convention; the joint variable adds to gamma, or to d if prismatic."""

    a: Length = 0.0
    b: Length = 0.0
    d: Length = 0.0
    alpha: Angle = 0.0
    beta: Angle = 0.0
    gamma: Angle = 0.0


class FixedPose(FilePart):
    """A fixed pose: position, and roll-pitch-yaw angles, Rz(y) Ry(p) Rx(r), or a quaternion, scalar first."""

    position: Vector = (0.0, 0.0, 0.0)
    rpy: tuple[Angle, Angle, Angle] | None = None
    quaternion: tuple[float, float, float, float] | None = None


class JointLimits(FilePart):
    """Limits of one joint; what is left out is unlimited."""

    lower: Position | None = None
    upper: Position | None = None
    velocity: (
        Annotated[Positive, Meta(description="per second, in the file's unit of angles, or m/s")] | None
    ) = None
    effort: Annotated[Positive, Meta(description="N·m, or N if prismatic")] | None = None

    def bounds(self, unit: float) -> tuple[float, float, float, float]:
        """Return lower and upper limit, velocity and effort of a joint whose positions are in a unit, rad or m."""
        return (
            -math.inf if self.lower is None else self.lower * unit,
            math.inf if self.upper is None else self.upper * unit,
            math.inf if self.velocity is None else self.velocity * unit,
            math.inf if self.effort is None else self.effort,
        )


class Tensor(FilePart):
    """Inertia about the centre of mass, axes of the joint's frame."""

    xx: Moment
    yy: Moment
    zz: Moment
    xy: Moment = 0.0
    xz: Moment = 0.0
    yz: Moment = 0.0

    @property
    def matrix(self) -> Array:
        """The same as a matrix, shape (3, 3)."""
        return np.array(
            [[self.xx, self.xy, self.xz], [self.xy, self.yy, self.yz], [self.xz, self.yz, self.zz]]
        )


class JointInertia(FilePart):
    """The body that a joint moves, in the joint's frame after its motion (the frame of `pose`)."""

    mass: Mass
    center: Vector
    tensor: Tensor


class Joint(FilePart):
    """One joint: a DH or DENSO row, or the pose of its frame in that of the joint before and an axis (default z)."""

    name: Annotated[str, Meta(min_length=1)]
    type: Literal["revolute", "prismatic"] = "revolute"
    dh: DHRow | None = None
    denso: DensoRow | None = None
    pose: FixedPose | None = None
    axis: Vector | None = None
    limits: JointLimits = msgspec.field(default_factory=JointLimits)
    inertia: JointInertia | None = None


class SphereShape(FilePart):
    """A ball, in the frame of a joint as `Robot.frames` has it."""

    center: Vector
    radius: Annotated[Positive, Meta(description="m")]


class CapsuleShape(FilePart):
    """All points within a radius of a segment."""

    start: Vector
    end: Vector
    radius: Annotated[Positive, Meta(description="m")]


class BoxShape(FilePart):
    """A box about its pose."""

    size: tuple[Positive, Positive, Positive]
    position: Vector = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


class CollisionShape(FilePart):
    """A shape that the joint of this name moves, in its frame after its motion; without a joint it stands still."""

    name: Annotated[str, Meta(min_length=1)]
    joint: str | None = None
    sphere: SphereShape | None = None
    capsule: CapsuleShape | None = None
    box: BoxShape | None = None


class RobotFile(NamedFile):
    """A robot file.

    ``angles`` is the unit of every angle in it, also of limits and per second of velocity limits.
    ``convention`` says which form the rows have, Denavit–Hartenberg (key ``dh``) or DENSO's (key ``denso``);
    left out with fixed poses. ``base`` is the pose of the first frame in the inertial one, ``tool`` that of the
    tool in the last frame. ``shapes`` are those of the links, for constraints; the pairs that ``kept_apart`` names are
    kept apart.
    """

    joints: Annotated[list[Joint], Meta(min_length=1, max_length=1000)]
    convention: Literal["standard", "modified", "denso"] | None = None
    base: FixedPose = msgspec.field(default_factory=FixedPose)
    tool: FixedPose = msgspec.field(default_factory=FixedPose)
    description: str = ""
    sources: list[str] = []
    shapes: list[CollisionShape] = []
    kept_apart: list[tuple[str, str]] = []


class ToolFile(FilePart):
    """A file of an arm that is another one with a tool: what it says beside, in that one's unit of angles.

    ``tool`` is the pose of the tool in the last frame, in place of the arm's; ``shapes`` and ``kept_apart`` are more.
    """

    name: Annotated[str, Meta(min_length=1)]
    robot: Annotated[str, Meta(min_length=1)]
    tool: FixedPose
    description: str = ""
    sources: list[str] = []
    shapes: list[CollisionShape] = []
    kept_apart: list[tuple[str, str]] = []


def with_tool(path: str | Path, plain: dict[str, Any], arm: dict[str, Any]) -> dict[str, Any]:
    """Return the plain data of an arm's file with those of a `ToolFile` on it."""
    convert(path, plain, ToolFile)
    joined = {key: [*arm.get(key, []), *plain.get(key, [])] for key in ("sources", "shapes", "kept_apart")}
    said = {key: plain[key] for key in ("name", "description", "tool") if key in plain}
    return {**arm, **said, **{key: value for key, value in joined.items() if value}}


def load_robot_file(path: str | Path) -> SerialArm:
    """Load an arm from our YAML format.

    Parameters
    ----------
    path
        A file that fits `RobotFile`.

    Raises
    ------
    FileFormatError
        If the file is missing, malformed, or says something impossible: ``path: field: …``.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "slider.yaml"
    >>> _ = path.write_text('''
    ... name: slider
    ... angles: degrees
    ... joints:
    ...   - {name: x, type: prismatic, pose: {}, axis: [1, 0, 0], limits: {lower: 0, upper: 0.5}}
    ... ''')
    >>> load_robot_file(path).limits.upper.tolist()
    [0.5]
    """
    return arm_from(path, parse_yaml(path, read_text(path)))


def plain_arm(arm: SerialArm) -> dict[str, Any]:
    """Return the content of a robot file for an arm, from which `arm_from` makes it again."""
    joints = [
        {
            "name": name,
            "type": arm.joint_types[i],
            "pose": plain_pose(arm.chain[i]),
            "limits": plain_limits(arm.limits, i),
            **({"inertia": plain_inertia(arm.inertia, i)} if arm.inertia is not None else {}),
        }
        for i, name in enumerate(arm.joint_names)
    ]
    plain = {"name": arm.name, "angles": "radians", "joints": joints, "tool": plain_pose(arm.chain[-1])}
    return plain | (plain_shapes(arm) if arm.shapes else {})


def plain_shapes(arm: SerialArm) -> dict[str, Any]:
    """Return the keys of a robot file that say an arm's shapes."""
    given = arm.shapes or LinkShapes(())
    shapes: list[dict[str, Any]] = []
    for each in given.shapes:
        plain: dict[str, Any] = {"name": each.name}
        if each.frame:
            plain["joint"] = arm.joint_names[each.frame - 1]
        shape = each.shape
        if isinstance(shape, Sphere):
            plain["sphere"] = {"center": shape.center.tolist(), "radius": shape.radius}
        elif isinstance(shape, Capsule):
            ends = {"start": shape.start.tolist(), "end": shape.end.tolist()}
            plain["capsule"] = ends | {"radius": shape.radius}
        else:
            rotation, position = poses.pose7("pose", shape.pose)[:4], shape.row[4:7]
            places = {"position": position.tolist(), "quaternion": rotation.tolist()}
            plain["box"] = {"size": shape.size.tolist()} | places
        shapes.append(plain)
    pairs = [[given.names[a], given.names[b]] for a, b in given.pairs]
    return {"shapes": shapes, "kept_apart": pairs}


def plain_pose(row: Array) -> dict[str, Any]:
    """Return a pose (7,) or a row of a chain as a file has it."""
    return {"position": row[4:7].tolist(), "quaternion": row[:4].tolist()}


def plain_limits(limits: Limits, i: int) -> dict[str, Any]:
    """Return the limits of a joint as a file has them, in radians."""
    bounds = {key: float(getattr(limits, key)[i]) for key in ("lower", "upper", "velocity", "effort")}
    return {key: value for key, value in bounds.items() if math.isfinite(value)}


def plain_inertia(bodies: Inertia, i: int) -> dict[str, Any]:
    """Return the body of a joint as a file has it."""
    t = bodies.tensor[i]
    moments = {"xx": t[0, 0], "yy": t[1, 1], "zz": t[2, 2], "xy": t[0, 1], "xz": t[0, 2], "yz": t[1, 2]}
    return {
        "mass": float(bodies.mass[i]),
        "center": bodies.center[i].tolist(),
        "tensor": {key: float(value) for key, value in moments.items()},
    }


def arm_from(path: str | Path, plain: Any) -> SerialArm:
    """Make an arm of the plain data of a file; ``path`` is for the messages."""
    data = convert(path, plain, RobotFile)
    unit = data.unit
    try:
        fixed, turns = _chain(data, unit)
        arm = SerialArm(
            np.array(fixed),
            [joint.type for joint in data.joints],
            limits=_limits(data, unit),
            joint_names=_names(data),
            name=data.name,
            inertia=_inertia(data, turns),
        )
        arm.shapes = _shapes(data)
        return arm
    except Error as error:
        raise FileFormatError(f"{path}: {error}") from None


def _chain(data: RobotFile, unit: float) -> tuple[list[Array], list[Array] | None]:
    """Return the fixed poses, and for joints with an axis the turns of their frames."""
    base, tool = fixed_pose("base", data.base, unit), fixed_pose("tool", data.tool, unit)
    if data.convention is None:
        placed = _joint_poses(data, unit)
        placed[0] = poses.compose(base, placed[0])
        return poses.chain_from_axes(placed, [joint.axis or (0.0, 0.0, 1.0) for joint in data.joints], tool)
    types = [joint.type for joint in data.joints]
    if data.convention == "denso":
        rows = [(r.a, r.b, r.d, r.alpha * unit, r.beta * unit, r.gamma * unit) for r in _rows(data, "denso")]
        a, b, d, alpha, beta, gamma = np.array(rows).T
        fixed, _ = chain_from_denso(a, b, d, alpha, beta, gamma, types)
    else:
        rows = [(r.theta * unit, r.d, r.a, r.alpha * unit) for r in _rows(data, "dh")]
        theta, d, a, alpha = np.array(rows).T
        fixed, _ = chain_from_dh(theta, d, a, alpha, types, data.convention)
    fixed[0], fixed[-1] = poses.compose(base, fixed[0]), poses.compose(fixed[-1], tool)
    return fixed, None


def _joint_poses(data: RobotFile, unit: float) -> list[Array]:
    """Return the fixed pose (7,) of each joint, of a file without convention."""
    for i, joint in enumerate(data.joints):
        for key, allowed in (("dh", "standard, modified"), ("denso", "denso")):
            if getattr(joint, key) is not None:
                raise FileFormatError(
                    f"convention: missing key, the joints have {_ROWS[key]} rows (allowed: {allowed})"
                )
        if joint.pose is None:
            raise FileFormatError(f"joints[{i}]: missing key 'pose' (or 'dh', with a 'convention')")
    return [fixed_pose(f"joints[{i}].pose", joint.pose, unit) for i, joint in enumerate(data.joints)]


def _rows(data: RobotFile, key: str) -> list[Any]:
    """Return the table rows of the joints, of a file with a convention."""
    for i, joint in enumerate(data.joints):
        if getattr(joint, key) is None:
            form = "denso" if key == "denso" else f"{data.convention} DH"
            raise FileFormatError(f"joints[{i}]: missing key '{key}', the file's convention is {form}")
        for field in {"dh", "denso", "pose", "axis"} - {key}:
            if getattr(joint, field) is not None:
                raise FileFormatError(
                    f"joints[{i}].{field}: not allowed beside '{key}'; leave out one of them"
                )
    return [getattr(joint, key) for joint in data.joints]


def fixed_pose(field: str, pose: FixedPose | None, unit: float) -> Array:
    """Return a pose (7,) of a file; ``field`` is for the messages, ``unit`` that of its angles."""
    if pose is None:
        return poses.shift()
    if pose.rpy is not None and pose.quaternion is not None:
        raise FileFormatError(f"{field}: has both 'rpy' and 'quaternion'; leave out one of them")
    at = poses.shift(*pose.position)
    if pose.quaternion is not None:
        try:
            turn = as_unit_quaternion(f"{field}.quaternion", pose.quaternion)
        except Error as error:
            raise FileFormatError(str(error)) from None
        return poses.compose(at, np.array([*turn, 0, 0, 0]))
    roll, pitch, yaw = (angle * unit for angle in pose.rpy or (0.0, 0.0, 0.0))
    return poses.compose(at, poses.rotation_z(yaw), poses.rotation_y(pitch), poses.rotation_x(roll))


def _names(data: RobotFile) -> list[str]:
    names = [joint.name for joint in data.joints]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise FileFormatError(
                f"joints[{i}].name: '{name}' is already the name of joints[{names.index(name)}]"
            )
    return names


def _shapes(data: RobotFile) -> LinkShapes | None:
    """Return the shapes of the links; None without any."""
    if not data.shapes:
        if data.kept_apart:
            raise FileFormatError("kept_apart: there are no shapes to keep apart")
        return None
    names, shapes = [joint.name for joint in data.joints], []
    for i, each in enumerate(data.shapes):
        given = [shape for shape in (each.sphere, each.capsule, each.box) if shape is not None]
        if len(given) != 1:
            raise FileFormatError(f"shapes[{i}]: give one of sphere, capsule, box")
        if each.joint is not None and each.joint not in names:
            raise unknown_name(f"shapes[{i}].joint", each.joint, names)
        shape = given[0]
        with error_prefix(f"shapes[{i}]"):
            found: Sphere | Capsule | Box
            if isinstance(shape, SphereShape):
                found = Sphere(np.array(shape.center), shape.radius)
            elif isinstance(shape, CapsuleShape):
                found = Capsule(np.array(shape.start), np.array(shape.end), shape.radius)
            else:
                rotation = as_unit_quaternion("quaternion", shape.quaternion)
                found = Box(pose(rotation, shape.position), np.array(shape.size))
        shapes.append(LinkShape(each.name, 0 if each.joint is None else names.index(each.joint) + 1, found))
    known = LinkShapes(tuple(shapes))
    pairs = tuple((known.index("kept_apart", a), known.index("kept_apart", b)) for a, b in data.kept_apart)
    return LinkShapes(known.shapes, pairs)


def _limits(data: RobotFile, unit: float) -> Limits:
    table = np.array([each.limits.bounds(unit if each.type == "revolute" else 1.0) for each in data.joints]).T
    for i in np.flatnonzero(table[0] >= table[1])[:1]:
        lim = data.joints[i].limits
        raise FileFormatError(
            f"joints[{i}].limits: lower {lim.lower:g} ≥ upper {lim.upper:g}; lower must be below upper"
        )
    return Limits(*table)


def _inertia(data: RobotFile, turns: list[Array] | None) -> Inertia | None:
    bodies = [joint.inertia for joint in data.joints]
    if all(body is None for body in bodies):
        return None
    n = len(bodies)
    mass, center, tensor = np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3))
    for i, body in enumerate(bodies):
        if body is None:
            raise FileFormatError(f"joints[{i}]: missing key 'inertia', other joints have it")
        matrix = body.tensor.matrix
        if np.linalg.eigvalsh(matrix)[0] < 0:
            raise FileFormatError(
                f"joints[{i}].inertia.tensor: must not be negative in any direction, got {matrix}"
            )
        turn = poses.rotation_matrix(turns[i]) if turns is not None else np.eye(3)
        mass[i], center[i], tensor[i] = body.mass, turn.T @ body.center, turn.T @ matrix @ turn
    return Inertia(mass, center, tensor)
