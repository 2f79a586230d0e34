"""An arm's run for the camera: the arm, the desired path, the hand's path so far, and what is in its way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.figures.tip_paths import desired_in_room, tip_paths
from dqcontrol.films.drawn_path import add_actual, add_desired
from dqcontrol.films.drawn_scene import DrawnScene
from dqcontrol.films.film import Film
from dqcontrol.films.framing import framing_of_arm, some_samples
from dqcontrol.films.link_meshes import add_meshes, link_meshes
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco, skeleton, skeleton_positions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dqcontrol.arrays import Array
    from dqcontrol.constraints.constraint_view import ConstraintView
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import MovingBox, Plant
    from dqcontrol.robots.robot import Robot

_POSTURES = 50  # looked at to find the room of an arm
_PIECES = 150  # of a path, at most: they take most of the time
_BALL = (0.55, 0.35, 0.65, 0.6)
_WOOD = (0.76, 0.60, 0.42, 1.0)


def film_arm(
    robot: Robot,
    plant: Plant | None,
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
    balls, boxes = [], []
    if plant is not None:
        readings = {name: signal.values for name, signal in record.readings.items()}
        balls, boxes = plant.balls(record.time), plant.boxes(robot, record.q, readings)

    around = DrawnScene(kept, record, framing.reach, framing.floor) if kept else None

    def decorate(scene: Any, k: int) -> None:
        if around is not None:
            around.add(mujoco, scene, k)
        for centers, radius in balls:
            if not np.isnan(centers[k, 0]):
                _add_ball(mujoco, scene, centers[k], radius)
        for box in boxes:
            _add_box(mujoco, scene, box, k)
        add_desired(mujoco, scene, desired, framing.reach, _PIECES)
        for path in actual:
            add_actual(mujoco, scene, path[: k + 1], framing.reach, _PIECES)

    return Film(
        spec,
        framing,
        lambda _: skeleton_positions(robot, record.q),
        azimuth=130.0,
        elevation=-18.0,
        decorate=decorate,
        is_overlaid=not boxes,
        decorations=(1 + len(actual)) * _PIECES + len(balls) + len(boxes) + (around.most if around else 0),
        further=[lambda _, q=each.q: skeleton_positions(robot, q) for each in further],
    )


def _add_ball(mujoco: Any, scene: Any, center: Array, radius: float) -> None:
    size, rgba = np.full(3, radius), np.array(_BALL, dtype=np.float32)
    kind = mujoco.mjtGeom.mjGEOM_SPHERE
    mujoco.mjv_initGeom(scene.geoms[scene.ngeom], kind, size, center, np.eye(3).ravel(), rgba)
    scene.ngeom += 1


def _add_box(mujoco: Any, scene: Any, box: MovingBox, k: int) -> None:
    turn, rgba = np.empty(9), np.array(_WOOD, dtype=np.float32)
    mujoco.mju_quat2Mat(turn, box.quaternion[k])
    kind = mujoco.mjtGeom.mjGEOM_BOX
    mujoco.mjv_initGeom(scene.geoms[scene.ngeom], kind, box.half_sizes, box.position[k], turn, rgba)
    scene.ngeom += 1
