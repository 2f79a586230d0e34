"""URDF files: the serial chain between two links."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, UnknownNameError, suggest
from dqcontrol.robots.files import link_tree
from dqcontrol.robots.files.urdf_xml import CheckedXml
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.poses import chain_from_axes, compose, inverse_turn, rotation_matrix, z_onto
from dqcontrol.robots.serial_arm import SerialArm

_MOVABLE = ("revolute", "continuous", "prismatic")
_FREE = ("floating", "planar")  # what stands on the ground by one; a tree keeps it where the file has it


def load_urdf(
    path: str | Path, base_link: str | None = None, tip_link: str | None = None, name: str | None = None
) -> SerialArm:
    """Load the serial chain between two links of a URDF file.

    Fixed joints are merged. Everything that hangs on a moving link, with the joints of other branches at
    zero, is lumped into the inertia of the joint that moves it. Meshes are never opened. A chain without a named
    tip leaves out the gripper at its end; a `NoteWarning` tells.

    Parameters
    ----------
    path
        URDF file; or a xacro file, which is expanded (extra ``xacro``).
    base_link
        Link in whose frame poses are given, and gravity is; the root if omitted.
    tip_link
        Link whose frame is the tool. If omitted: the end of the chain with most joints, if there is one such, or the
        link that carries its gripper: joints named like one (grip, finger, thumb, jaw, claw, knuckle).
    name
        Name of the arm; the file's if omitted.

    Returns
    -------
    SerialArm
        Limits are those of the file; a velocity or effort limit that is zero or missing is unlimited.
        ``inertia`` is None if no moving link has a mass. The frames of the joints are the URDF's, turned so
        that z is the axis.

    Raises
    ------
    FileFormatError
        If the file is missing, unsafe, malformed or no tree, or a joint is floating, planar or mimic.
    UnknownNameError
        If a link does not exist, the tip is not below the base, or the default tip is ambiguous.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "lever.urdf"
    >>> _ = path.write_text('''<robot name="lever"><link name="base"/><link name="bar"/>
    ... <joint name="hinge" type="continuous"><parent link="base"/><child link="bar"/></joint></robot>''')
    >>> load_urdf(path)
    SerialArm('lever', 1 joints)
    """
    tree = UrdfTree(CheckedXml(path))
    base = link_tree.known_link(
        "base_link", tree.root if base_link is None else base_link, tree.links, str(path)
    )
    tip = (
        link_tree.known_link("tip_link", tip_link, tree.links, str(path))
        if tip_link is not None
        else tree.default_tip(base)
    )
    joints = link_tree.way_between(tree.parent, base, tip, str(path))

    poses, axes, moving, before = [], [], [], np.eye(4)
    for joint in joints:
        before = before @ origin_matrix(joint)
        if joint.type == "fixed":
            continue
        tree.check_movable(joint)
        poses.append(_pose7(before))
        axes.append(_axis(tree, joint))
        moving.append(joint)
        before = np.eye(4)
    if not moving:
        raise UnknownNameError(f"tip_link: no joint moves between '{base}' and '{tip}' in {path}")
    fixed, turns = chain_from_axes(poses, axes, _pose7(before))
    arm = SerialArm(
        np.array(fixed),
        ["prismatic" if joint.type == "prismatic" else "revolute" for joint in moving],
        limits=Limits(*np.array([_bounds(tree, joint) for joint in moving]).T),
        joint_names=[joint.name for joint in moving],
        name=name or tree.name,
        inertia=_lumped(tree, moving, turns),
    )
    arm.urdf, arm.links = (Path(path), base), (base, *(joint.child for joint in joints))
    return arm


def _lumped(tree: UrdfTree, chain: Sequence[Any], turns: Sequence[Array]) -> Inertia | None:
    """Return the body of each moving joint: its link and all links below, without those of the next joint.

    Parameters
    ----------
    tree
        Joints off the chain are held at zero.
    chain
        The moving joints of the arm, from base to tip.
    turns
        For each moving joint the pose (7,) of the arm's joint frame in the URDF's.

    Returns
    -------
    Inertia
        In the arm's joint frames, or None if there is no mass at all.
    """
    n = len(chain)
    mass, center, tensor = np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))
    for i, joint in enumerate(chain):
        parts = []
        pending = [(joint.child, np.eye(4))]
        while pending:
            link, pose = pending.pop()
            if (part := _body(tree.links[link], pose)) is not None:
                parts.append(part)
            pending += [
                (below.child, pose if below.origin is None else pose @ below.origin)
                for below in tree.children[link]
                if i + 1 == n or below is not chain[i + 1]
            ]
        turn = rotation_matrix(turns[i])
        mass[i], middle, about = link_tree.one_body(parts)
        if mass[i] > 0:
            center[i], tensor[i] = turn.T @ middle, turn.T @ about @ turn
    return Inertia(mass, center, tensor) if mass.any() else None


def _body(link: Any, pose: Array) -> link_tree.LinkBody | None:
    """Return mass, centre and tensor of one link, in the frame in which its pose is given."""
    inertial = link.inertial
    if inertial is None or not inertial.mass:
        return None
    frame = pose if inertial.origin is None else pose @ inertial.origin
    own = np.zeros((3, 3)) if inertial.inertia is None else inertial.inertia
    return link_tree.LinkBody(inertial.mass, frame[:3, 3], frame[:3, :3] @ own @ frame[:3, :3].T)


def urdf_tree(path: str | Path) -> link_tree.LinkTree:
    """Read all links and joints of a URDF or xacro file.

    Raises
    ------
    FileFormatError
        As for `load_urdf`, but mimic joints are allowed, and floating and planar ones, which stay where they are.
    """
    tree = UrdfTree(CheckedXml(path))
    joints = [_link_joint(tree, tree.parent[link]) for link in tree.below(tree.root) if link != tree.root]
    bodies = {name: body for name, link in tree.links.items() if (body := _body(link, np.eye(4))) is not None}

    def error(joint: str, text: str) -> Error:
        return tree.xml.error("joint", joint, text)

    return link_tree.LinkTree(tree.name, str(path), tree.root, tuple(joints), bodies, error)


def _link_joint(tree: UrdfTree, joint: Any) -> link_tree.LinkJoint:
    """Return a joint of a file, turned so that its axis is z."""
    place = _pose7(origin_matrix(joint))
    if joint.type == "fixed" or joint.type in _FREE:
        kind = "fixed" if joint.type == "fixed" else "floating"
        return link_tree.LinkJoint(joint.name, kind, joint.parent, joint.child, place)
    turn = z_onto(_axis(tree, joint))
    mimic, follows = joint.mimic, None
    if mimic is not None:
        multiplier = 1.0 if mimic.multiplier is None else float(mimic.multiplier)
        follows = link_tree.Mimic(mimic.joint, multiplier, float(mimic.offset or 0.0))
    kind = "prismatic" if joint.type == "prismatic" else "revolute"
    frames = compose(place, turn), inverse_turn(turn)
    return link_tree.LinkJoint(
        joint.name, kind, joint.parent, joint.child, *frames, *_bounds(tree, joint), follows
    )


class UrdfTree:
    """The links and joints of a robot, checked to be a tree."""

    def __init__(self, xml: CheckedXml) -> None:
        import yourdfpy  # half a second

        self.xml = xml
        try:
            model = yourdfpy.URDF.load(io.BytesIO(xml.data), build_scene_graph=False, load_meshes=False)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise FileFormatError(f"{xml.path}: cannot be read as URDF: {error}") from None
        self.name: str = model.robot.name
        self.links: dict[str, Any] = model.link_map
        for name, link in self.links.items():
            if link.inertial is not None and (link.inertial.mass or 0.0) < 0:
                raise xml.error("link", name, f"mass must be ≥ 0, got {link.inertial.mass:g}")
        self.parent: dict[str, Any] = {}
        self.children: dict[str, list[Any]] = {link: [] for link in self.links}
        for joint in model.robot.joints:
            for field, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    raise self.error(joint, f"unknown {field} link '{link}'{suggest(link, self.links)}")
            if joint.child in self.parent:
                other = self.parent[joint.child].name
                raise self.error(joint, f"link '{joint.child}' is already the child of '{other}'")
            self.parent[joint.child] = joint
            self.children[joint.parent].append(joint)
        if not self.links:
            raise FileFormatError(f"{xml.path}: has no links; a file of macros is for others to include")
        roots = [link for link in self.links if link not in self.parent]
        if len(roots) != 1:
            text = f"several links have no parent: {', '.join(roots)}" if roots else "every link has a parent"
            raise FileFormatError(f"{xml.path}: the links are not a tree: {text}")
        self.root: str = roots[0]
        if len(reached := list(self.below(self.root))) != len(self.links):
            loop = ", ".join(link for link in self.links if link not in reached)
            raise FileFormatError(f"{xml.path}: the links are not a tree: {loop} form a loop")

    def error(self, joint: Any, text: str) -> FileFormatError:
        """Return an error about a joint, with its line."""
        return self.xml.error("joint", joint.name, text)

    def below(self, link: str) -> Iterator[str]:
        """Yield a link and all links below it."""
        pending = [link]
        while pending:
            link = pending.pop()
            yield link
            pending += [joint.child for joint in reversed(self.children[link])]

    def places(self, moving: tuple[str, ...]) -> Iterator[tuple[str, Array, int]]:
        """Yield the pose of each link with all joints at zero, and how many joints of a chain carry it."""
        pending = [(self.root, np.eye(4), 0)]
        while pending:
            link, place, carrier = pending.pop()
            yield link, place, carrier
            for joint in reversed(self.children[link]):
                number = moving.index(joint.name) + 1 if joint.name in moving else carrier
                pending.append((joint.child, place @ origin_matrix(joint), number))

    def default_tip(self, base: str) -> str:
        """Return the end of the chain with most joints, without its gripper."""
        joints = (self.parent[link] for link in self.below(base) if link != base)
        ways = link_tree.ways_down(joints, base)
        return link_tree.default_tip(str(self.xml.path), self.name, base, ways, _is_movable, _follows)

    def check_movable(self, joint: Any) -> None:
        """Raise if a serial arm cannot have this joint."""
        if joint.mimic is not None:
            raise self.error(
                joint, f"follows joint '{joint.mimic.joint}' (mimic), which a serial arm cannot hold"
            )
        if joint.type not in _MOVABLE:
            raise self.error(
                joint,
                f"is {joint.type}; a serial arm has only {', '.join(_MOVABLE)} and fixed joints "
                f"(--base-link {joint.child} begins below it)",
            )


def _is_movable(joint: Any) -> bool:
    return joint.type in _MOVABLE and joint.mimic is None


def _follows(joint: Any) -> bool:
    return joint.type in _MOVABLE and joint.mimic is not None


def origin_matrix(joint: Any) -> Array:
    """Return where a joint or visual is, as a homogeneous matrix."""
    return np.eye(4) if joint.origin is None else joint.origin


def _pose7(matrix: Array) -> Array:
    """Return [quaternion, position] of a homogeneous matrix."""
    from trimesh.transformations import quaternion_from_matrix

    return np.concatenate([quaternion_from_matrix(matrix), matrix[:3, 3]])


def _axis(tree: UrdfTree, joint: Any) -> Array:
    if np.linalg.norm(joint.axis) < 1e-9:
        raise tree.error(joint, f"axis must not be zero, got {joint.axis}")
    return joint.axis


def _bounds(tree: UrdfTree, joint: Any) -> tuple[float, float, float, float]:
    """Return lower and upper limit, velocity and effort of a joint."""
    limit, lower, upper = joint.limit, -math.inf, math.inf
    if joint.type != "continuous":
        lower, upper = (limit.lower or 0.0, limit.upper or 0.0) if limit is not None else (0.0, 0.0)
        if lower >= upper:
            hint = "; a joint without limits has type 'continuous'" if joint.type == "revolute" else ""
            raise tree.error(
                joint, f"limit: lower {lower:g} ≥ upper {upper:g}; lower must be below upper{hint}"
            )
    velocity, effort = (limit.velocity or 0.0, limit.effort or 0.0) if limit is not None else (0.0, 0.0)
    for value in (velocity, effort):
        if value < 0:
            raise tree.error(joint, f"limit: velocity and effort must be ≥ 0, got {value:g}")
    return lower, upper, velocity or math.inf, effort or math.inf
