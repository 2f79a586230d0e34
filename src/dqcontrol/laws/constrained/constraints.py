"""What a law is to keep: limits of joints, distances from obstacles and from the robot itself, zones, angles, sight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, error_prefix
from dqcontrol.geometry import Box, Capsule, InfiniteCylinder, Plane, Shape, Sphere, load_map
from dqcontrol.named_fields import NamedFields

if TYPE_CHECKING:
    from dqcontrol.laws.constrained.prepared_constraints import PreparedConstraints
    from dqcontrol.laws.law import CommandMode
    from dqcontrol.robots.robot import Robot

HAND = "hand"  # the name of the hand's point among shapes

Number3 = tuple[float, float, float]
Place = Annotated[Number3, Meta(description="m")]
Direction = Annotated[Number3, Meta(description="not zero")]
Length = Annotated[float, Meta(ge=0, description="m")]
Name = Annotated[str, Meta(min_length=1, max_length=60)]
Level = Annotated[int, Meta(ge=0, le=9)]


class Kept(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all that is kept has.

    Attributes
    ----------
    level
        Priority: where not everything can be kept, level 0 gives way last.
    """

    level: Level = 0


class KeepOut(Kept, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """Something that shapes of the robot keep away from; subclasses say what.

    Parameters
    ----------
    margin
        Distance to keep, m; that of all constraints if omitted.
    velocity
        It moves on from its place with that, m/s.
    path
        Or it moves by these rows [t, x, y, z] (s, m): shifts from its place, straight between them, resting at both
        ends.
    speed
        At most this fast it may also come nearer than it is said to, m/s.
    links
        Names of the robot's shapes that keep away; ``hand`` is its point. All that move if omitted.
    """

    margin: Length | None = None
    velocity: Annotated[Number3, Meta(description="m/s")] | None = None
    path: Annotated[list[tuple[float, float, float, float]], Meta(min_length=2)] | None = None
    speed: Annotated[float, Meta(ge=0, description="m/s")] = 0.0
    links: Annotated[list[Name], Meta(min_length=1)] | None = None

    @property
    def shape(self) -> Shape:
        """Where it is at the start."""
        raise NotImplementedError

    @property
    def shapes(self) -> list[Shape]:
        """All that it consists of."""
        return [self.shape]


class SphereObstacle(KeepOut, frozen=True, kw_only=True, tag="sphere"):
    """A ball."""

    center: Place
    radius: Annotated[float, Meta(gt=0, description="m")]

    @property
    def shape(self) -> Shape:
        """The ball."""
        return Sphere(np.array(self.center), self.radius)


class CapsuleObstacle(KeepOut, frozen=True, kw_only=True, tag="capsule"):
    """All points within a radius of a segment."""

    start: Place
    end: Place
    radius: Annotated[float, Meta(gt=0, description="m")]

    @property
    def shape(self) -> Shape:
        """The capsule."""
        return Capsule(np.array(self.start), np.array(self.end), self.radius)


class CylinderObstacle(KeepOut, frozen=True, kw_only=True, tag="cylinder"):
    """An endless cylinder."""

    point: Place
    direction: Direction = (0.0, 0.0, 1.0)
    radius: Annotated[float, Meta(gt=0, description="m")]

    @property
    def shape(self) -> Shape:
        """The cylinder."""
        return InfiniteCylinder(np.array(self.point), np.array(self.direction), self.radius)


class PlaneObstacle(KeepOut, frozen=True, kw_only=True, tag="plane"):
    """A plane with a free side, n·p ≥ offset; the normal points into the free side."""

    normal: Direction
    offset: Annotated[float, Meta(description="m")]

    @property
    def shape(self) -> Shape:
        """The plane."""
        return Plane(np.array(self.normal), self.offset)


class BoxObstacle(KeepOut, frozen=True, kw_only=True, tag="box"):
    """A solid box about its position."""

    position: Place
    size: Place
    rpy: Annotated[Number3, Meta(description="rad")] = (0.0, 0.0, 0.0)

    @property
    def shape(self) -> Shape:
        """The box."""
        return Box(algebra.pose(algebra.rotation_from_rpy(self.rpy), self.position), np.array(self.size))


class MapObstacle(KeepOut, frozen=True, kw_only=True, tag="map"):
    """What stands on a floor, from a file of polygons or a grid; see `dqcontrol.geometry.load_map`."""

    file: Annotated[str, Meta(min_length=1, description="path, relative to the spec")]

    @property
    def shapes(self) -> list[Shape]:
        """Boxes that stand for it."""
        return [*load_map(self.file).boxes()]


AnyObstacle = SphereObstacle | CapsuleObstacle | CylinderObstacle | PlaneObstacle | BoxObstacle | MapObstacle


class Zone(Kept, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A zone that the hand's point, or a ball about it, stays in; subclasses say which.

    Parameters
    ----------
    margin
        Distance to keep from its boundary, m; 0 if omitted.
    radius_of_hand
        Of the ball about the hand's point, m.
    frame
        Which frame of a tree is meant, ``left`` or ``right`` of two arms; all hands of the task if omitted.
    """

    margin: Length = 0.0
    radius_of_hand: Length = 0.0
    frame: Name | None = None

    @property
    def walls(self) -> list[Shape]:
        """Planes with their free sides inside, or what the ball is inside of."""
        raise NotImplementedError

    @property
    def solids(self) -> list[Shape]:
        """What is drawn of it."""
        return self.walls


class BoxZone(Zone, frozen=True, kw_only=True, tag="box"):
    """A room with six walls about its position."""

    position: Place
    size: Place
    rpy: Annotated[Number3, Meta(description="rad")] = (0.0, 0.0, 0.0)

    @property
    def solids(self) -> list[Shape]:
        """The box."""
        return [Box(algebra.pose(algebra.rotation_from_rpy(self.rpy), self.position), np.array(self.size))]

    @property
    def walls(self) -> list[Shape]:
        """Six planes."""
        (box,) = self.solids
        turn = box.row[7:].reshape(3, 3)
        walls: list[Shape] = []
        for k in range(3):
            for sign in (1.0, -1.0):
                normal = sign * turn[:, k]
                walls.append(Plane(normal, float(normal @ np.asarray(self.position)) - 0.5 * self.size[k]))
        return walls


class SphereZone(Zone, frozen=True, kw_only=True, tag="sphere"):
    """A ball."""

    center: Place
    radius: Annotated[float, Meta(gt=0, description="m")]

    @property
    def walls(self) -> list[Shape]:
        """The ball."""
        return [Sphere(np.array(self.center), self.radius)]


class CylinderZone(Zone, frozen=True, kw_only=True, tag="cylinder"):
    """An endless cylinder."""

    point: Place
    direction: Direction = (0.0, 0.0, 1.0)
    radius: Annotated[float, Meta(gt=0, description="m")]

    @property
    def walls(self) -> list[Shape]:
        """The cylinder."""
        return [InfiniteCylinder(np.array(self.point), np.array(self.direction), self.radius)]


class PlaneZone(Zone, frozen=True, kw_only=True, tag="plane"):
    """The free side of a plane, n·p ≥ offset."""

    normal: Direction
    offset: Annotated[float, Meta(description="m")]

    @property
    def walls(self) -> list[Shape]:
        """The plane."""
        return [Plane(np.array(self.normal), self.offset)]


AnyZone = BoxZone | SphereZone | CylinderZone | PlaneZone

LEAST_CONE = math.radians(2)  # smaller ones are no cone but an axis to align: its gradient vanishes there


class Angle(Kept, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The angle between an axis of the hand and a direction of the world.

    Parameters
    ----------
    axis
        In the hand's frame.
    direction
        In the world.
    at_most
        Half angle of the cone that the axis stays in, rad.
    at_least
        Half angle of the cone that it stays out of, rad.
    apart
        Both are taken for lines without sense, which stay that far from parallel, rad.
    frame
        Which frame of a tree is meant; the hand of the task if omitted.
    """

    frame: Name | None = None

    axis: Direction = (0.0, 0.0, 1.0)
    direction: Direction
    at_most: Annotated[float, Meta(ge=0, le=math.pi, description="rad")] | None = None
    at_least: Annotated[float, Meta(gt=0, le=math.pi, description="rad")] | None = None
    apart: Annotated[float, Meta(gt=0, lt=math.pi / 2, description="rad")] | None = None

    @property
    def limits(self) -> list[tuple[bool, float]]:
        """Whether each limit is from above, and what it is."""
        found: list[tuple[bool, float]] = []
        if self.at_most is not None:
            if self.at_most < LEAST_CONE:
                raise ValueRangeError(
                    f"at_most: must be ≥ {LEAST_CONE:.3g} rad (2°), got {self.at_most:g}; a cone without room is an "
                    "axis to align: let the reference turn the hand there"
                )
            found.append((True, self.at_most))
        if self.at_least is not None:
            found.append((False, self.at_least))
        if self.apart is not None:
            found += [(False, self.apart), (True, math.pi - self.apart)]
        if not found:
            raise ValueRangeError("give one of at_most, at_least, apart")
        return found


class LineOfSight(Kept, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera on the hand that keeps a target in its view.

    Parameters
    ----------
    target
        Name of the obstacle that it looks at; or
    place
        place of the target, m.
    axis, camera
        Of the view and of the camera, in the hand's frame.
    at_most
        Half angle of the view, rad.
    frame
        Which frame of a tree carries the camera; the hand of the task if omitted.
    """

    frame: Name | None = None

    target: Name | None = None
    place: Place | None = None
    axis: Direction = (0.0, 0.0, 1.0)
    camera: Place = (0.0, 0.0, 0.0)
    at_most: Annotated[float, Meta(ge=LEAST_CONE, lt=math.pi, description="rad")]


class Lag(NamedTuple):
    """How late joints follow targets that commands move.

    Attributes
    ----------
    times
        Time constant of each coordinate, s; empty: none.
    delays
        From command to joint, of each coordinate, s.
    """

    times: tuple[float, ...] = ()
    delays: tuple[float, ...] = ()

    @property
    def late(self) -> float:
        """The longest of time constant and delay together, s."""
        return max((a + b for a, b in zip(self.times, self.delays, strict=True)), default=0.0)

    @property
    def mean(self) -> tuple[float, float]:
        """The means of time constants and delays, s."""
        n = max(len(self.times), 1)
        return sum(self.times) / n, sum(self.delays) / n


AT_ONCE = Lag()

PerInput = (
    Annotated[float, Meta(gt=0, description="rad/s² or m/s²")]
    | Annotated[list[Annotated[float, Meta(gt=0, description="rad/s² or m/s²")]], Meta(min_length=1)]
)


class Constraints(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a law's command is made to keep; see the page on constraints.

    Parameters
    ----------
    margin
        Distance to keep from obstacles and between links, m, where they name none.
    rate
        η: a distance that is larger than what is kept shrinks by this share a second at most, 1/s. If omitted, the
        least of 10, half a period's inverse, and acceleration/velocity of each input, with which limits of
        acceleration and distances that do not curve can always be kept together; others shrink faster where need be.
    joint_limits
        Whether positions and velocities of joints are kept.
    acceleration
        Limit of each input's acceleration, or of all; none if omitted. Of bases as their files say.
    self_collision
        Whether the pairs of links that the robot's shapes name are kept apart; if omitted, of robots with shapes.
    self_margin
        Distance between links, m; ``margin`` if omitted.
    obstacles, zones, angles, sights
        By name.
    escape
        Where constraints hold the hand against what the law asks for 0.4 s, it goes aside at this speed for 1 s, m/s:
        up, to the sides, down, in turn. Where the end of a joint's range or its turning is what is held, the joints go
        to another posture, the hand no faster than this, for 2 s. Eight times at most; it may find a way, nothing is
        promised. If omitted it stands there.
    recovery
        A run may start where distances are too small; they are then asked to grow this fast at most, m/s or rad/s. If
        omitted, such a start is refused.

    Examples
    --------
    A ball in the way of a hand:

    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> hand = dqc.DualQuaternion(arm.fkm(q)).translation
    >>> ball = dqc.laws.SphereObstacle(center=tuple(hand + [0, 0.2, 0]), radius=0.05, links=["hand"], margin=0.02)
    >>> keep = dqc.laws.Constraints(obstacles={"ball": ball}, self_collision=False)
    >>> law = dqc.laws.Proportional(gain=2.0, constraints=keep)
    >>> target = dqc.references.SetPoint(arm.fkm(q + 0.1))
    >>> record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, period=0.01, duration=3.0)
    >>> places = np.array([dqc.DualQuaternion(x).translation for x in record.pose])
    >>> bool(np.linalg.norm(places - ball.center, axis=1).min() >= 0.07)
    True
    """

    PER_INPUT: ClassVar[tuple[str, ...]] = ("acceleration",)

    margin: Length = 0.01
    rate: Annotated[float, Meta(gt=0, description="1/s")] | None = None
    joint_limits: bool = True
    acceleration: PerInput | None = None
    self_collision: bool | None = None
    self_margin: Length | None = None
    obstacles: dict[Name, AnyObstacle] = {}
    zones: dict[Name, AnyZone] = {}
    angles: dict[Name, Angle] = {}
    sights: dict[Name, LineOfSight] = {}
    escape: Annotated[float, Meta(gt=0, le=2, description="m/s")] | None = None
    recovery: Annotated[float, Meta(gt=0, description="m/s or rad/s")] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """All names, of which no two may be one."""
        found = [*self.obstacles, *self.zones, *self.angles, *self.sights]
        for name in found:
            if found.count(name) > 1:
                raise ValueRangeError(f"constraints: two of them have the name '{name}'")
        return tuple(found)

    def prepare(
        self, robot: Robot, dt: float, command_mode: CommandMode, lag: Lag = AT_ONCE
    ) -> PreparedConstraints:
        """Return all that is kept, made ready for one robot and period; see `Law.prepare`.

        Raises
        ------
        Error
            If something cannot be kept with this robot, or names what it has not.
        """
        from dqcontrol.laws.constrained.prepared_constraints import PreparedConstraints  # most laws need none

        return PreparedConstraints(self, robot, dt, command_mode, lag)


def unit(field: str, vector: Sequence[float]) -> Array:
    """Return a vector with length 1."""
    size = math.hypot(*vector)
    if not size > 1e-12:
        raise ValueRangeError(f"{field}: must not be zero, got {list(vector)}")
    return np.asarray(vector, np.float64) / size


def shapes_of(field: str, obstacle: KeepOut) -> list[Shape]:
    """Return an obstacle's shapes, with its name in messages."""
    with error_prefix(field):
        shapes = obstacle.shapes
        if obstacle.velocity is not None and obstacle.path is not None:
            raise ShapeError("path: it has a velocity already; give one of them")
        return shapes
