"""Constraints of a law: limits of joints, distances from bodies and from the robot itself, zones, angles, sight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np
from msgspec import Meta
from msgspec.structs import replace

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, unknown_name
from dqcontrol.geometry import Box, Cylinder, InfiniteCylinder, Plane, Shape
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.robot import AT_ONCE, CommandMode, Lag
from dqcontrol.world import Body, Held, Motion, Solid, World
from dqcontrol.world.body import Direction, Name, Place

if TYPE_CHECKING:
    from dqcontrol.constraints.prepared_constraints import PreparedConstraints
    from dqcontrol.robots.robot import Robot

HAND = "hand"  # the name of the hand's point among shapes

Length = Annotated[float, Meta(ge=0, description="m")]
Level = Annotated[int, Meta(ge=0, le=9)]


class Kept(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all that is kept has.

    Attributes
    ----------
    level
        Priority: where not everything can be kept, level 0 gives way last.
    """

    level: Level = 0


class ClearOf(Kept, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How shapes of the robot keep away from a body of the world.

    Parameters
    ----------
    margin
        Distance to keep, m; that of all constraints if omitted.
    links
        Names of the robot's shapes that keep away; ``hand`` is its point. All that move if omitted.
    """

    margin: Length | None = None
    links: Annotated[list[Name], Meta(min_length=1)] | None = None


class KeptBody(NamedTuple):
    """A body of the world that is kept clear of.

    Attributes
    ----------
    shapes
        All that it consists of, where it is at the start; of what a hand lets go also where it is put.
    there
        From when and until when each of these is there, s.
    moves
        How it moves by itself.
    clear
        How the robot keeps away.
    """

    shapes: list[Shape]
    there: list[tuple[float, float]]
    moves: Motion
    clear: ClearOf


class HeldBody(NamedTuple):
    """A body of the world that a hand holds.

    Attributes
    ----------
    shapes
        All that it consists of, in the axes of the hand.
    held
        When and how.
    """

    shapes: list[Shape]
    held: Held


def _kept(body: Body, clear: ClearOf) -> KeptBody:
    moves, shapes, held = body.moves or Motion(), body.shapes, body.held
    if held is None:
        return KeptBody(shapes, [(-math.inf, math.inf)] * len(shapes), moves, clear)
    there = [(-math.inf, held.since)] * len(shapes)
    put = body.put_down
    after = [] if put is None else put.shapes
    return KeptBody([*shapes, *after], [*there, *[(held.ends, math.inf)] * len(after)], moves, clear)


def _is_known(body: Body) -> bool:
    """Return whether somebody says where a body is: itself, or what measures it."""
    return body.watch is not None or body.held is not None or not body.is_moved_by_physics


class Zone(Solid, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A box, sphere, cylinder or free side of a plane that the hand's point, or a ball about it, stays in.

    Parameters
    ----------
    margin
        Distance to keep from its boundary, m; 0 if omitted.
    level
        As of ``Kept``.
    radius_of_hand
        Of the ball about the hand's point, m.
    frame
        Which frame of a tree is meant, ``left`` or ``right`` of two arms; all hands of the task if omitted.
    """

    margin: Length = 0.0
    level: Level = 0
    radius_of_hand: Length = 0.0
    frame: Name | None = None

    @property
    def walls(self) -> list[Shape]:
        """Planes with their free sides inside, and what the ball is inside of.

        Raises
        ------
        ShapeError
            If it has another shape.
        """
        (shape,) = self.shapes if self.kind in ("box", "sphere", "cylinder", "plane") else (None,)
        if isinstance(shape, Box):
            turn, half = shape.row[7:].reshape(3, 3), shape.row[1:4]
            return [
                _wall(sign * turn[:, k], shape.row[4:7], half[k]) for k in range(3) for sign in (1.0, -1.0)
            ]
        if isinstance(shape, Cylinder):
            axis, middle = shape.end - shape.start, 0.5 * (shape.start + shape.end)
            half = 0.5 * float(np.linalg.norm(axis))
            ends = [_wall(sign * axis, middle, half) for sign in (1.0, -1.0)]
            return [InfiniteCylinder(shape.start, axis, shape.radius), *ends]
        if shape is None:
            raise ShapeError(f"a zone is a box, sphere, cylinder or plane, got a {self.kind}")
        return [shape]


def _wall(normal: Array, middle: Array, half: float) -> Plane:
    """Return the plane that bounds, on one side, what reaches so far from its middle along a normal."""
    normal = normal / np.linalg.norm(normal)
    return Plane(normal, float(normal @ middle) - half)


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
        Name of the body that it looks at, one of ``clear_of``; or
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


PerInput = (
    Annotated[float, Meta(gt=0, description="rad/s² or m/s²")]
    | Annotated[list[Annotated[float, Meta(gt=0, description="rad/s² or m/s²")]], Meta(min_length=1)]
)


class Constraints(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """What a law's command is made to keep; see the page on constraints.

    Parameters
    ----------
    margin
        Distance to keep from bodies and between links, m, where they name none.
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
    clear_of
        Bodies of the world to keep away from: ``all`` that stand still or move as they say, a list of names, or names
        each with links, margin and level. The links next to a hand come near to what that is to hold (``held``).
    world
        Whose bodies these are; a spec gives its own. What of it a hand holds keeps away, meanwhile, from what the robot
        keeps clear of, and from the links that those next to the hand are kept apart from.
    zones, angles, sights
        By name.
    escape
        Where constraints hold the hand against what the law asks for 0.4 s, it goes aside at this speed for 1 s, m/s:
        up, to the sides, down, in turn. Where the end of a joint's range or its turning is what is held, the joints go
        to another posture, the hand no faster than this, for 2 s. Eight times at most; it may find a way, nothing is
        promised. Or ``plan``: a way from there to where the reference ends is planned and gone, by
        `laws.GuidedProportional`, and then the law goes on. If omitted it stands there.
    recovery
        A run may start where distances are too small; they are then asked to grow this fast at most, m/s or rad/s. If
        omitted, such a start is refused.

    Examples
    --------
    A ball in the way of a hand:

    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> hand = dqc.DualQuaternion(arm.fkm(q)).translation
    >>> ball = dqc.world.Body(sphere=0.05, position=tuple(hand + [0, 0.2, 0]))
    >>> far = {"ball": dqc.constraints.ClearOf(links=["hand"], margin=0.02)}
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"ball": ball}), clear_of=far, self_collision=False)
    >>> law = dqc.laws.Proportional(gain=2.0, constraints=keep)
    >>> target = dqc.references.SetPoint(arm.fkm(q + 0.1))
    >>> record = dqc.simulate(arm, target, law, dqc.plants.Integrator(), q, period=0.01, duration=3.0)
    >>> places = np.array([dqc.DualQuaternion(x).translation for x in record.pose])
    >>> bool(np.linalg.norm(places - ball.position, axis=1).min() >= 0.07)
    True
    """

    margin: Length = 0.01
    rate: Annotated[float, Meta(gt=0, description="1/s")] | None = None
    joint_limits: bool = True
    acceleration: PerInput | None = None
    self_collision: bool | None = None
    self_margin: Length | None = None
    clear_of: Literal["all"] | list[Name] | dict[Name, ClearOf] | None = None
    world: World | None = None
    zones: dict[Name, Zone] = {}
    angles: dict[Name, Angle] = {}
    sights: dict[Name, LineOfSight] = {}
    escape: Annotated[float, Meta(gt=0, le=2, description="m/s")] | Literal["plan"] | None = None
    recovery: Annotated[float, Meta(gt=0, description="m/s or rad/s")] | None = None

    @property
    def cleared(self) -> dict[str, ClearOf]:
        """How the robot keeps clear of each body that it keeps clear of, by name.

        Raises
        ------
        Error
            If there is no world, it has no such body, or physics alone says where that is.
        """
        if self.clear_of is None:
            return {}
        field = "constraints.clear_of"
        if self.world is None:
            raise ShapeError(f"{field}: names bodies of the world, and there is none; give 'world'")
        bodies = self.world.bodies
        if isinstance(self.clear_of, dict):
            chosen = self.clear_of
        elif self.clear_of == "all":
            chosen = {name: ClearOf() for name, body in bodies.items() if _is_known(body)}
        else:
            chosen = dict.fromkeys(self.clear_of, ClearOf())
        for name in chosen:
            if name not in bodies:
                raise unknown_name(field, name, tuple(bodies))
            if not _is_known(bodies[name]):
                raise ValueRangeError(
                    f"{field}: '{name}' is moved by what touches it, and nothing measures where it is; leave it out, "
                    "give it 'watch', or say how it moves with 'moves'"
                )
        return chosen

    @cached_property
    def obstacles(self) -> dict[str, KeptBody]:
        """The bodies that are kept clear of, by name, with their shapes.

        What a hand is to hold comes last.
        """
        bodies = self.world.bodies if self.world else {}
        chosen = sorted(self.cleared.items(), key=lambda each: bodies[each[0]].held is not None)
        return {name: _kept(bodies[name], clear) for name, clear in chosen}

    @cached_property
    def held(self) -> dict[str, HeldBody]:
        """What hands hold, by name."""
        found = {}
        for name, body in (self.world.bodies if self.world else {}).items():
            if body.held is not None:
                move = algebra.multiply(body.held.grasp, algebra.conjugate(body.pose))
                found[name] = HeldBody([shape.moved(move) for shape in body.shapes], body.held)
        return found

    @property
    def unwatched(self) -> Constraints:
        """The same without bodies that only measurements place, of which a recording alone says where they were."""
        if self.world is None:
            return self
        bodies, kept = self.world.bodies, self.cleared
        left = {name: clear for name, clear in kept.items() if bodies[name].watch is None}
        return self if len(left) == len(kept) else replace(self, clear_of=left)

    @property
    def names(self) -> tuple[str, ...]:
        """All names, of which no two may be one."""
        found = [*self.cleared, *self.zones, *self.angles, *self.sights]
        for name in found:
            if found.count(name) > 1:
                raise ValueRangeError(f"constraints: two of them have the name '{name}'")
        return tuple(found)

    def prepare(
        self, robot: Robot, period: float, command_mode: CommandMode, lag: Lag = AT_ONCE
    ) -> PreparedConstraints:
        """Return all that is kept, made ready for one robot and period; see `Law.prepare`.

        Raises
        ------
        Error
            If something cannot be kept with this robot, or names what it has not.
        """
        from dqcontrol.constraints.prepared_constraints import PreparedConstraints  # most laws need none

        return PreparedConstraints(self, robot, period, command_mode, lag)


def unit(field: str, vector: Sequence[float]) -> Array:
    """Return a vector with length 1."""
    size = math.hypot(*vector)
    if not size > 1e-12:
        raise ValueRangeError(f"{field}: must not be zero, got {list(vector)}")
    return np.asarray(vector, np.float64) / size
