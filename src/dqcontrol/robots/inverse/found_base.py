"""The mobile base in a robot's file: which joints are wheels, and how they move the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import FileFormatError, as_positive, unknown_name
from dqcontrol.robots.bases import CarLikeBase, DifferentialDrive, MecanumBase, OmniBase, SteeredTricycle
from dqcontrol.robots.files.link_tree import LinkJoint, LinkTree
from dqcontrol.robots.poses import compose, rotation_matrix, shift
from dqcontrol.robots.whole_body import Base

DriveKind: TypeAlias = Literal["differential", "mecanum", "omni", "car-like", "tricycle"]

_LEVEL = 0.1  # sine of the angle by which an axle may be off level, and a steering axis off upright
_SAME_HEIGHT = 0.03  # m: wheels that are higher above the floor than that are none
_LINE = 0.02  # m: so near to a line wheels are on one axle
_WORDS = ("wheel", "tyre", "tire")


class RoundLink(NamedTuple):
    """The round shape of a link: its radius, m, and its middle in the link's frame, (3,), m."""

    radius: float
    middle: Array


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


def find_base(
    tree: LinkTree,
    shapes: Mapping[str, RoundLink],
    *,
    drive: DriveKind | None = None,
    wheel_radius: float | None = None,
    track: float | None = None,
    steering_limit: float | None = None,
) -> FoundBase:
    """Return the base that the wheels of a file make.

    A wheel is a joint without limits about a level axis, of a round link or with a name like a wheel's, at the height
    of the lowest such, with nothing that moves below it but rollers. One below a joint about an upright axis is a
    caster, or steered if that has limits.

    Parameters
    ----------
    tree
        Links and joints.
    shapes
        The round shape of each link that has one.
    drive, wheel_radius, track, steering_limit
        What the file does not say or says wrongly, m and rad; the file's if omitted.

    Raises
    ------
    FileFormatError
        If the wheels cannot be told, or do not fit together: it is said why, and what to give.
    """
    if drive is not None and drive not in get_args(DriveKind):
        raise unknown_name("drive", str(drive), get_args(DriveKind))
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
    made = _Made(tree, wheels, wheel_radius, track, steering_limit)
    return FoundBase(made.base(drive or made.kind()), made.root, made.place, wheels, casters)


def is_named_wheel(name: str) -> bool:
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
        named = is_named_wheel(joint.name) or is_named_wheel(joint.child)
        shape = shapes.get(joint.child)
        below = [each for each in _below(joint.child, children) if each.kind not in ("fixed",)]
        rollers = bool(below) and all(
            each.kind == "revolute" and not np.isfinite(each.upper) for each in below
        )
        if not turns or abs(axis[2]) > _LEVEL or (below and not rollers) or not (named or shape):
            continue
        carriers = _above(joint, above)
        steering = _steering(carriers, places)
        if steering is None:
            continue
        middle = frame[4:]
        if shape is not None:  # moved along the axle only: a wheel turns about its middle
            seen = compose(places[joint.child], np.array([1.0, 0, 0, 0, *shape.middle]))[4:]
            middle = middle + axis * (axis @ (seen - middle))
        words = (joint.name + joint.child).lower()
        candidates.append(
            Wheel(
                joint.name,
                middle,
                axis,
                shape.radius if shape else math.nan,
                joint.velocity,
                steering[0],
                steering[1],
                rollers or "mecanum" in words or "omni" in words,
            )
        )
    if not candidates:
        return []
    heights = [wheel.middle[2] - (0.0 if math.isnan(wheel.radius) else wheel.radius) for wheel in candidates]
    floor = min(heights)
    return [wheel for wheel, height in zip(candidates, heights, strict=True) if height < floor + _SAME_HEIGHT]


def _below(link: str, children: Mapping[str, Sequence[LinkJoint]]) -> list[LinkJoint]:
    own = list(children.get(link, ()))
    return own + [each for joint in own for each in _below(joint.child, children)]


def _above(joint: LinkJoint, above: Mapping[str, LinkJoint]) -> list[LinkJoint]:
    """Return the moving joints between a joint and the root, the nearest first."""
    found, link = [], joint.parent
    while link in above:
        if above[link].kind in ("revolute", "prismatic"):
            found.append(above[link])
        link = above[link].parent
    return found


def _steering(carriers: Sequence[LinkJoint], places: Mapping[str, Array]) -> tuple[str, float] | None:
    """Return by which joint a wheel is steered, and how far; None if it is carried as no wheel of a base is."""
    steering = ("", 0.0)
    for joint in carriers:
        axis = rotation_matrix(compose(places[joint.parent], joint.fixed))[:, 2]
        springs = joint.kind == "prismatic" or any(
            word in joint.name.lower() for word in ("suspension", "rocker", "bogie")
        )
        if springs:
            continue
        if steering[0] or math.hypot(axis[0], axis[1]) > _LEVEL:
            return None
        limits = -joint.lower, joint.upper
        steering = joint.name, min(limits) if np.isfinite(limits).all() else math.inf
    return steering


class _Made:
    """What wheels say of the base: its kind, its numbers, and where it is."""

    def __init__(
        self,
        tree: LinkTree,
        wheels: Sequence[Wheel],
        radius: float | None,
        track: float | None,
        steering_limit: float | None,
    ) -> None:
        self._tree, self._track, self._steering_limit = tree, track, steering_limit
        self._fixed = [wheel for wheel in wheels if not wheel.steering]
        self._steered = [wheel for wheel in wheels if wheel.steering]
        self._wheels = list(wheels)
        self.root = moving_root(tree)
        self._radius = self._common_radius(radius)
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

    def kind(self) -> DriveKind:
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
            raise _cannot_tell(
                self._tree,
                f"{names} are four wheels that are not steered: mecanum wheels, or a base that skids; "
                "give drive: mecanum or differential",
            )
        raise _cannot_tell(
            self._tree,
            f"{fixed} wheels that are not steered and {steered} that are ({names}) are no drive that is known; "
            f"give drive: one of {', '.join(get_args(DriveKind))}, or write a robot file with parts",
        )

    def base(self, kind: DriveKind) -> Base:
        """Return the base of a kind."""
        speeds = [wheel.speed for wheel in self._wheels if not wheel.steering]
        rim = self._radius * min(speeds, default=math.inf)
        if kind == "differential":
            return DifferentialDrive(self._radius, self._half_track(), rim_speed=rim)
        if kind == "mecanum":
            return MecanumBase(
                wheel_radius=self._radius,
                half_track=self._half_track(),
                half_wheelbase=self._half_wheelbase(),
                rim_speed=rim,
            )
        if kind == "omni":
            return self._omni(rim)
        if not self._steered:
            raise _cannot_tell(self._tree, f"drive: {kind} needs a wheel that is steered, and none is")
        limit = self._limit()
        ahead = np.mean([wheel.middle[:2] for wheel in self._steered], axis=0) - self._middle[:2]
        wheelbase = float(self._forward @ ahead)
        if wheelbase <= 0:  # steered behind: its heading is the other way round
            self.place = compose(self.place, np.array([0.0, 0, 0, 1, 0, 0, 0]))
        made = CarLikeBase if kind == "car-like" else SteeredTricycle
        return made(
            self._radius, self._half_track(), abs(wheelbase), limit, rim_speed=rim, steering_rate=math.inf
        )

    def _limit(self) -> float:
        if self._steering_limit is not None:
            return as_positive("steering_limit", self._steering_limit)
        return min(math.pi / 2, *(wheel.steering_limit for wheel in self._steered))

    def _common_radius(self, given: float | None) -> float:
        if given is not None:
            return as_positive("wheel_radius", given)
        radii = [wheel.radius for wheel in self._wheels]
        if np.isnan(radii).any():
            which = next(wheel.joint for wheel in self._wheels if math.isnan(wheel.radius))
            raise _cannot_tell(
                self._tree,
                f"the shape of {which}'s link is neither cylinder nor sphere, so its radius is unknown; "
                "give wheel_radius (m)",
            )
        if max(radii) > 1.02 * min(radii):
            raise _cannot_tell(
                self._tree,
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
        if self._track is not None:
            return 0.5 * as_positive("track", self._track)
        if len(self._fixed) < 2:
            raise _cannot_tell(self._tree, "a single wheel says nothing of the track; give track (m)")
        track = max(self._across) - min(self._across)
        if track < 1e-3:
            names = " and ".join(wheel.joint for wheel in self._fixed)
            raise _cannot_tell(
                self._tree, f"{names} are {track:.2g} m apart: a track of 0 turns no base; give track (m)"
            )
        return 0.5 * track

    def _half_wheelbase(self) -> float:
        length = max(self._ahead) - min(self._ahead)
        if length < _LINE:
            raise _cannot_tell(self._tree, "its wheels are on one axle; drive: mecanum needs two")
        return 0.5 * length

    def _omni(self, rim: float) -> OmniBase:
        out = np.array([wheel.middle[:2] for wheel in self._fixed]) - self._middle[:2]
        distance, count = np.linalg.norm(out, axis=1), len(out)
        angles = np.sort(np.arctan2(out[:, 1], out[:, 0]) - self._heading)
        even = angles[0] + math.tau * np.arange(count) / count
        if np.ptp(distance) > 0.02 * distance.mean() or np.abs(angles - even).max() > 0.02:
            raise _cannot_tell(
                self._tree, "its omni wheels are not spread evenly on a circle; write a robot file with parts"
            )
        return OmniBase(
            wheel_radius=self._radius,
            wheel_distance=float(distance.mean()),
            wheel_count=count,
            first_angle=float(angles[0]),
            rim_speed=rim,
        )


def moving_root(tree: LinkTree) -> str:
    """Return the root, or what floats freely below it."""
    return next((joint.child for joint in tree.joints if joint.kind == "floating"), tree.root)
