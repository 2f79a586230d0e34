"""Pictures of a run at some of its samples, by MuJoCo without a window."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import matrix_from_pose, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.figures.paths import desired_in_room, recorded_frames, tip_paths
from dqcontrol.figures.robot_bodies import arm_meshes, chain_rows, smoothed, wheel_angles
from dqcontrol.films import drawn_scene
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.held import apart_at_plans, plans_of_run
from dqcontrol.plants.mobile.wheeled_base import WHEELS
from dqcontrol.plants.mujoco.mujoco_model import RODS, compiled, skeleton, skeleton_positions
from dqcontrol.robots.files.description import drawn_reach
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import base_coordinates

if TYPE_CHECKING:
    from dqcontrol.constraints.constraint_view import ConstraintView
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import PhysicsPicture
    from dqcontrol.robots.robot import Robot


_FLAT = 1e-9  # m²; MuJoCo refuses meshes without area


class LinkMesh(NamedTuple):
    """A mesh that moves with row ``row`` of `Robot.frames`, −1 for one that stands still, and its colour 0 … 1."""

    row: int
    vertices: Array
    faces: NDArray[np.int64]
    colour: tuple[float, float, float, float]


def link_meshes(robot: Robot) -> list[LinkMesh]:
    """Return the meshes of a robot's files, as the browser view shows them; none without files or trimesh."""
    if importlib.util.find_spec("trimesh") is None:
        return []
    return [
        LinkMesh(row, *smoothed(mesh), (red / 255, green / 255, blue / 255, 1.0))
        for _, meshes in arm_meshes(robot)
        for row, mesh, (red, green, blue) in meshes
        if mesh.area >= _FLAT and len(mesh.vertices) >= 4
    ]


def add_meshes(spec: Any, robot: Robot, meshes: list[LinkMesh]) -> None:
    """Draw meshes on the bodies of an ``mjSpec`` of a robot, and hide the rods of the arms that they show."""
    mujoco, bases = import_mujoco(), int(base_coordinates(robot).sum())
    fixed = spec.body("base") if bases else spec.worldbody
    for i, (row, vertices, faces, colour) in enumerate(meshes):
        mesh = spec.add_mesh(name=f"mesh_{i + 1}", uservert=vertices.ravel(), userface=faces.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # many are not closed
        body = spec.body(f"link_{row - bases + 1}") if row >= bases else fixed
        geom = body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, rgba=colour, mass=0)
        geom.contype = geom.conaffinity = 0
    rows = {mesh.row for mesh in meshes}
    for own in chain_rows(robot):
        if rows.isdisjoint(own):
            continue
        shown = [spec.body(f"link_{row - bases + 1}") for row in own]
        if own.start == bases:
            shown.append(fixed)
        for geom in (geom for body in shown for geom in body.geoms if geom.group == RODS):
            geom.rgba = (*geom.rgba[:3], 0.0)  # which is not drawn


def mesh_corners(robot: Robot, q: Array, meshes: list[LinkMesh]) -> Array:
    """Return the corners of the meshes' boxes at configurations (N, n), rad or m, shape (M, 3), m."""
    frames, points = robot.frames(q), [np.zeros((0, 3))]
    for row in sorted({mesh.row for mesh in meshes}):
        vertices = np.vstack([mesh.vertices for mesh in meshes if mesh.row == row])
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        if row < 0:
            points.append(corners)
            continue
        places = matrix_from_pose(frames[..., row, :]).reshape(-1, 4, 4)
        moved = places[:, None, :3, :3] @ corners[..., None]
        points.append((moved[..., 0] + places[:, None, :3, 3]).reshape(-1, 3))
    return np.vstack(points)


@dataclass(frozen=True)
class Framing:
    """Where to look, and how large everything is.

    Attributes
    ----------
    reach
        Length of the arm, m.
    floor
        Height of the floor, m.
    stands
        Whether what stands on the floor is drawn; otherwise a pedestal leads up to an arm above it.
    middle
        Where to look at, shape (3,), m.
    distance
        From where, m.
    """

    reach: float
    floor: float
    middle: Array
    distance: float
    stands: bool = False


def some_samples(record: Record, most: int) -> NDArray[np.int_]:
    """Return at most so many samples of a record, equally far apart, the first and the last among them."""
    return np.linspace(0, len(record.q) - 1, min(len(record.q), most)).astype(int)


def framing_of_arm(robot: Robot, q: Array, points: Array, meshes: list[LinkMesh]) -> Framing:
    """Return the room of an arm at configurations (N, n), rad or m, and of points (M, 3), m."""
    reach = drawn_reach(robot)
    corners = mesh_corners(robot, q, meshes)
    everything = np.vstack([points, translation(robot.frames(q).reshape(-1, 8)), corners, [np.zeros(3)]])
    lower, upper = everything.min(axis=0), everything.max(axis=0)
    if meshes:  # down to the feet
        floor = min(0.0, float(lower[2]))
    else:
        floor = min(0.0, lower[2] - 0.06 * reach) if lower[2] < -0.01 * reach else 0.0
    distance = 1.45 * float(np.linalg.norm(upper - lower)) + 0.2 * reach
    stands = bool(len(corners)) and bool(corners[:, 2].min() < floor + 0.01 * reach)
    return Framing(reach, floor, 0.5 * (lower + upper), distance, stands)


def add_scene_background(
    mujoco: Any, spec: Any, framing: Framing, azimuth: float, size: tuple[int, int]
) -> None:
    """Add a chequered floor, three lights and a pale sky to a model that is to be drawn.

    Parameters
    ----------
    mujoco
        The package.
    spec
        ``mjSpec`` of the model.
    framing
        Its reach, with which everything scales, the height of the floor, and whether a pedestal leads up from there.
    azimuth
        Direction of view, degrees; the lights follow the viewer.
    size
        Width and height of the picture, pixels.
    """
    reach, floor = framing.reach, framing.floor
    textures, made = mujoco.mjtTexture, mujoco.mjtBuiltin
    sky = spec.add_texture(name="sky", type=textures.mjTEXTURE_SKYBOX, builtin=made.mjBUILTIN_GRADIENT)
    sky.rgb1, sky.rgb2, sky.width, sky.height = (0.97, 0.98, 1.0), (0.72, 0.79, 0.87), 512, 3072
    tiles = spec.add_texture(name="tiles", type=textures.mjTEXTURE_2D, builtin=made.mjBUILTIN_CHECKER)
    tiles.rgb1, tiles.rgb2, tiles.width, tiles.height = (0.80, 0.82, 0.85), (0.70, 0.73, 0.77), 512, 512
    material = spec.add_material(name="floor", texrepeat=(8, 8), texuniform=False)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    side = 3.0 * reach
    untouched = {"contype": 0, "conaffinity": 0}
    plane, post = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_CYLINDER
    size_of = {"pos": [0, 0, floor], "size": [side, side, 0.1]}
    spec.worldbody.add_geom(name="floor", type=plane, material="floor", **size_of, **untouched)
    if floor < 0 and not framing.stands:
        size_of = {"fromto": [0, 0, floor, 0, 0, 0], "size": [0.06 * reach, 0, 0]}
        spec.worldbody.add_geom(type=post, rgba=(0.25, 0.27, 0.30, 1.0), **size_of, **untouched)
    if hasattr(mujoco, "mjtLightType"):
        directional = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL}
    else:  # early MuJoCo 3.3
        directional = {"directional": True}
    for beside, up, strength, shadow in ((-25, 1.5, 0.5, True), (70, 1.0, 0.22, False)):
        towards = math.radians(azimuth + 180 + beside)
        spot = reach * np.array([math.cos(towards), math.sin(towards), up])
        spec.worldbody.add_light(
            pos=spot,
            dir=-spot / np.linalg.norm(spot),
            **directional,
            castshadow=shadow,
            diffuse=[strength] * 3,
            specular=[0.25] * 3,
        )
    spec.visual.headlight.ambient = [0.38] * 3
    spec.visual.headlight.diffuse = [0.28] * 3
    spec.visual.headlight.specular = [0.05] * 3
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.global_.fovy = 38
    # Facets of coarse cylinders cast shadows onto themselves.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 64, 16
    spec.visual.quality.shadowsize = 8192
    spec.visual.quality.offsamples = 4
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 50
    spec.stat.extent, spec.stat.center = reach, (0, 0, 0.4 * reach)


Pixels = NDArray[np.uint8]

# Less than for single pictures, as there are many. At 720p without a graphics card a frame takes 0.075 s of processor
# time: 0.045 s for the shadow, half of that for the pieces of paths in it, the rest for pixels.
_SHADOWS, _SLICES, _STACKS = 1024, 24, 4
_OF_BALLS = 10  # stacks; with fewer balls are no longer round, and they cost a frame a quarter more
_GHOST, _BEHIND = 0.4, 3e-3  # opacity of further runs, and how far they stay behind the first in its place, m
_SMOOTHED = 500_000  # pixels; the edges of larger frames are not smoothed


@dataclass(frozen=True)
class Film:
    """What a camera needs of a run.

    Attributes
    ----------
    spec
        ``mjSpec`` of all that moves, without floor and light.
    framing
        Where to look.
    configurations
        Gives MuJoCo's coordinates at each sample, shape (N, nq), for the compiled model.
    azimuth, elevation
        Direction of view unless another is asked for, degrees.
    decorate
        Adds to MuJoCo's scene what belongs to sample k.
    decorations
        How many shapes that are at most.
    is_overlaid
        Whether one picture shows the whole run, earlier configurations through the last.
    further
        Give the coordinates of further runs, which show through the first.
    has_balls
        Whether balls are to look round.
    """

    spec: Any
    framing: Framing
    configurations: Callable[[Any], NDArray[np.float64]]
    azimuth: float
    elevation: float
    decorate: Callable[[Any, int], None] = lambda scene, k: None
    decorations: int = 0
    is_overlaid: bool = True
    further: Sequence[Callable[[Any], NDArray[np.float64]]] = ()
    has_balls: bool = False


def frames(
    film: Film,
    samples: NDArray[np.int_],
    width: int,
    height: int,
    azimuth: float | None = None,
    elevation: float | None = None,
) -> Iterator[Pixels]:
    """Give the pictures of some samples one after the other, shapes (height, width, 3).

    Parameters
    ----------
    film
        What to draw.
    samples
        A row for each picture: a sample of the run, and one of each further run.
    width, height
        Pixels.
    azimuth, elevation
        Direction of view in place of the film's, degrees.

    Raises
    ------
    MissingExtraError
        If mujoco is not installed, or this machine has no OpenGL.
    """
    mujoco = import_mujoco()
    framing, towards = film.framing, film.azimuth if azimuth is None else azimuth
    add_scene_background(mujoco, film.spec, framing, towards, (width, height))
    quality = film.spec.visual.quality
    quality.shadowsize, quality.numslices = _SHADOWS, _SLICES
    quality.numstacks = _OF_BALLS if film.has_balls else _STACKS
    if width * height > _SMOOTHED:
        quality.offsamples = 0
    model = compiled(film.spec)
    data = mujoco.MjData(model)
    configurations = film.configurations(model)
    ghosts = [(mujoco.MjData(model), coordinates(model)) for coordinates in film.further]
    scene = mujoco.MjvScene(model, maxgeom=(2 + len(ghosts)) * model.ngeom + 100 + film.decorations)
    options, nobody = mujoco.MjvOption(), mujoco.MjvPerturb()
    options.geomgroup[4] = 0
    camera = camera_at(framing, towards, film.elevation if elevation is None else elevation)
    everything, away = mujoco.mjtCatBit.mjCAT_ALL.value, _BEHIND * _direction(camera)
    with drawn_scene.offscreen(width, height), drawn_scene.renderer(model, width, height) as draw:
        for k, *others in samples:
            data.qpos[:] = configurations[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            mujoco.mjv_updateScene(model, data, options, nobody, camera, everything, scene)
            for i, ((ghost, places), j) in enumerate(zip(ghosts, others, strict=True)):
                ghost.qpos[:] = places[j]
                mujoco.mj_kinematics(model, ghost)
                drawn_scene.add_ghost(
                    model, ghost, scene, _GHOST, drawn_scene.COLOURS[i % len(drawn_scene.COLOURS)], away
                )
            film.decorate(scene, int(k))
            yield draw(scene)


def camera_at(framing: Framing, azimuth: float, elevation: float) -> Any:
    """Return MuJoCo's camera where a framing and a direction of view, degrees, put it."""
    camera = import_mujoco().MjvCamera()
    camera.lookat[:], camera.distance = framing.middle, framing.distance
    camera.azimuth, camera.elevation = azimuth, elevation
    return camera


def _direction(camera: Any) -> NDArray[np.float64]:
    """Return where a camera looks."""
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


_POSTURES = 50  # looked at to find the room of an arm
_PIECES = 150  # of a path, at most: they take most of the time


def film_arm(
    robot: Robot,
    record: Record,
    further: Sequence[Record] = (),
    kept: ConstraintView | None = None,
) -> Film:
    """Return what a camera needs of an arm's run, and of further ones that show through it.

    Raises
    ------
    ShapeError
        If a recording is not of this robot.
    """
    records = [record, *further]
    for each in records:
        if each.q.shape[1] != robot.configuration_size:
            raise ShapeError(
                f"record: is not of {robot.name}; it has {each.q.shape[1]} joints instead of {robot.configuration_size}"
            )
    desired = translation(desired_in_room(robot, record.q, record.desired[:, :8]))
    actual = tip_paths(robot, record)
    postures = np.vstack([each.q[some_samples(each, _POSTURES)] for each in records])
    meshes, spec = link_meshes(robot), skeleton(robot)
    add_meshes(spec, robot, meshes)
    paths = [path for each in records for path in tip_paths(robot, each)]
    framing = framing_of_arm(robot, postures, np.vstack([desired, *paths]), meshes)
    ways = apart_at_plans(record, desired)
    plans = [each for each in plans_of_run(record) if each.cause]
    around = drawn_scene.DrawnScene(kept, record, framing.reach, framing.floor) if kept else None

    def decorate(scene: Any, k: int) -> None:
        if around is not None:
            around.add(scene, k)
        for way in ways:
            drawn_scene.add_desired(scene, way, framing.reach, _PIECES)
        for path in actual:
            drawn_scene.add_actual(scene, path[: k + 1], framing.reach, _PIECES)
        for made in plans:
            if made.time <= record.time[k]:
                drawn_scene.add_mark(scene, made.place, framing.reach, f"held by {made.held_by}")

    return Film(
        spec,
        framing,
        lambda _: skeleton_positions(robot, record.q),
        azimuth=130.0,
        elevation=-18.0,
        decorate=decorate,
        is_overlaid=not (around and around.moves),
        decorations=(len(ways) + len(actual)) * _PIECES + len(plans) + (around.most if around else 0),
        has_balls=around is not None,
        further=[lambda _, q=each.q: skeleton_positions(robot, q) for each in further],
    )


_MARGIN = 0.35  # m; around what moves


def film_physics(
    robot: Robot,
    picture: PhysicsPicture,
    record: Record,
    further: Sequence[tuple[PhysicsPicture, Record]] = (),
) -> Film:
    """Return what a camera needs of a run in physics, and of further ones that show through it.

    Raises
    ------
    ShapeError
        If a recording is not of this robot and its plant, or one has other things around it than the first.
    """
    meshes = link_meshes(robot)
    add_meshes(picture.spec, robot, meshes)
    return Film(
        picture.spec,
        _framing(robot, picture.things, [record, *(each for _, each in further)], meshes),
        _coordinates(picture, record, len(picture.things)),
        azimuth=-110.0,
        elevation=-38.0,
        is_overlaid=False,
        further=[_coordinates(*each, len(picture.things)) for each in further],
    )


def _coordinates(picture: PhysicsPicture, record: Record, things: int) -> Callable[[Any], Array]:
    """Return what gives MuJoCo's coordinates of a run for a compiled model."""
    readings = {name: signal.values for name, signal in record.readings.items()}

    def coordinates(model: Any) -> Array:
        if len(picture.things) != things:
            raise ShapeError(
                f"further: expected runs among {things} things as the first, got {len(picture.things)}"
            )
        return picture.coordinates(model, record.q, readings)

    return coordinates


def _framing(robot: Robot, things: Array, records: list[Record], meshes: list[LinkMesh]) -> Framing:
    """Return the room that holds the robot on its whole ways, its goals, and the things around it."""
    points = [things]
    for record in records:
        some = some_samples(record, _POSTURES)
        frames = recorded_frames(robot, record, some)[:, 2:].reshape(-1, 8)
        corners = mesh_corners(robot, record.q[some], meshes)
        points += [translation(frames), translation(record.desired[:, :8]), corners]
    everything = np.vstack(points)
    margin = np.array([_MARGIN, _MARGIN, 0.0])
    lower, upper = everything.min(axis=0) - margin, everything.max(axis=0) + margin
    lower[2] = min(lower[2], 0.0)
    extent = float(np.linalg.norm(upper - lower))
    height = float(upper[2] - lower[2])
    return Framing(extent, 0.0, 0.5 * (lower + upper), 0.95 * extent + 0.6 * height, stands=True)


def with_rolling_wheels(robot: Robot, record: Record) -> Record:
    """Return a run that was not in physics with the angles of wheels that roll without slip, as physics records them.

    The robot's first part is its drive.
    """
    if "wheel_angle" in record.readings:
        return record
    angles = Signal("wheel_angle", WHEELS, ("rad", "rad"), wheel_angles(robot, record.q)[:, :2])
    return replace(record, readings={**record.readings, angles.name: angles})
