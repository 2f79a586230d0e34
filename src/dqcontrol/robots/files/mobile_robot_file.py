"""A mobile manipulator from its URDF or MJCF file: the base that its wheels make, and the arm on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, UnknownNameError, as_positive, unknown_name
from dqcontrol.robots import bases
from dqcontrol.robots.files.link_tree import (
    LinkJoint,
    LinkTree,
    RoundLink,
    longest_arms,
    moves_alone,
    shared,
    ways_down,
)
from dqcontrol.robots.files.mjcf import mjcf_round_links, mjcf_tree
from dqcontrol.robots.files.urdf import UrdfTree, load_urdf, origin_matrix, urdf_tree
from dqcontrol.robots.files.urdf_xml import MJCF, CheckedXml, mesh_file
from dqcontrol.robots.poses import compose, inverse7, pose8, rotation_matrix, shift
from dqcontrol.robots.robot import NamedFrame, PlacedLinks
from dqcontrol.robots.whole_body import Base, WholeBody

_LEVEL = 0.1  # sine of the angle by which an axle may be off level, and a steering axis off upright
_SAME_HEIGHT = 0.03  # m: wheels that are higher above the floor than that are none
_LINE = 0.02  # m: so near to a line wheels are on one axle
_WORDS = ("wheel", "tyre", "tire")
_SPRINGS = ("suspension", "rocker", "bogie")


@dataclass(frozen=True)
class DriveHints:
    """What a file does not say of its base or says wrongly; the file's if omitted.

    Attributes
    ----------
    drive
        How it drives; by its wheels if omitted.
    wheel_radius, track, steering_limit
        m, m and rad.
    """

    drive: bases.DriveKind | None = None
    wheel_radius: float | None = None
    track: float | None = None
    steering_limit: float | None = None


def mobile_robot_from(path: str | Path, tip_link: str | None, hints: DriveHints) -> WholeBody:
    """Return the whole body of a URDF, xacro or MJCF file with wheels; see `load_robot`."""
    tree, found = base_of_file(path, hints)
    stand = inverse7(found.place)
    parts: list[object] = [found.base, pose8(stand)]
    tip = tip_link or _hand(tree, found)
    if tip is not None:
        is_mjcf = Path(path).suffix.lower() == MJCF
        parts.append(tree.chain(found.root, tip) if is_mjcf else load_urdf(path, found.root, tip))
    body = WholeBody(parts, tree.name)  # pyright: ignore[reportArgumentType]
    heading = found.base.configuration_size - 1  # the row that carries what stands on the base
    links = tree.placed_links(body.joint_names[heading + 1 :], found.root)
    frames = {
        link: NamedFrame(heading, compose(stand, pose)) if row < 0 else NamedFrame(heading + 1 + row, pose)
        for link, (row, pose) in links.frames.items()
    }
    body.placed_links = PlacedLinks(Path(path), frames)
    return body


def base_of_file(path: str | Path, hints: DriveHints) -> tuple[LinkTree, FoundBase]:
    """Return all links of a file, and the base that its wheels make; see `load_robot`.

    A wheel is a joint without limits about a level axis, of a round link or with a name like a wheel's, at the height
    of the lowest such, with nothing that moves below it but rollers. One below a joint about an upright axis is a
    caster, or steered if that has limits.

    Raises
    ------
    FileFormatError
        If the wheels cannot be told, or do not fit together: it is said why, and what to give.
    """
    is_mjcf = Path(path).suffix.lower() == MJCF
    tree = mjcf_tree(path) if is_mjcf else urdf_tree(path)
    return tree, _found_base(tree, mjcf_round_links(path) if is_mjcf else _round_links(path), hints)


def _round_links(path: str | Path) -> dict[str, RoundLink]:
    """Return the round shape of each link of a URDF file that has one: how it collides, else how it looks.

    A mesh counts for a link with the name of a wheel, if its file is found.
    """
    found = {}
    for name, link in UrdfTree(CheckedXml(path)).links.items():
        for part in [*link.collisions, *link.visuals]:
            shape = part.geometry.cylinder or part.geometry.sphere
            if shape is not None:
                found[name] = RoundLink(float(shape.radius), np.array(origin_matrix(part)[:3, 3]))
            elif part.geometry.mesh is not None and _is_named_wheel(name):
                found.update((name, each) for each in _round_mesh(Path(path), part))
            if name in found:
                break
    return found


def _round_mesh(path: Path, part: Any) -> list[RoundLink]:
    """Return radius and middle of the mesh of a wheel, which is as high as it is long; none if its file is missing."""
    try:
        file = mesh_file(path, part.geometry.mesh.filename)
    except FileNotFoundError:
        return []
    import trimesh

    scale = np.ones(3) if part.geometry.mesh.scale is None else np.asarray(part.geometry.mesh.scale)
    lower, upper = trimesh.load(file, force="mesh").bounds * scale
    middle = origin_matrix(part) @ [*(0.5 * (lower + upper)), 1.0]
    return [RoundLink(float(0.5 * np.sort(np.abs(upper - lower))[1]), middle[:3])]


def _hand(tree: LinkTree, found: FoundBase) -> str | None:
    """Return the link that carries all the fingers of the longest chain of joints; None if there is no arm.

    Raises
    ------
    UnknownNameError
        If there are several arms.
    """
    rolling = {name for w in (*found.wheels, *found.casters) for name in (w.joint, w.steering)}
    ways = ways_down((joint for joint in tree.joints if joint.child not in tree.marks), found.root)
    most, best = longest_arms(
        (way for way in ways if rolling.isdisjoint(each.name for each in way)), moves_alone, tree.is_held
    )
    if most == 0:
        return None
    common = shared([way.arm for way in best])
    if 2 * sum(map(moves_alone, common)) < most:
        ends = ", ".join(way.arm[-1].child for way in best)
        raise UnknownNameError(
            f"tip_link: must be given for {tree.where}; it has several arms, which end at {ends}"
        )
    return common[-1].child


@dataclass(frozen=True)
class Wheel:
    """A wheel as found in a file, at the joints' zero.

    Attributes
    ----------
    joint
        Name of the joint about which it rolls.
    middle
        In the frame of the root, m, shape (3,).
    axle
        Unit vector along its axle, to the left of where it rolls forwards, root frame, shape (3,).
    radius
        m; NaN if its shape does not say.
    speed
        Limit of its joint, rad/s.
    steering
        Name of the joint that steers it; empty if none does.
    steering_limit
        rad; infinite if it turns freely: a caster.
    has_rollers
        Whether further round joints hang on it, or its name says so.
    """

    joint: str
    middle: Array
    axle: Array
    radius: float
    speed: float
    steering: str = ""
    steering_limit: float = 0.0
    has_rollers: bool = False

    @property
    def is_caster(self) -> bool:
        """Whether it turns freely about an upright axis."""
        return math.isinf(self.steering_limit)


@dataclass(frozen=True)
class FoundBase:
    """A base, where it is in the robot's file, and what it was told by.

    Attributes
    ----------
    base
        The base.
    root
        Link whose frame ``place`` is in.
    place
        Pose (7,) of the base's frame, on the floor, in that of the root.
    wheels, casters
        Those that it was made of, and those that only roll along.
    """

    base: Base
    root: str
    place: Array
    wheels: tuple[Wheel, ...]
    casters: tuple[Wheel, ...]


def _found_base(tree: LinkTree, shapes: Mapping[str, RoundLink], hints: DriveHints) -> FoundBase:
    drive = hints.drive
    if drive is not None and drive not in get_args(bases.DriveKind):
        raise unknown_name("drive", str(drive), get_args(bases.DriveKind))
    found = _wheels(tree, shapes)
    wheels = tuple(wheel for wheel in found if not wheel.is_caster)
    casters = tuple(wheel for wheel in found if wheel.is_caster)
    # files of driven wheels that can be turned, as the youBot's
    if not wheels and casters and drive is not None:
        wheels, casters = tuple(replace(each, steering="", steering_limit=0.0) for each in casters), ()
    if not wheels and casters:
        names = ", ".join(each.joint for each in casters)
        raise _cannot_tell(
            tree, f"its wheels ({names}) are all casters; give drive, if they drive it all the same"
        )
    if not wheels:
        raise _cannot_tell(
            tree,
            "has no wheel: a wheel is a joint of type continuous about a level axis, of a round link or named like "
            "one; write a robot file with parts (docs/robots.md#whole-bodies)",
        )
    made = _Made(tree, wheels, hints)
    return FoundBase(made.base(drive or made.kind()), made.root, made.place, wheels, casters)


def _is_named_wheel(name: str) -> bool:
    """Return whether a joint or link has a name like a wheel's."""
    return any(word in name.lower() for word in _WORDS)


def _cannot_tell(tree: LinkTree, text: str) -> FileFormatError:
    return FileFormatError(f"{tree.where}: mobile base: {text}")


def _wheels(tree: LinkTree, shapes: Mapping[str, RoundLink]) -> list[Wheel]:
    """Return all that roll on the floor, casters too."""
    places, above = {tree.root: shift()}, {}
    children: dict[str, list[LinkJoint]] = {}
    for joint in tree.joints:
        at = shift() if joint.kind == "floating" else compose(places[joint.parent], joint.fixed)
        places[joint.child] = at if joint.kind == "floating" else compose(at, joint.link)
        above[joint.child] = joint
        children.setdefault(joint.parent, []).append(joint)
    candidates = []
    for joint in tree.joints:
        frame = compose(places[joint.parent], joint.fixed)
        axis = rotation_matrix(frame)[:, 2]
        turns = joint.kind == "revolute" and not np.isfinite([joint.lower, joint.upper]).any()
        named = _is_named_wheel(joint.name) or _is_named_wheel(joint.child)
        shape = shapes.get(joint.child)
        below = [each for each in _below(joint.child, children) if each.kind != "fixed"]
        rollers = bool(below) and all(
            each.kind == "revolute" and not np.isfinite(each.upper) for each in below
        )
        if not turns or abs(axis[2]) > _LEVEL or (below and not rollers) or not (named or shape):
            continue
        steering = _steering(_above(joint, above), places)
        if steering is None:
            continue
        middle = frame[4:]
        if shape is not None:  # moved along the axle only: a wheel turns about its middle
            seen = compose(places[joint.child], np.array([1.0, 0, 0, 0, *shape.middle]))[4:]
            middle = middle + axis * (axis @ (seen - middle))
        words = (joint.name + joint.child).lower()
        rollers = rollers or "mecanum" in words or "omni" in words
        radius = shape.radius if shape else math.nan
        candidates.append(Wheel(joint.name, middle, axis, radius, joint.velocity, *steering, rollers))
    heights = [wheel.middle[2] - (0.0 if math.isnan(wheel.radius) else wheel.radius) for wheel in candidates]
    floor = min(heights, default=0.0)
    return [wheel for wheel, height in zip(candidates, heights, strict=True) if height < floor + _SAME_HEIGHT]


def _below(link: str, children: Mapping[str, Sequence[LinkJoint]]) -> list[LinkJoint]:
    own = list(children.get(link, ()))
    return own + [each for joint in own for each in _below(joint.child, children)]


def _above(joint: LinkJoint, above: Mapping[str, LinkJoint]) -> Iterator[LinkJoint]:
    """Yield the moving joints between a joint and the root, the nearest first."""
    link = joint.parent
    while link in above:
        if above[link].kind in ("revolute", "prismatic"):
            yield above[link]
        link = above[link].parent


def _steering(carriers: Iterable[LinkJoint], places: Mapping[str, Array]) -> tuple[str, float] | None:
    """Return by which joint a wheel is steered, and how far; None if it is carried as no wheel of a base is."""
    steering = ("", 0.0)
    for joint in carriers:
        axis = rotation_matrix(compose(places[joint.parent], joint.fixed))[:, 2]
        if joint.kind == "prismatic" or any(word in joint.name.lower() for word in _SPRINGS):
            continue
        if steering[0] or math.hypot(axis[0], axis[1]) > _LEVEL:
            return None
        limits = -joint.lower, joint.upper
        steering = joint.name, min(limits) if np.isfinite(limits).all() else math.inf
    return steering


class _Made:
    """What wheels say of the base: its kind, its numbers, and where it is."""

    def __init__(self, tree: LinkTree, wheels: Sequence[Wheel], hints: DriveHints) -> None:
        self._tree, self._hints = tree, hints
        self._wheels, self._fixed = wheels, [wheel for wheel in wheels if not wheel.steering]
        self._steered = [wheel for wheel in wheels if wheel.steering]
        self.root = moving_root(tree)
        self._radius = self._common_radius(hints.wheel_radius)
        self._heading = self._facing()
        across = np.array([-math.sin(self._heading), math.cos(self._heading)])
        ahead = np.array([math.cos(self._heading), math.sin(self._heading)])
        self._ahead = [float(ahead @ wheel.middle[:2]) for wheel in self._fixed]
        self._across = [float(across @ wheel.middle[:2]) for wheel in self._fixed]
        middle = np.mean([wheel.middle for wheel in self._fixed or self._wheels], axis=0)
        self._middle, self._forward = middle, ahead
        half = 0.5 * self._heading
        floor = float(np.mean([wheel.middle[2] for wheel in self._wheels])) - self._radius
        self.place: Array = np.array([math.cos(half), 0, 0, math.sin(half), middle[0], middle[1], floor])

    def _unclear(self, text: str) -> FileFormatError:
        return _cannot_tell(self._tree, text)

    def kind(self) -> bases.DriveKind:
        """Return how the base drives, or say why that cannot be told."""
        fixed, steered = len(self._fixed), len(self._steered)
        names = ", ".join(wheel.joint for wheel in self._wheels)
        rollers = all(wheel.has_rollers for wheel in self._fixed)
        if fixed == 2 and steered in (1, 2):
            return "tricycle" if steered == 1 else "car-like"
        if fixed == 2 and not steered:
            return "differential"
        if fixed == 4 and not steered and rollers and self._spread() < 0.1:
            return "mecanum"
        if fixed >= 3 and not steered and self._spread() > 0.1:
            return "omni"
        if fixed == 4 and not steered:
            raise self._unclear(
                f"{names} are four wheels that are not steered: mecanum wheels, or a base that skids; "
                "give drive: mecanum or differential",
            )
        raise self._unclear(
            f"{fixed} wheels that are not steered and {steered} that are ({names}) are no drive that is known; "
            f"give drive: one of {', '.join(get_args(bases.DriveKind))}, or write a robot file with parts",
        )

    def base(self, kind: bases.DriveKind) -> Base:
        """Return the base of a kind."""
        speeds = [wheel.speed for wheel in self._wheels if not wheel.steering]
        rim = self._radius * min(speeds, default=math.inf)
        if kind == "differential":
            return bases.DifferentialDrive(self._radius, self._half_track(), rim_speed=rim)
        if kind == "mecanum":
            return bases.MecanumBase(
                wheel_radius=self._radius,
                half_track=self._half_track(),
                half_wheelbase=self._half_wheelbase(),
                rim_speed=rim,
            )
        if kind == "omni":
            return self._omni(rim)
        if not self._steered:
            raise self._unclear(f"drive: {kind} needs a wheel that is steered, and none is")
        limit = self._limit()
        ahead = np.mean([wheel.middle[:2] for wheel in self._steered], axis=0) - self._middle[:2]
        wheelbase = float(self._forward @ ahead)
        if wheelbase <= 0:  # steered behind: its heading is the other way round
            self.place = compose(self.place, np.array([0.0, 0, 0, 1, 0, 0, 0]))
        made = bases.CarLikeBase if kind == "car-like" else bases.SteeredTricycle
        return made(
            self._radius, self._half_track(), abs(wheelbase), limit, rim_speed=rim, steering_rate=math.inf
        )

    def _limit(self) -> float:
        if self._hints.steering_limit is not None:
            return as_positive("steering_limit", self._hints.steering_limit)
        return min(math.pi / 2, *(wheel.steering_limit for wheel in self._steered))

    def _common_radius(self, given: float | None) -> float:
        if given is not None:
            return as_positive("wheel_radius", given)
        radii = [wheel.radius for wheel in self._wheels]
        if np.isnan(radii).any():
            which = next(wheel.joint for wheel in self._wheels if math.isnan(wheel.radius))
            raise self._unclear(
                f"the shape of {which}'s link is neither cylinder nor sphere, so its radius is unknown; "
                "give wheel_radius (m)",
            )
        if max(radii) > 1.02 * min(radii):
            raise self._unclear(
                f"its wheels have radii from {min(radii):.4g} to {max(radii):.4g} m; give wheel_radius (m)",
            )
        return float(np.mean(radii))

    def _facing(self) -> float:
        """Return the heading of the base in the root's frame, rad: across its axles, the nearer of both to x."""
        x, y, _ = (self._fixed or self._wheels)[0].axle
        heading = math.atan2(-x, y)
        return (
            heading if -math.pi / 2 < heading <= math.pi / 2 else math.remainder(heading + math.pi, math.tau)
        )

    def _spread(self) -> float:
        """Return the largest sine between two axles."""
        first = self._fixed[0].axle
        return max(abs(first[0] * w.axle[1] - first[1] * w.axle[0]) for w in self._fixed)

    def _half_track(self) -> float:
        if self._hints.track is not None:
            return 0.5 * as_positive("track", self._hints.track)
        if len(self._fixed) < 2:
            raise self._unclear("a single wheel says nothing of the track; give track (m)")
        track = max(self._across) - min(self._across)
        if track < 1e-3:
            names = " and ".join(wheel.joint for wheel in self._fixed)
            raise self._unclear(
                f"{names} are {track:.2g} m apart: a track of 0 turns no base; give track (m)"
            )
        return 0.5 * track

    def _half_wheelbase(self) -> float:
        length = max(self._ahead) - min(self._ahead)
        if length < _LINE:
            raise self._unclear("its wheels are on one axle; drive: mecanum needs two")
        return 0.5 * length

    def _omni(self, rim: float) -> bases.OmniBase:
        out = np.array([wheel.middle[:2] for wheel in self._fixed]) - self._middle[:2]
        distance, count = np.linalg.norm(out, axis=1), len(out)
        angles = np.sort(np.arctan2(out[:, 1], out[:, 0]) - self._heading)
        even = angles[0] + math.tau * np.arange(count) / count
        if np.ptp(distance) > 0.02 * distance.mean() or np.abs(angles - even).max() > 0.02:
            raise self._unclear(
                "its omni wheels are not spread evenly on a circle; write a robot file with parts"
            )
        return bases.OmniBase(
            wheel_radius=self._radius,
            wheel_distance=float(distance.mean()),
            wheel_count=count,
            first_angle=float(angles[0]),
            rim_speed=rim,
        )


def moving_root(tree: LinkTree) -> str:
    """Return the root, or what floats freely below it."""
    return next((joint.child for joint in tree.joints if joint.kind == "floating"), tree.root)
