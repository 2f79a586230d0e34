"""The world in MuJoCo: its bodies as they stand, move and give way, what links touch it with, and what is felt."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, error_prefix
from dqcontrol.geometry import Box, Capsule, Cylinder, Plane, Shape, Sphere
from dqcontrol.plants.mujoco.gripper import BODIES, GRIP_FORCE, PADS, Gripper, fingers
from dqcontrol.plants.mujoco.mujoco_model import add_geom
from dqcontrol.plants.mujoco.wrist_sensor import TOOL
from dqcontrol.plants.plant import Channel, begun_periods
from dqcontrol.plants.sensors import AXES
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.link_shapes import LinkShape
from dqcontrol.robots.robot import Robot
from dqcontrol.world import Body, World
from dqcontrol.world.mesh import convex_parts
from dqcontrol.world.world import FLOOR

_SNAP = 1e-9  # periods; frames that are nearer to a sample than that are of it


class _Eye:
    """What watches one body: frames at equal times, each shown at the first sample at or after it."""

    def __init__(self, name: str, body: Body, place: Any, period: float, rng: np.random.Generator) -> None:
        assert body.watch is not None
        self.name, self._watch, self._place, self._rng = name, body.watch, place, rng
        with error_prefix(f"world.{name}.watch"):
            self._delay, _ = begun_periods("delay", body.watch.delay, period)
        self._per_period = body.watch.rate * period
        self._weight = body.watch.weight
        self.pose: Array = body.pose.copy()
        self._shown: deque[Array] = deque(maxlen=self._delay + 1)
        self._k = -1

    def look(self) -> None:
        self._k += 1
        self._shown.append(algebra.pose(self._place.xquat, self._place.xpos))
        shown = self._k - self._delay
        if shown <= 0:
            return  # the first frame is exact: where the world says that it is
        frame, before = (math.floor(k * self._per_period + _SNAP) for k in (shown, shown - 1))
        if frame > before:
            self.pose[:] = algebra.sclerp(self.pose, self._noisy(self._shown[0]), self._weight)

    def _noisy(self, pose: Array) -> Array:
        turn = 0.5 * self._watch.angle_noise * self._rng.standard_normal(3)
        shift = self._watch.position_noise * self._rng.standard_normal(3)
        rotation = algebra.exp_body(np.concatenate([turn, np.zeros(3)]))[:4]
        turned = algebra.multiply(algebra.pose(rotation, np.zeros(3)), algebra.pose(pose[:4], np.zeros(3)))
        return algebra.pose(turned[:4], algebra.translation(pose) + shift)


FORCE, DEPTH, LINK = "contact_force", "penetration", "contact_link"
ITSELF = "itself"
OTHER = "other"  # of two links that touch each other, the second

CHASSIS, GROUND = "chassis", "ground"  # geoms of a mobile base and of the floor that it stands on
_SOLREF = 4.0  # time steps in which a contact comes to rest, as stiff as these allow
_PLATE = 0.2  # kg of what hangs on a stiffness: it gives way to 0.2 % of N/m (docs/world.md)
_STEADY = 2.0 / 3.0  # of √(m/K): longer time steps let such a plate ring
_DEEP = 1e-4  # m that a start may be in something by rounding of robots' files
_COLOURS = {
    "fixed": (0.62, 0.47, 0.33, 1.0),
    "moving": (0.55, 0.35, 0.65, 1.0),
    "free": (0.90, 0.20, 0.15, 1.0),
    "hinge": (0.20, 0.45, 0.70, 1.0),
    "slide": (0.20, 0.45, 0.70, 1.0),
    "springy": (0.35, 0.60, 0.45, 1.0),
}


def add_links(
    spec: Any,
    robot: Robot,
    timestep: float,
    hand: str = "",
    *,
    padded: bool = False,
    gripper: Gripper | None = None,
    base: int = 0,
) -> None:
    """Give the links of a `skeleton` their collision shapes, and let those touch that the robot's file keeps apart.

    Parameters
    ----------
    spec, robot
        ``mjSpec`` and whose it is.
    timestep
        s; contacts are as stiff as it allows.
    hand
        Body at the tool's pose that has the last link's shapes in the link's place; none if empty.
    padded
        Whether end effectors touch bodies with their pads instead of the shapes of their links.
    gripper
        Of each end effector, whose links' shapes end where its fingers begin.
    base
        Coordinates of the base that carries the skeleton, whose chassis is there already.

    Raises
    ------
    ValueRangeError
        If the robot has no shapes.
    """
    if robot.shapes is None or all(each.frame <= base for each in robot.shapes.shapes):
        raise ValueRangeError(
            f"world: {robot.name} has no shapes to touch it with; give it some ('dqcontrol robots shapes' fits them)"
        )
    shapes, last = robot.shapes.shapes, robot.configuration_size
    ends = {int(robot.parents[row]) + 1: row for row in robot.ends}
    for each in shapes:
        if base and each.frame <= base:
            continue
        body, shape = spec.body(f"link_{each.frame - base}") if each.frame else spec.worldbody, each.shape
        if hand and each.frame == last:
            tool = algebra.pose(robot.chain[-1, :4], robot.chain[-1, 4:7])
            body, shape = spec.body(hand), each.shape.moved(algebra.conjugate(tool))
        bare = padded and each.frame in ends
        if gripper is not None and each.frame in ends:
            shape = gripper.behind_fingers(shape, robot.chain[ends[each.frame]])
        geom = _add_geom(body, shape)
        geom.name, geom.group = _link_name(each.name), 3  # drawn where links have no meshes
        geom.conaffinity, geom.friction = 0 if bare else BODIES, [0.0, 0.0, 0.0]
        geom.solref[:2] = _SOLREF * timestep, 1.0
    for a, b in robot.shapes.pairs:
        first, second = (_geom_of_link(shapes[k], base) for k in (a, b))
        pair = spec.add_pair(geomname1=first, geomname2=second)
        pair.solref[:2] = _SOLREF * timestep, 1.0


def add_world(spec: Any, bodies: Mapping[str, Body], timestep: float) -> None:
    """Add bodies of a world, by name, to an ``mjSpec``, after whatever it holds.

    Raises
    ------
    ValueRangeError
        If the time step is too long for a stiffness.
    """
    mujoco, meshes = import_mujoco(), count(1)
    for name, body in bodies.items():
        role, is_fixed = body.role, body.role in ("fixed", "moving")
        if body.held is not None and role != "free":
            raise ValueRangeError(
                f"world.{name}.held: physics moves what hands hold by its mass; give it one"
            )
        place = spec.worldbody.add_body(name=_body_name(name), pos=body.position)
        place.quat, place.mocap = algebra.rotation(body.pose), body.moves is not None
        joint = body.hinge or body.slide
        if role == "free":
            place.add_freejoint(name=_body_name(name))
        elif joint is not None:
            kind = mujoco.mjtJoint.mjJNT_HINGE if body.hinge else mujoco.mjtJoint.mjJNT_SLIDE
            added = place.add_joint(name=_body_name(name), type=kind, axis=joint.axis)
            added.pos = body.hinge.at if body.hinge else np.zeros(3)
            added.frictionloss, added.damping = joint.friction, _triple(added.damping, joint.damping)
            if joint.range is not None:
                added.range, added.limited = joint.range, mujoco.mjtLimited.mjLIMITED_TRUE
                added.solref_limit = (_SOLREF * timestep, 1.0)
        elif body.stiffness is not None:
            if body.moves is not None:  # what moves as it says carries what gives way
                place = place.add_body(name=_geoms_of(name, body))
            _hang(mujoco, place, name, body, timestep)
        is_still = is_fixed or role == "free" or body.moves is not None
        if not is_still and hasattr(mujoco, "mjtSleepPolicy"):  # what is on its way, however slowly, moves on
            place.sleep = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
        geoms = list(_solid_geoms(spec, place, body, meshes))
        mass = body.mass or (_PLATE if role == "springy" else 1.0)
        volume = sum(each for _, each in geoms) or 1.0
        for geom, share in geoms:
            geom.mass = 0.0 if is_fixed else mass * share / volume
            geom.rgba, geom.contype, geom.conaffinity = _COLOURS[role], BODIES, BODIES
            across = 0.0 if is_fixed else 0.1 * _width(body) * body.friction  # of turning on a face, m
            geom.friction, geom.condim = [body.friction, across, 0.0], 3 if is_fixed else 4
            geom.solref[:2] = (2.0 if role == "springy" else _SOLREF) * timestep, 1.0
            if role == "springy":
                geom.solimp[:3] = 0.99, 0.999, 1e-4


def _width(body: Body) -> float:
    """Return the least size of a body, m."""
    if body.box is not None:
        return float(body.size.min())
    radius = body.sphere or (body.capsule or body.cylinder or (0.0,))[0]
    return 2 * radius or (min(body.container) if body.container else 0.02)


def _triple(like: Any, value: float) -> Any:
    """Return a joint's damping as this MuJoCo has it: a number, or a polynomial's coefficients."""
    return value if np.ndim(like) == 0 else [value, *([0.0] * (np.size(like) - 1))]


def _hang(mujoco: Any, place: Any, name: str, body: Body, timestep: float) -> None:
    """Let a body slide along its axes on springs; gravity does not move it."""
    assert body.stiffness is not None
    longest = _STEADY * math.sqrt(_PLATE / body.stiffness)
    if timestep > longest:
        raise ValueRangeError(
            f"world.{name}.stiffness: {body.stiffness:g} N/m needs a 'plant.timestep' of at most "
            f"{1000 * longest:.2g} ms, got {1000 * timestep:g} ms"
        )
    place.gravcomp = 1.0
    for axis, unit in zip("xyz", np.eye(3), strict=True):
        kind = mujoco.mjtJoint.mjJNT_SLIDE
        joint = place.add_joint(name=f"{_body_name(name)} {axis}", type=kind, axis=unit)
        joint.stiffness = _triple(joint.stiffness, body.stiffness)
        joint.damping = _triple(joint.damping, body.damping)


def _solid_geoms(spec: Any, place: Any, body: Body, meshes: Any) -> Any:
    """Add the geoms of a body; yield each with its volume, m³."""
    for solid in body.solids:
        if solid.kind != "mesh":
            for shape in solid.shapes:
                yield _add_geom(place, shape), _volume(shape)
            continue
        for part in convex_parts(str(solid.mesh)):
            name = f"mesh {next(meshes)}"
            spec.add_mesh(name=name, uservert=np.asarray(part.vertices).ravel())
            pose = {"pos": solid.position, "quat": algebra.rotation(solid.pose)}
            yield add_geom(place, "MESH", [], meshname=name, **pose), float(part.volume)


def _add_geom(body: Any, shape: Shape) -> Any:
    if isinstance(shape, Sphere):
        return add_geom(body, "SPHERE", [shape.radius], pos=shape.center)
    if isinstance(shape, Capsule | Cylinder):
        if np.linalg.norm(shape.end - shape.start) < 1e-9:  # a capsule that is a ball
            return add_geom(body, "SPHERE", [shape.radius], pos=shape.start)
        kind = "CAPSULE" if isinstance(shape, Capsule) else "CYLINDER"
        return add_geom(body, kind, [shape.radius], fromto=[*shape.start, *shape.end])
    if isinstance(shape, Box):
        middle, quaternion = algebra.translation(shape.pose), algebra.rotation(shape.pose)
        return add_geom(body, "BOX", 0.5 * shape.size, pos=middle, quat=quaternion)
    assert isinstance(shape, Plane)
    at, quaternion = shape.offset * shape.normal, algebra.rotation_from_matrix(shape.axes)
    return add_geom(body, "PLANE", [0, 0, 1], pos=at, quat=quaternion)


def _volume(shape: Shape) -> float:
    if isinstance(shape, Sphere):
        return 4 / 3 * math.pi * shape.radius**3
    if isinstance(shape, Capsule):
        return shape.volume
    if isinstance(shape, Cylinder):
        return math.pi * shape.radius**2 * float(np.linalg.norm(shape.end - shape.start))
    return float(np.prod(shape.size)) if isinstance(shape, Box) else 0.0


def _link_name(name: str) -> str:
    return f"link: {name}"


def _geom_of_link(shape: LinkShape, base: int) -> str:
    """Return the geom that has a link's shape; those of a mobile base are its chassis."""
    return CHASSIS if base and shape.frame <= base else _link_name(shape.name)


def _body_name(name: str) -> str:
    """Return what a body is called in MuJoCo, where parts of the robot have names too."""
    return f"world: {name}"


def _geoms_of(name: str, body: Body) -> str:
    """Return which body in MuJoCo has its geoms."""
    return f"{_body_name(name)} pad" if body.moves and body.role == "springy" else _body_name(name)


def _pose_channels(name: str) -> Iterator[Channel]:
    yield Channel(f"{name}_position", AXES, "m")
    yield Channel(f"{name}_quaternion", ("w", *AXES), "")


class WorldBodies:
    """The bodies of a world at work in MuJoCo: those that move as they say, and where physics moves the others.

    Attributes
    ----------
    channels
        What is recorded of them.
    moves
        Whether a body moves as it says.
    seen
        By name where watched bodies are measured, poses (8,), updated in place at each sample.
    """

    def __init__(self, bodies: Mapping[str, Body], model: Any, data: Any, period: float, seed: int) -> None:
        self._data = data
        watched = {name: body for name, body in bodies.items() if body.watch is not None}
        self._eyes = [
            _Eye(name, body, data.body(_body_name(name)), period, np.random.default_rng([seed, 5, k]))
            for k, (name, body) in enumerate(watched.items())
        ]
        self.seen: dict[str, Array] = {eye.name: eye.pose for eye in self._eyes}
        of_watched = [channel for name in watched for channel in _pose_channels(f"{name}_seen")]
        self.channels: tuple[Channel, ...] = (*body_channels(bodies), *of_watched)
        self.size: int = sum(channel.size for channel in self.channels)
        moving = [(name, body) for name, body in bodies.items() if body.moves is not None]
        self._moving = [(int(model.body(_body_name(name)).mocapid[0]), body) for name, body in moving]
        self.moves: bool = bool(self._moving)
        self._at = _coordinates_at(bodies, model)

    def place(self, time: float) -> None:
        """Put the bodies that move as they say where they are at a time, s."""
        for row, body in self._moving:
            assert body.moves is not None
            self._data.mocap_pos[row] = body.position + body.moves.shifts(np.array([time]))[0]

    def advance(self, step: Any, model: Any, substeps: int) -> None:
        """Take so many time steps."""
        if not self.moves:
            step(model, self._data, substeps)
            return
        for _ in range(substeps):
            self.place(self._data.time + model.opt.timestep)
            step(model, self._data, 1)

    def read(self, out: Array) -> None:
        """Write the readings, shape (size,)."""
        moved = len(self._at)
        out[:moved] = self._data.qpos[self._at]
        for eye, row in zip(self._eyes, out[moved:].reshape(-1, 7), strict=True):
            eye.look()
            row[:3], row[3:] = algebra.translation(eye.pose), eye.pose[:4]


def body_channels(bodies: Mapping[str, Body]) -> Iterator[Channel]:
    """Yield what is recorded of the bodies that physics moves."""
    for name, body in bodies.items():
        if body.role == "free":
            yield from _pose_channels(name)
        elif body.role == "springy":
            yield Channel(f"{name}_displacement", AXES, "m")
        elif body.is_moved_by_physics:
            what, unit = ("angle", "rad") if body.hinge else ("way", "m")
            yield Channel(f"{name}_{what}", (), unit)


def _joints_of(name: str, body: Body) -> list[tuple[str, int]]:
    """Return the joints of a body in MuJoCo, each with how many coordinates it has."""
    if body.role == "springy":
        return [(f"{_body_name(name)} {axis}", 1) for axis in "xyz"]
    return [(_body_name(name), 7 if body.role == "free" else 1)] if body.is_moved_by_physics else []


def _coordinates_at(bodies: Mapping[str, Body], model: Any) -> NDArray[np.intp]:
    """Return where MuJoCo's coordinates of the bodies that physics moves are, in the order of `body_channels`."""
    joints = [joint for name, body in bodies.items() for joint in _joints_of(name, body)]
    at = [int(model.joint(name).qposadr[0]) + k for name, size in joints for k in range(size)]
    return np.array(at, dtype=np.intp)


def write_coordinates(
    bodies: Mapping[str, Body], model: Any, readings: Mapping[str, Array], out: Array
) -> None:
    """Write MuJoCo's coordinates (N, nq) of bodies that physics moves, from what was recorded of them."""
    recorded = [readings[channel.name] for channel in body_channels(bodies)]
    if recorded:
        out[:, _coordinates_at(bodies, model)] = np.hstack([each.reshape(len(out), -1) for each in recorded])


class WorldContacts:
    """What links touch, how hard and how deep, and the bodies of the world.

    Parameters
    ----------
    world, robot, model, data
        What stands around whom, and both in MuJoCo: of a mobile robot the floor is the ground that is there anyway.
    period, seed
        Of the run, s.

    Attributes
    ----------
    bodies
        Of the world.
    channels, readings
        Of contacts and bodies.
    """

    def __init__(self, world: World, robot: Robot, model: Any, data: Any, period: float, seed: int) -> None:
        mujoco = import_mujoco()
        shapes = () if robot.shapes is None else robot.shapes.shapes
        names = [model.geom(i).name for i in range(model.ngeom)]
        grounded = GROUND in names
        bodies = {name: body for name, body in world.bodies.items() if not (grounded and body.is_floor)}
        self.bodies: WorldBodies = WorldBodies(bodies, model, data, period, seed)
        self._model, self._data, self._force = model, data, mujoco.mj_contactForce
        self._names, self._links = list(bodies), (*(each.link for each in shapes), CHASSIS)
        number = {model.body(_geoms_of(name, body)).id: i for i, (name, body) in enumerate(bodies.items())}
        # of each geom
        self._body_of: NDArray[np.intp] = np.array([number.get(int(each), -1) for each in model.geom_bodyid])
        if grounded:
            self._body_of[names.index(GROUND)] = len(self._names)
            self._names.append(FLOOR)
        links = {names.index(CHASSIS): len(shapes)} if CHASSIS in names else {}
        for i, each in enumerate(shapes):
            link = _link_name(each.name)
            links[names.index(link if link in names else CHASSIS)] = i
        self._pads = [names.index(name) for name in PADS if name in names]
        for k, row in enumerate(robot.ends):  # what an end effector has counts as the link that carries it
            carrier = int(robot.parents[row]) + 1
            last = max((i for i, each in enumerate(shapes) if each.frame == carrier), default=0)
            own = (*fingers(k), *PADS[k : k + 1], TOOL)
            links |= {names.index(name): last for name in own if name in names}
        self._link_of: NDArray[np.intp] = np.array([links.get(i, -1) for i in range(model.ngeom)])
        self._wrench = np.zeros(6)
        parts = (*self._names, ITSELF)
        self.channels: tuple[Channel, ...] = (
            Channel(FORCE, parts, "N"),
            Channel(DEPTH, parts, "m"),
            Channel(LINK, (*parts, OTHER), ""),
            *self.bodies.channels,
            *([Channel(GRIP_FORCE, ("first", "second"), "N")] if self._pads else []),
        )
        self.readings: Array = np.zeros(sum(channel.size for channel in self.channels))

    def read(self) -> None:
        """Update the readings."""
        out, parts = self.readings, len(self._names) + 1
        force, depth, link = out[:parts], out[parts : 2 * parts], out[2 * parts : 3 * parts + 1]
        rest = out[3 * parts + 1 :]
        force[:], depth[:], link[:] = 0.0, 0.0, -1.0
        hardest = np.full(parts, -1.0)
        grip = rest[self.bodies.size :]
        grip[:] = 0.0
        for thing, which, deep, pressed, (geom, touched) in self.contacts():
            if geom in self._pads:
                grip[self._pads.index(geom)] += pressed
            force[thing] += pressed
            depth[thing] = max(depth[thing], deep)
            if pressed > hardest[thing]:
                hardest[thing], link[thing] = pressed, which
                if thing == parts - 1:
                    link[parts] = self._link_of[touched]
        self.bodies.read(rest[: self.bodies.size])

    def contacts(self) -> list[tuple[int, int, float, float, tuple[int, int]]]:
        """Return of each contact of a link the body, the link, depth (m), normal force (N) and geoms, its own first."""
        if not self._data.ncon:
            return []
        pairs, apart, found = self._data.contact.geom, self._data.contact.dist, []
        for i in np.flatnonzero((self._link_of[pairs] >= 0).any(axis=1)):
            a, b = pairs[i] if self._link_of[pairs[i, 0]] >= 0 else pairs[i, ::-1]
            thing = len(self._names) if self._link_of[b] >= 0 else int(self._body_of[b])
            self._force(self._model, self._data, int(i), self._wrench)
            deep, force = max(-float(apart[i]), 0.0), float(self._wrench[0])
            found.append((thing, int(self._link_of[a]), deep, force, (int(a), int(b))))
        return found

    def check_start(self) -> None:
        """Raise if a link starts in a body, or in another link.

        Raises
        ------
        ValueRangeError
            With the worst: which link, how deep, in what.
        """
        none = 0, 0, 0.0, 0.0, (0, 0)
        thing, link, depth, _, (_, other) = max(self.contacts(), key=lambda each: each[2], default=none)
        if depth > _DEEP:
            what = self._names[thing] if thing < len(self._names) else self._links[self._link_of[other]]
            raise ValueRangeError(
                f"start: {self._links[link]} is {1000 * depth:.3g} mm deep in {what}; start elsewhere, or move that"
            )
