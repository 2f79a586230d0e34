"""A body of the world: its shapes, whether it stands, moves as said or freely, or gives way; where it was in a run."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, error_prefix
from dqcontrol.geometry import Box, Capsule, Cylinder, Plane, Shape, Sphere, load_map
from dqcontrol.geometry.floor_map import map_version
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.world.mesh import hulls

Name = Annotated[str, Meta(min_length=1, max_length=60)]
Place = Annotated[Three, Meta(description="m")]
Direction = Annotated[Three, Meta(description="not zero")]
Angles = Annotated[Three, Meta(description="rad")]
Size = Annotated[float, Meta(gt=0, description="m")]
FileName = Annotated[str, Meta(min_length=1, description="path, relative to the file that names it")]

SHAPES = ("box", "sphere", "capsule", "cylinder", "plane", "container", "mesh", "map")
_WALL = 6e-3  # m: of a container, as of a wicker basket
_FLOOR = 3e-3  # m
_STAVES = 16  # of a round container: a round peg has 2 % more play towards their seams
INSTANT = 1e-9  # s: rounding of the moments at which a hand closes and opens
_BY_PHYSICS = ("free", "hinge", "slide")
_FASTEST = 20.0  # m/s: nothing that a robot works beside moves faster; a path that does has a jump


class Solid(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """One shape, given by the key that says its kind, and where it is.

    Parameters
    ----------
    box
        Its edges along the axes of the pose, m; one number is a cube's.
    sphere
        Its radius, m.
    capsule, cylinder
        Radius and length along the z axis, m; a capsule's without its half spheres.
    plane
        Its normal, towards the free side; ``position`` is a point of it. What is behind it is solid.
    container
        Inside of an open box, m, whose ``position`` is the middle of its bottom's underside; two numbers are diameter
        and height of a round one.
    chamfer
        By how much the rim of a round container opens, m, at 45°.
    mesh
        STL, OBJ or PLY file in m, taken apart into convex parts.
    map
        Map of a floor, see `geometry.load_map`.
    height
        Of a map's walls, m; as its file says if omitted.
    position, rpy
        Where it is: of its middle, m, and roll, pitch, yaw, Rz(y) Ry(p) Rx(r), rad.
    """

    spec_key: ClassVar[str] = "world"
    box: Size | Annotated[list[Size], Meta(min_length=3, max_length=3)] | None = None
    sphere: Size | None = None
    capsule: tuple[Size, Size] | None = None
    cylinder: tuple[Size, Size] | None = None
    plane: Direction | None = None
    container: Annotated[Sequence[Size], Meta(min_length=2, max_length=3)] | None = None
    chamfer: Annotated[float, Meta(gt=0, description="m")] | None = None
    mesh: FileName | None = None
    map: FileName | None = None
    height: Size | None = None
    position: Place = (0.0, 0.0, 0.0)
    rpy: Angles = (0.0, 0.0, 0.0)

    @property
    def kind(self) -> str:
        """Which shape it has.

        Raises
        ------
        ShapeError
            If it has none or several.
        """
        given = [key for key in SHAPES if getattr(self, key) is not None]
        if len(given) != 1:
            raise ShapeError(f"give one shape of {', '.join(SHAPES)}, got {' and '.join(given) or 'none'}")
        if self.height is not None and given != ["map"]:
            raise ShapeError(f"height: is that of a map, and this is a {given[0]}")
        if self.chamfer is not None and (self.container is None or len(self.container) != 2):
            raise ShapeError("chamfer: is that of a round container: [diameter, height]")
        return given[0]

    @property
    def pose(self) -> Array:
        """Where it is, unit dual quaternion (8,)."""
        return algebra.pose(algebra.rotation_from_rpy(self.rpy), self.position)

    @property
    def size(self) -> Array:
        """Edges of a box, shape (3,), m."""
        assert self.box is not None
        return np.full(3, self.box) if isinstance(self.box, float | int) else np.array(self.box)

    @cached_property
    def shapes(self) -> list[Shape]:
        """All that it consists of, in the inertial frame.

        Raises
        ------
        Error
            If it has no shape, or its file cannot be read.
        """
        pose = self.pose
        return [each.moved(pose) for each in self.own_shapes]

    @cached_property
    def own_shapes(self) -> Sequence[Shape]:
        """All that it consists of, as seen from its pose."""
        kind = self.kind
        if kind == "map":
            return _boxes_of_map(str(self.map), self.height, map_version(str(self.map)))
        if kind == "mesh":
            return hulls(str(self.mesh))
        return self._walls() if kind == "container" else [self._convex()]

    def _convex(self) -> Shape:
        if self.sphere is not None:
            return Sphere(np.zeros(3), self.sphere)
        if self.plane is not None:
            return Plane(np.array(self.plane), 0.0)
        if self.box is not None:
            return Box(np.array([1.0, 0, 0, 0, 0, 0, 0, 0]), self.size)
        radius, length = self.capsule or self.cylinder or (0.0, 0.0)
        half = np.array([0.0, 0.0, 0.5 * length])
        return Cylinder(-half, half, radius) if self.cylinder is not None else Capsule(-half, half, radius)

    def _walls(self) -> list[Box]:
        """Return walls and a bottom around the inside of a container."""
        assert self.container is not None
        if len(self.container) == 2:
            return self._staves(*self.container)
        x, y, z = self.container
        sizes = [(_WALL, y + 2 * _WALL, z), (x + 2 * _WALL, _WALL, z)]
        found = []
        for axis, extent in enumerate((x, y)):
            for side in (-1.0, 1.0):
                middle = np.array([0.0, 0.0, 0.5 * z])
                middle[axis] = 0.5 * side * (extent + _WALL)
                found.append(Box(algebra.pose([1, 0, 0, 0], middle), np.array(sizes[axis])))
        found.append(Box(algebra.pose([1, 0, 0, 0], [0, 0, 0.5 * _FLOOR]), np.array([x, y, _FLOOR])))
        return found

    def _staves(self, diameter: float, height: float) -> list[Box]:
        """Return staves and a bottom around the inside of a round container, whose circle they touch."""
        radius, chamfer, turn = 0.5 * diameter, self.chamfer or 0.0, 2 * math.pi / _STAVES
        if chamfer >= min(height, _WALL):
            raise ValueRangeError(
                f"chamfer: must be less than {1e3 * min(height, _WALL):g} mm, got {1e3 * chamfer:g} mm"
            )
        across = 2 * (radius + _WALL) * math.tan(0.5 * turn)
        found = [
            Box(algebra.pose([1, 0, 0, 0], [0, 0, 0.5 * _FLOOR]), np.array([diameter, diameter, _FLOOR]))
        ]
        below = height - chamfer
        # distance from the axis and height of the middle, thickness, height and turn about the rim
        parts = [(radius + 0.5 * _WALL, 0.5 * below, _WALL, below, 0.0)]
        if chamfer:
            deep, outer = 0.5 * chamfer, _WALL - chamfer
            parts.append((radius + chamfer + 0.5 * outer, below + deep, outer, chamfer, 0.0))
            thick = chamfer / math.sqrt(2)  # of what lies behind the slope
            away = 0.5 * thick / math.sqrt(2)
            parts.append(
                (radius + deep + away, below + deep - away, thick, chamfer * math.sqrt(2), 0.25 * math.pi)
            )
        for k in range(_STAVES):
            turned = algebra.pose([math.cos(0.5 * k * turn), 0, 0, math.sin(0.5 * k * turn)], [0, 0, 0])
            for far, high, thick, tall, tilt in parts:
                tilted = [math.cos(0.5 * tilt), 0, math.sin(0.5 * tilt), 0]
                place = algebra.multiply(turned, algebra.pose(tilted, [far, 0, high]))
                found.append(Box(place, np.array([thick, across, tall])))
        return found


@lru_cache(maxsize=32)
def _boxes_of_map(
    file: str, height: float | None, version: tuple[tuple[int, int, int], ...]
) -> tuple[Box, ...]:
    return tuple(load_map(file, height).boxes())


class Motion(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a body moves by itself, whatever touches it.

    Parameters
    ----------
    velocity
        It moves on from its place with that, m/s; or
    path
        by these rows [t, x, y, z] (s, m): shifts from its place, straight between them, resting at both ends.
    speed
        At most this fast it may also come nearer than that, m/s.
    announced
        Whether plans know how it is going to move; where not, it stands for them where it is when they are made.
    """

    spec_key: ClassVar[str] = "world.moves"
    velocity: Annotated[Three, Meta(description="m/s")] | None = None
    path: Annotated[list[tuple[float, float, float, float]], Meta(min_length=2)] | None = None
    speed: Annotated[float, Meta(ge=0, description="m/s")] = 0.0
    announced: bool = True

    def __post_init__(self) -> None:
        if self.velocity is not None and self.path is not None:
            raise ShapeError("moves.path: it has a velocity already; give one of them")
        if self.path is None:
            return
        rows = np.asarray(self.path, np.float64)
        steps = np.diff(rows[:, 0])
        if (steps <= 0).any():
            raise ValueRangeError("moves.path: times must increase")
        speeds = np.linalg.norm(np.diff(rows[:, 1:], axis=0), axis=1) / steps
        if speeds.max() > _FASTEST:
            k = int(speeds.argmax())
            raise ValueRangeError(
                f"moves.path: has a jump: from {rows[k, 0]:g} s to {rows[k + 1, 0]:g} s it moves at "
                f"{speeds[k]:.3g} m/s, at most {_FASTEST:g} m/s"
            )

    def shifts(self, times: Array) -> Array:
        """Return how far it has moved at times (N,), s: shape (N, 3), m."""
        if self.velocity is not None:
            return np.outer(times, self.velocity)
        if self.path is None:
            return np.zeros((len(times), 3))
        rows = np.asarray(self.path, np.float64)
        return np.column_stack([np.interp(times, rows[:, 0], rows[:, i]) for i in (1, 2, 3)])


class Hinge(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An axis about which a body turns.

    Parameters
    ----------
    axis
        In the body's axes.
    at
        A point of it, seen from the body's position in its axes, m.
    range
        Least and most angle, rad; 0 is where the body is at the start. None: it turns on and on.
    damping
        N·m·s/rad.
    friction
        N·m, that a torque has to overcome.
    """

    spec_key: ClassVar[str] = "world.hinge"
    axis: Direction
    at: Place = (0.0, 0.0, 0.0)
    range: Annotated[tuple[float, float], Meta(description="rad")] | None = None
    damping: Annotated[float, Meta(ge=0, description="N·m·s/rad")] = 0.0
    friction: Annotated[float, Meta(ge=0, description="N·m")] = 0.0

    def __post_init__(self) -> None:
        _check_joint(self.axis, self.range, "hinge", "turn about")


class Slide(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An axis along which a body slides.

    Parameters
    ----------
    axis
        In the body's axes.
    range
        Least and most way, m; 0 is where the body is at the start. None: without end.
    damping
        N·s/m.
    friction
        N, that a force has to overcome.
    """

    spec_key: ClassVar[str] = "world.slide"
    axis: Direction
    range: Annotated[tuple[float, float], Meta(description="m")] | None = None
    damping: Annotated[float, Meta(ge=0, description="N·s/m")] = 0.0
    friction: Annotated[float, Meta(ge=0, description="N")] = 0.0

    def __post_init__(self) -> None:
        _check_joint(self.axis, self.range, "slide", "move along")


def _check_joint(axis: Three, limits: tuple[float, float] | None, key: str, does: str) -> None:
    if not any(axis):
        raise ValueRangeError(f"{key}.axis: must not be zero, there is nothing to {does}, got {list(axis)}")
    if (limits is not None and not limits[0] <= 0.0 <= limits[1]) or limits == (0.0, 0.0):
        raise ValueRangeError(
            f"{key}.range: must hold 0, where the body starts, and more, got {list(limits or ())}"
        )


class Watch(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a body that physics moves is measured: by a camera, say.

    Parameters
    ----------
    rate
        Frames a second, Hz.
    delay
        From a frame to its arrival, s.
    position_noise, angle_noise
        Standard deviation of each coordinate of its position, m, and of a turn about each axis, rad, white.
    filter_time
        Time constant of the estimate, s; 0 for none.
    """

    spec_key: ClassVar[str] = "world.watch"
    rate: Annotated[float, Meta(gt=0, le=1e4, description="Hz")] = 30.0
    delay: Annotated[float, Meta(ge=0, le=100, description="s")] = 0.0
    position_noise: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0
    angle_noise: Annotated[float, Meta(ge=0, le=1, description="rad")] = 0.0
    filter_time: Annotated[float, Meta(ge=0, le=100, description="s")] = 0.0

    @property
    def weight(self) -> float:
        """Of a new frame against the estimate so far."""
        return -math.expm1(-1 / (self.rate * self.filter_time)) if self.filter_time else 1.0


class SetDown(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a body stands once it is let go, in the inertial frame.

    Parameters
    ----------
    position, rpy
        m and rad.
    """

    spec_key: ClassVar[str] = "world.held.put"
    position: Place
    rpy: Angles = (0.0, 0.0, 0.0)


class Held(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When and how an end effector holds a body: from then on its shapes are shapes of the robot.

    Parameters
    ----------
    since
        s; before that it stands where it is.
    until
        s; to the end if omitted.
    position, rpy
        Of the body in the end effector's axes, m and rad.
    frame
        Which frame of a tree holds it, ``left`` or ``right`` of two arms.
    put
        Where it is afterwards; nobody knows it if omitted.
    within
        How far it may be from there in the hand when it is gripped, and from ``put`` when it is let go, m.

    Raises
    ------
    ValueRangeError
        If it ends before it begins.
    """

    spec_key: ClassVar[str] = "world.held"
    since: Annotated[float, Meta(ge=0, description="s")] = 0.0
    until: Annotated[float, Meta(gt=0, description="s")] | None = None
    position: Place = (0.0, 0.0, 0.0)
    rpy: Angles = (0.0, 0.0, 0.0)
    frame: Name | None = None
    put: SetDown | None = None
    within: Size = 0.01

    def __post_init__(self) -> None:
        if self.until is not None and self.until <= self.since:
            raise ValueRangeError(f"held.until: must be after since, {self.since:g} s, got {self.until:g} s")
        if self.put is not None and self.until is None:
            raise ShapeError("held.put: it is held to the end; give 'until', when it is let go")

    @property
    def grasp(self) -> Array:
        """Pose of the body in the end effector's axes, unit dual quaternion (8,)."""
        return algebra.pose(algebra.rotation_from_rpy(self.rpy), self.position)

    @property
    def ends(self) -> float:
        """When it is let go, s; infinite if never."""
        return math.inf if self.until is None else self.until


class Body(Solid, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Something in the world: without further keys it stands still.

    Parameters
    ----------
    parts
        Further shapes, each as seen from the pose of this one.
    moves
        How it moves by itself; what touches it does not stop it.
    mass
        kg: physics moves it. Of a body on a hinge or slide too, 1 kg if omitted there.
    friction
        Coulomb's coefficient.
    hinge, slide
        The axis on which physics moves it.
    stiffness, damping
        It gives way by that, N/m and N·s/m, along the face that is pressed, and comes back; also while it moves.
    watch
        How the pose of one that physics moves is measured; nobody knows it if omitted.
    held
        When an end effector holds it, and how; never if omitted.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> table = dqc.world.Body(box=(1.2, 0.8, 0.04), position=(0.6, 0, 0.38))
    >>> table.role
    'fixed'
    """

    parts: Annotated[list[Solid], Meta(max_length=100)] = []
    moves: Motion | None = None
    mass: Annotated[float, Meta(gt=0, le=1e4, description="kg")] | None = None
    friction: Annotated[float, Meta(ge=0, le=10)] = 0.8
    hinge: Hinge | None = None
    slide: Slide | None = None
    stiffness: Annotated[float, Meta(gt=0, description="N/m")] | None = None
    damping: Annotated[float, Meta(ge=0, description="N·s/m")] = 0.0
    watch: Watch | None = None
    held: Held | None = None

    @cached_property
    def role(self) -> str:
        """``fixed``, ``moving`` as it says, ``free``, on a ``hinge`` or ``slide``, or ``springy``, moving or not.

        Raises
        ------
        ShapeError
            If it says two of them.
        """
        said = {
            "moving": self.moves is not None and self.stiffness is None,
            "hinge": self.hinge is not None,
            "slide": self.slide is not None,
            "springy": self.stiffness is not None,
        }
        found = [role for role, given in said.items() if given]
        keys = {"moving": "moves", "springy": "stiffness"}
        if len(found) > 1 or (self.mass is not None and found and found[0] in keys):
            names = [keys.get(role, role) for role in found] + (["mass"] if self.mass is not None else [])
            raise ShapeError(f"a body is moved in one way, got {' and '.join(names)}")
        if self.kind in ("plane", "map") and (found or self.mass is not None) and found != ["moving"]:
            raise ShapeError(f"{self.kind}: stands still, and this is to be {(found or ['free'])[0]}")
        role = found[0] if found else "free" if self.mass is not None else "fixed"
        if self.watch is not None and role not in _BY_PHYSICS:
            raise ShapeError(f"watch: measures where physics moves a body, and this is {role}; take it away")
        if self.held is not None and (role not in ("fixed", "free") or self.kind in ("plane", "map")):
            raise ShapeError(f"held: no hand holds a {self.kind} that is {role}; take it away")
        if self.held is not None and self.watch is not None:
            raise ShapeError("held: says where the body is, and so does 'watch'; give one of them")
        return role

    @property
    def is_floor(self) -> bool:
        """Whether it is the floor z = 0, which a mobile base has anyway."""
        plane = self.shapes[0] if self.plane is not None else None
        return isinstance(plane, Plane) and plane.normal[2] > 1 - 1e-9 and abs(plane.offset) < 1e-9

    @property
    def is_moved_by_physics(self) -> bool:
        """Whether nobody says where it is but a simulation, or what measures it."""
        return self.role in _BY_PHYSICS

    @property
    def is_recorded(self) -> bool:
        """Whether a recording alone says where it was in a run: physics moved it, or a hand held it."""
        return self.is_moved_by_physics or self.held is not None

    @property
    def put_down(self) -> Body | None:
        """It as it stands once a hand has let it go; None if nobody knows where."""
        if self.held is None or self.held.put is None:
            return None
        return msgspec.structs.replace(self, position=self.held.put.position, rpy=self.held.put.rpy)

    def holds(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Return which points, shape (…, 3), m, lie inside a container that stands where it started."""
        return self.away(points) == 0.0

    def away(self, points: ArrayLike) -> Array:
        """Return how far points, shape (…, 3), m, are from the inside of a container, shape (…), m."""
        if self.container is None:
            raise ShapeError(f"a {self.kind} holds nothing; a container does")
        matrix, inside = algebra.matrix_from_pose(self.pose), np.array(self.container)
        seen = (as_array("points", points, (3,)) - matrix[:3, 3]) @ matrix[:3, :3]
        if len(inside) == 2:
            seen = np.stack([np.hypot(seen[..., 0], seen[..., 1]), seen[..., 2]], axis=-1)
        outside = np.abs(seen - np.append(np.zeros(len(inside) - 1), 0.5 * inside[-1])) - 0.5 * inside
        return np.linalg.norm(np.maximum(outside, 0.0), axis=-1)

    @property
    def solids(self) -> list[Solid]:
        """Its own shape and its further ones, as seen from its pose."""
        own = {key: getattr(self, key) for key in (*SHAPES, "height", "chamfer")}
        return [Solid(**own), *self.parts]

    @cached_property
    def own_shapes(self) -> Sequence[Shape]:
        """All that it consists of, as seen from its pose."""
        found = [*Solid.own_shapes.func(self)]
        for k, part in enumerate(self.parts):
            with error_prefix(f"parts[{k}]"):
                found += part.shapes
        return found


def poses_of(name: str, body: Body, times: Array, readings: Mapping[str, Array]) -> Array:
    """Return a body's poses at times (N,), s: unit dual quaternions, shape (N, 8), inertial frame.

    Parameters
    ----------
    name, body
        Of the world.
    times
        s.
    readings
        What was recorded of it, by name, each (N, size); what physics did not move is where it was at the start.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> ball = dqc.world.Body(sphere=0.1, position=(1, 0, 0), moves=dqc.world.Motion(velocity=(0, 0.5, 0)))
    >>> dqc.algebra.translation(poses_of("ball", ball, np.array([0.0, 2.0]), {})).tolist()
    [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    """
    if (body.role == "free" or body.held is not None) and f"{name}_position" in readings:
        return algebra.pose(readings[f"{name}_quaternion"], readings[f"{name}_position"])
    start = np.tile(body.pose, (len(times), 1))
    if body.hinge is not None and f"{name}_angle" in readings:
        return algebra.multiply(start, turned(body.hinge, readings[f"{name}_angle"].reshape(-1)))
    if body.slide is not None and f"{name}_way" in readings:
        return algebra.multiply(start, slid(body.slide, readings[f"{name}_way"].reshape(-1)))
    if body.moves is not None:
        start = algebra.multiply(_shifts(body.moves.shifts(times)), start)
    if f"{name}_displacement" in readings:
        start = algebra.multiply(start, _shifts(readings[f"{name}_displacement"]))
    return start


def turned(hinge: Hinge, angles: Array) -> Array:
    """Return how a body is turned by angles (N,), rad, of its hinge, seen from its start, shape (N, 8)."""
    axis = np.tile(np.asarray(hinge.axis) / np.linalg.norm(hinge.axis), (len(angles), 1))
    there = _shifts(np.tile(hinge.at, (len(angles), 1)))
    turns = algebra.pose(algebra.rotation_from_axis_angle(axis, angles), np.zeros(3))
    return algebra.multiply(algebra.multiply(there, turns), algebra.conjugate(there))


def slid(slide: Slide, ways: Array) -> Array:
    """Return how a body is shifted by ways (N,), m, of its slide, seen from its start, shape (N, 8)."""
    return _shifts(np.outer(ways, np.asarray(slide.axis) / np.linalg.norm(slide.axis)))


def _shifts(ways: Array) -> Array:
    return algebra.pose(np.array([1.0, 0, 0, 0]), ways)
