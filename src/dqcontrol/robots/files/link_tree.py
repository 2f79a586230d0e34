"""Links and joints as files describe them, the trees and chains that are made of them, and where a chain ends."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, FileFormatError, NoteWarning, UnknownNameError, suggest
from dqcontrol.robots.kinematics.kinematics_kernels import PRISMATIC, REVOLUTE
from dqcontrol.robots.limits import Inertia, Limits
from dqcontrol.robots.poses import compose, inverse7, rotation_matrix, shift
from dqcontrol.robots.robot import NamedFrame, PlacedLinks
from dqcontrol.robots.serial_arm import SerialArm
from dqcontrol.robots.tree_robot import TreeJoints, TreeRobot, seen_from

LinkJointKind: TypeAlias = Literal["revolute", "prismatic", "fixed", "floating", "other"]
_MOVING = ("revolute", "prismatic")
_HALF = math.sqrt(0.5)
_ALONG_X, _ALONG_Y, _ALONG_Z = (_HALF, 0.0, _HALF, 0.0), (_HALF, -_HALF, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
# joints of a floating root, and the turns of their frames, whose z axes they are along or about
_FLOATING: dict[str, tuple[LinkJointKind, tuple[float, ...]]] = {
    "x": ("prismatic", _ALONG_X),
    "y": ("prismatic", _ALONG_Y),
    "z": ("prismatic", _ALONG_Z),
    "yaw": ("revolute", _ALONG_Z),
    "pitch": ("revolute", _ALONG_Y),
    "roll": ("revolute", _ALONG_X),
}


class Mimic(NamedTuple):
    """A joint that follows another: multiplier · q + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


class RoundLink(NamedTuple):
    """The round shape of a link: its radius, m, and its middle in the link's frame, (3,), m."""

    radius: float
    middle: Array


class LinkBody(NamedTuple):
    """The mass of a link, kg, its centre, m, and its tensor about that, kg m², in the link's frame."""

    mass: float
    center: Array
    tensor: Array

    def moved(self, pose: Array) -> LinkBody:
        """Return it as seen from the frame in which its own has a pose (7,)."""
        turn = rotation_matrix(pose)
        return LinkBody(self.mass, turn @ self.center + pose[4:], turn @ self.tensor @ turn.T)


def one_body(parts: Sequence[LinkBody]) -> LinkBody:
    """Return what bodies are together, all in one frame; zeros without any mass."""
    mass, tensor = sum(part.mass for part in parts), np.zeros((3, 3))
    if not mass > 0:
        return LinkBody(mass, np.zeros(3), tensor)
    center = sum((part.mass * part.center for part in parts), np.zeros(3)) / mass
    for part in parts:
        off = part.center - center
        tensor += part.tensor + part.mass * (off @ off * np.eye(3) - np.outer(off, off))
    return LinkBody(mass, center, tensor)


@dataclass(frozen=True, eq=False)
class LinkJoint:
    """A joint between two links.

    Attributes
    ----------
    name, kind, parent, child
        ``floating``: the child is free; ``other``: it moves as no screw does, and only stays where the file has it.
    fixed
        Pose (7,) of the joint's frame in the parent link's; it turns about or slides along its z axis.
    link
        Pose (7,) of the child link's frame in the joint's after its screw.
    lower, upper, velocity, effort
        Limits, infinite where there are none.
    mimic
        What it follows.
    offset
        Its screw is by q + offset.
    """

    name: str
    kind: LinkJointKind
    parent: str
    child: str
    fixed: Array
    link: Array = field(default_factory=shift)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    mimic: Mimic | None = None
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class LinkTree:
    """What a robot's file describes.

    Attributes
    ----------
    name
        The robot's.
    where
        The file, for messages.
    root
        The link that carries all others.
    joints
        Parents before children.
    bodies
        The masses of links that have one.
    error
        Makes an error about a joint of that file, with its line.
    held
        Joints that cannot move by themselves, as in a loop: what is said where a chain or tree needs one.
    marks
        Links that only mark a place on others: never a default end.
    """

    name: str
    where: str
    root: str
    joints: tuple[LinkJoint, ...]
    bodies: Mapping[str, LinkBody]
    error: Callable[[str, str], Error]
    held: Mapping[str, Error] = field(default_factory=dict)
    marks: frozenset[str] = frozenset()

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, parents before children."""
        return (self.root, *(joint.child for joint in self.joints))

    def tree(
        self, tips: Sequence[str] | None = None, base: str | None = None, *, floating: bool = False
    ) -> TreeRobot:
        """Return the robot with all its joints, and every link as a named frame.

        Parameters
        ----------
        tips
            Links whose paths from the root are kept; other joints, and what they carry, stay where they are at
            zero. All joints if omitted. The first tip, or the first link that carries no other, is the task.
        base
            Link in whose frame the task's pose is given; the root if omitted.
        floating
            Whether the root moves, with all that it carries: by x, y, z, yaw, pitch and roll, each a coordinate. What
            floating joints carry stays where the file has it.

        Raises
        ------
        UnknownNameError
            If there is no such link.
        FileFormatError
            If a joint follows one that does not exist, or that follows another itself, or cannot move by itself.
        """
        for name in (*(tips or ()), *([base] if base else ())):
            known_link("frame", name, self.links, self.where)
        joints = [*self._free_base(floating), *self.joints]
        kept = _ancestors(joints, tips) if tips else {joint.name for joint in joints}
        self._check_free(kept)
        free = [joint for joint in joints if joint.kind in _MOVING and joint.name in kept]
        leaders = self._leaders(free)
        coordinates = [joint for joint in free if joint.mimic is None]
        coordinates += [joint for name, joint in leaders.items() if joint not in coordinates]
        if not coordinates:
            above = f" above {', '.join(tips)}" if tips else ""
            raise FileFormatError(f"{self.where}: has no joint that turns or slides{above}")
        index = {joint.name: i for i, joint in enumerate(coordinates)}
        stands, at, parts = self._placed(joints, free, _ground(joints, self.root))
        mimics = [joint.mimic or Mimic(joint.name) for joint in free]
        moved = np.array([index[mimic.joint] for mimic in mimics])
        frames = {name: NamedFrame(*at[name]) for name in self.links}
        first = tips[0] if tips else _first_leaf(self._joints_of_bodies(), self.root)
        robot = TreeRobot(
            TreeJoints(
                fixed=np.array([pose for _, pose in stands]),
                kind=np.array([REVOLUTE if joint.kind == "revolute" else PRISMATIC for joint in free]),
                parent=np.array([row for row, _ in stands]),
                coordinate=moved,
                column=moved,
                multiplier=np.array([mimic.multiplier for mimic in mimics]),
                offset=np.array(
                    [mimic.offset + joint.offset for mimic, joint in zip(mimics, free, strict=True)]
                ),
                names=tuple(joint.name for joint in free),
            ),
            frames,
            seen_from(first, None if base == self.root else base),
            joint_names=[joint.name for joint in coordinates],
            joint_types=[joint.kind for joint in coordinates],
            limits=_limits(coordinates),
            inertia=_lumped(parts, len(free)),
            name=self.name,
        )
        robot.placed_links = PlacedLinks(Path(self.where), frames)
        return robot

    def chain(self, base: str | None = None, tip: str | None = None) -> SerialArm:
        """Return the serial chain between two links, without those beside it but with their masses.

        Without a tip it is the chain with most joints, up to the link that carries its gripper; a `NoteWarning` tells.

        Raises
        ------
        UnknownNameError, FileFormatError
            As for `load_urdf`.
        """
        start = known_link("base_link", self.root if base is None else base, self.links, self.where)
        end = (
            known_link("tip_link", tip, self.links, self.where)
            if tip is not None
            else self.default_tip(start)
        )
        carried = {joint.child: joint for joint in self.joints}
        path = way_between(carried, start, end, self.where)
        self._check_free({joint.name for joint in path})
        moving = [joint for joint in path if joint.kind in _MOVING]
        if not moving:
            raise UnknownNameError(f"tip_link: no joint moves between '{start}' and '{end}' in {self.where}")
        for joint in moving:
            if joint.mimic is not None:
                raise self.error(
                    joint.name, f"follows joint '{joint.mimic.joint}' (mimic), which a serial arm cannot hold"
                )
        fixed, pose = [], shift()
        for joint in path:
            pose = compose(pose, joint.fixed)
            if joint in moving:
                fixed.append(pose)
                pose = _screw(joint, joint.offset)
            pose = compose(pose, joint.link)
        arm = SerialArm(
            np.array([*fixed, pose]),
            [joint.kind for joint in moving],
            limits=_limits(moving),
            joint_names=[joint.name for joint in moving],
            name=self.name,
        )
        _, _, parts = self._placed(self.joints, moving, self.root, offsets_after=True)
        arm.inertia = _lumped(parts, len(moving))
        arm.placed_links = self.placed_links(arm.joint_names, start)
        arm.links = (start, *(joint.child for joint in path))
        return arm

    def placed_links(self, moving: Sequence[str], base: str) -> PlacedLinks:
        """Return where all links stand, as index of the joint of a chain that carries each, and the pose in its frame.

        Parameters
        ----------
        moving
            Names of the chain's joints.
        base
            The link in whose frame those stand that no joint of the chain carries (index −1).
        """
        chain = [joint for joint in self.joints if joint.name in moving]
        _, at, _ = self._placed(self.joints, chain, self.root, offsets_after=True)
        stand = inverse7(at[base][1])
        return PlacedLinks(
            Path(self.where),
            {
                link: NamedFrame(row, pose if row >= 0 else compose(stand, pose))
                for link, (row, pose) in at.items()
            },
        )

    def default_tip(self, base: str) -> str:
        """Return the end of the chain with most joints, without its gripper."""
        return default_tip(
            self.where, self.name, base, ways_down(self._joints_of_bodies(), base), moves_alone, self.is_held
        )

    def is_held(self, joint: LinkJoint) -> bool:
        """Return whether a joint moves with others only."""
        return joint.mimic is not None or joint.name in self.held

    def _joints_of_bodies(self) -> list[LinkJoint]:
        return [joint for joint in self.joints if joint.child not in self.marks]

    def _check_free(self, joints: set[str]) -> None:
        for name, error in self.held.items():  # in the file's order
            if name in joints:
                raise error

    def _leaders(self, free: Sequence[LinkJoint]) -> dict[str, LinkJoint]:
        """Return the joints that others follow, checked."""
        by_name = {joint.name: joint for joint in self.joints}
        leaders = {}
        for joint in free:
            if joint.mimic is None:
                continue
            leader = by_name.get(joint.mimic.joint)
            if leader is None or leader.kind not in _MOVING:
                raise self.error(
                    joint.name,
                    f"follows joint '{joint.mimic.joint}', which {'does not exist' if leader is None else 'is fixed'}"
                    f"{suggest(joint.mimic.joint, by_name)}",
                )
            if leader.mimic is not None:
                raise self.error(
                    joint.name,
                    f"follows joint '{leader.name}', which itself follows '{leader.mimic.joint}'; let it follow that",
                )
            leaders[leader.name] = leader
        return leaders

    def _free_base(self, floating: bool) -> list[LinkJoint]:
        if not floating:
            return []
        links = [f"{self.root} {name}" for name in ("ground", *_FLOATING)]
        links[-1] = self.root
        turns = {name: np.array([*turn, 0, 0, 0]) for name, (_, turn) in _FLOATING.items()}
        return [
            LinkJoint(f"base_{name}", kind, parent, child, turns[name], inverse7(turns[name]))
            for (name, (kind, _)), (parent, child) in zip(_FLOATING.items(), pairwise(links), strict=True)
        ]

    def _placed(
        self,
        joints: Sequence[LinkJoint],
        moving: Sequence[LinkJoint],
        root: str,
        *,
        offsets_after: bool = False,
    ) -> tuple[list[tuple[int, Array]], dict[str, tuple[int, Array]], dict[int, list[LinkBody]]]:
        """Return where moving joints and links stand, and the bodies that each moving joint carries.

        All as index of the moving joint before (−1: none) and pose (7,) in its frame; other joints are at zero. The
        joints of a chain turn by q alone: their offsets come after that.
        """
        rows = {joint.name: i for i, joint in enumerate(moving)}
        stands = [(-1, shift())] * len(moving)
        at: dict[str, tuple[int, Array]] = {root: (-1, shift())}
        parts: dict[int, list[LinkBody]] = {}
        for joint in joints:
            row, pose = at[joint.parent]
            pose = compose(pose, joint.fixed)
            if joint.name in rows:
                stands[rows[joint.name]] = row, pose
                row, pose = rows[joint.name], _screw(joint, joint.offset) if offsets_after else shift()
            else:
                pose = compose(pose, _at_zero(joint))
            pose = compose(pose, joint.link)
            at[joint.child] = row, pose
            if row >= 0 and joint.child in self.bodies:
                parts.setdefault(row, []).append(self.bodies[joint.child].moved(pose))
        return stands, at, parts


def moves_alone(joint: LinkJoint) -> bool:
    """Return whether a joint turns or slides, and follows no other."""
    return joint.kind in _MOVING and joint.mimic is None


def _at_zero(joint: LinkJoint) -> Array:
    """Return the pose (7,) of a joint's screw where all coordinates are zero."""
    if joint.kind not in _MOVING:
        return shift()
    return _screw(joint, joint.offset + (joint.mimic.offset if joint.mimic else 0.0))


def _screw(joint: LinkJoint, value: float) -> Array:
    """Return the pose (7,) of a joint's screw by a value."""
    if joint.kind == "prismatic":
        return shift(0.0, 0.0, value)
    return np.array([math.cos(value / 2), 0, 0, math.sin(value / 2), 0, 0, 0])


def _limits(joints: Sequence[LinkJoint]) -> Limits:
    return Limits(*np.array([(joint.lower, joint.upper, joint.velocity, joint.effort) for joint in joints]).T)


def _ground(joints: Sequence[LinkJoint], root: str) -> str:
    return joints[0].parent if joints and joints[0].parent.endswith(" ground") else root


def _first_leaf(joints: Sequence[LinkJoint], root: str) -> str:
    parents = {joint.parent for joint in joints}
    return next((joint.child for joint in joints if joint.child not in parents), root)


def _ancestors(joints: Sequence[LinkJoint], tips: Sequence[str]) -> set[str]:
    """Return the names of all joints above some links."""
    carried = {joint.child: joint for joint in joints}
    found: set[str] = set()
    for link in tips:
        while link in carried and carried[link].name not in found:
            found.add(carried[link].name)
            link = carried[link].parent
    return found


def _lumped(parts: Mapping[int, Sequence[LinkBody]], count: int) -> Inertia | None:
    """Return one body a joint of all that hangs on it; None without any mass."""
    mass, center, tensor = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3, 3))
    for row, bodies in parts.items():
        mass[row], center[row], tensor[row] = one_body(bodies)
    return Inertia(mass, center, tensor) if mass.any() else None


_GRIPPER = re.compile("grip|finger|thumb|jaw|claw|knuckle", re.IGNORECASE)

Joint: TypeAlias = Any
"""What joins two links, whatever kind of file it is from: it has a name, ``parent``, ``child`` and ``mimic``."""


class PartedWay(NamedTuple):
    """The joints from a link to an end of the tree: those of the arm, and the moving ones of the gripper at its end."""

    arm: list[Joint]
    gripper: list[Joint]


def known_link(field: str, name: str, links: Iterable[str], where: str) -> str:
    """Return a link's name, or say that there is none such in a file."""
    if name not in links:
        raise UnknownNameError(
            f"{field}: unknown link '{name}'{suggest(name, links)} (links of {where}: {', '.join(links)})"
        )
    return name


def way_between(carried: Mapping[str, Joint], base: str, tip: str, where: str) -> list[Joint]:
    """Return the joints from one link down to another, of those by the links that they carry."""
    joints, link = list[Joint](), tip
    while link != base:
        if link not in carried:
            way = " < ".join([tip, *(joint.parent for joint in joints)])
            raise UnknownNameError(
                f"tip_link: '{tip}' is not below base link '{base}' in {where}, but on {way}"
            )
        joints.append(carried[link])
        link = joints[-1].parent
    return joints[::-1]


def ways_down(joints: Iterable[Joint], base: str) -> Iterator[list[Joint]]:
    """Yield the joints from a link down to each end below it; ``joints`` has parents before children."""
    ways: dict[str, list[Joint]] = {base: []}
    parents = set()
    for joint in joints:
        parents.add(joint.parent)
        if joint.parent in ways:
            ways[joint.child] = [*ways[joint.parent], joint]
    yield from (way for link, way in ways.items() if link not in parents)


def longest_arms(
    ways: Iterable[list[Joint]], moves: Callable[[Joint], bool], held: Callable[[Joint], bool]
) -> tuple[int, list[PartedWay]]:
    """Return the ways with most joints before their grippers, and how many joints these are.

    A gripper is what moves last, if it is named like one or held: by a loop, or by another joint that it follows, but
    none of the arm's. It has no more joints than the arm that carries it.

    Parameters
    ----------
    ways
        From `ways_down`.
    moves
        Whether a joint would be one of the arm's.
    held
        Whether a joint moves with others only.
    """
    parted = [_parted(way, moves, held) for way in ways]
    counts = [sum(map(moves, way.arm)) for way in parted]
    most = max(counts, default=0)
    return most, [way for way, count in zip(parted, counts, strict=True) if count == most]


def default_tip(
    where: str,
    name: str,
    base: str,
    ways: Iterable[list[Joint]],
    moves: Callable[[Joint], bool],
    held: Callable[[Joint], bool],
) -> str:
    """Return the link where a chain ends if nobody says; a `NoteWarning` tells which gripper is left out.

    Raises
    ------
    UnknownNameError
        If several links may be meant.
    """
    most, best = longest_arms(ways, moves, held)
    ends: dict[str, list[str]] = {}
    for hand in _hands(best, moves):
        holding = [way for way in hand if way.gripper]
        if holding:
            tip = shared([way.arm for way in holding])[-1].child
            ends[tip] = list(dict.fromkeys(joint.name for way in holding for joint in way.gripper))
        else:
            ends |= {way.arm[-1].child: [] for way in hand if way.arm}
    if not ends:
        return base
    tip, gripper = next(iter(ends.items()))
    if len(ends) > 1:
        raise UnknownNameError(
            f"tip_link: must be given for {where}; {len(ends)} links end a chain of {most} joints: "
            f"{', '.join(ends)} (--tip-link {tip}; in a spec robot: {{source: …, tip_link: {tip}}})"
        )
    if gripper:
        warnings.warn(
            f"{name}: the arm ends at {tip}, without the joints of its gripper ({', '.join(gripper)}); "
            "for another end: --tip-link LINK; in a spec robot: {source: …, tip_link: LINK}",
            NoteWarning,
            stacklevel=4,
        )
    return tip


def shared(ways: Sequence[list[Joint]]) -> list[Joint]:
    """Return the joints with which all of some ways begin."""
    steps = takewhile(lambda each: len({joint.name for joint in each}) == 1, zip(*ways, strict=False))
    return [each[0] for each in steps]


def _parted(way: list[Joint], moves: Callable[[Joint], bool], held: Callable[[Joint], bool]) -> PartedWay:
    moving = [i for i, joint in enumerate(way) if moves(joint) or held(joint)]
    last = list(takewhile(lambda i: held(way[i]) or _GRIPPER.search(way[i].name), reversed(moving)))
    if not last or 2 * len(last) > len(moving):
        return PartedWay(way, [])
    arm, gripper = way[: last[-1]], [way[i] for i in reversed(last)]
    followed = {joint.mimic.joint for joint in gripper if joint.mimic is not None}
    return PartedWay(way, []) if followed & {joint.name for joint in arm} else PartedWay(arm, gripper)


def _hands(ways: Iterable[PartedWay], moves: Callable[[Joint], bool]) -> Iterable[list[PartedWay]]:
    """Return ways by the joint that moves their ends."""
    hands: dict[str, list[PartedWay]] = {}
    for way in ways:
        last = next((joint.name for joint in reversed(way.arm) if moves(joint)), "")
        hands.setdefault(last, []).append(way)
    return hands.values()
