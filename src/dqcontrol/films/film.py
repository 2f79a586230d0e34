"""Pictures of a run at some of its samples, by MuJoCo without a window."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.figures.paths import desired_in_room, recorded_frames, tip_paths
from dqcontrol.films.drawn_scene import COLOURS, DrawnScene, add_actual, add_desired, add_ghost, add_mark
from dqcontrol.films.link_meshes import LinkMesh, add_meshes, link_meshes, mesh_corners
from dqcontrol.films.offscreen import offscreen, renderer
from dqcontrol.films.scene_background import Framing, add_scene_background, framing_of_arm, some_samples
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.held import apart_at_plans, plans_of_run
from dqcontrol.plants.mobile.wheeled_base import WHEELS
from dqcontrol.plants.mujoco.mujoco_model import compiled, import_mujoco, skeleton, skeleton_positions

if TYPE_CHECKING:
    from dqcontrol.arrays import Array
    from dqcontrol.constraints.constraint_view import ConstraintView
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import PhysicsPicture
    from dqcontrol.robots.robot import Robot


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
    options, nobody, camera = mujoco.MjvOption(), mujoco.MjvPerturb(), mujoco.MjvCamera()
    options.geomgroup[4] = 0
    camera.lookat[:], camera.distance = framing.middle, framing.distance
    camera.azimuth, camera.elevation = towards, film.elevation if elevation is None else elevation
    everything, away = mujoco.mjtCatBit.mjCAT_ALL.value, _BEHIND * _direction(camera)
    with offscreen(width, height), renderer(model, width, height) as draw:
        for k, *others in samples:
            data.qpos[:] = configurations[k]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_camlight(model, data)
            mujoco.mjv_updateScene(model, data, options, nobody, camera, everything, scene)
            for i, ((ghost, places), j) in enumerate(zip(ghosts, others, strict=True)):
                ghost.qpos[:] = places[j]
                mujoco.mj_kinematics(model, ghost)
                add_ghost(mujoco, model, ghost, scene, _GHOST, COLOURS[i % len(COLOURS)], away)
            film.decorate(scene, int(k))
            yield draw(scene)


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
    mujoco = import_mujoco()
    desired = translation(desired_in_room(robot, record.q, record.desired[:, :8]))
    actual = tip_paths(robot, record)
    postures = np.vstack([each.q[some_samples(each, _POSTURES)] for each in records])
    meshes, spec = link_meshes(robot), skeleton(robot)
    add_meshes(spec, robot, meshes)
    paths = [path for each in records for path in tip_paths(robot, each)]
    framing = framing_of_arm(robot, postures, np.vstack([desired, *paths]), meshes)
    ways = apart_at_plans(record, desired)
    plans = [each for each in plans_of_run(record) if each.cause]
    around = DrawnScene(kept, record, framing.reach, framing.floor) if kept else None

    def decorate(scene: Any, k: int) -> None:
        if around is not None:
            around.add(mujoco, scene, k)
        for way in ways:
            add_desired(mujoco, scene, way, framing.reach, _PIECES)
        for path in actual:
            add_actual(mujoco, scene, path[: k + 1], framing.reach, _PIECES)
        for made in plans:
            if made.time <= record.time[k]:
                add_mark(mujoco, scene, made.place, framing.reach, f"held by {made.held_by}")

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
    _, _, radius, half_track, *_ = robot.drives[0]
    x, y, heading = record.q[:, :3].T
    middle = 0.5 * (heading[1:] + heading[:-1])
    ahead = np.diff(x) * np.cos(middle) + np.diff(y) * np.sin(middle)
    turned = half_track * np.diff(heading)
    steps = np.stack([ahead + turned, ahead - turned], axis=1) / radius
    angles = Signal("wheel_angle", WHEELS, ("rad", "rad"), np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]))
    return replace(record, readings={**record.readings, angles.name: angles})
