"""An arm's run for the camera: the arm, the desired path, the end effector's path so far, and what is in its way."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.figures.tip_paths import desired_in_room, tip_paths
from dqcontrol.films.drawn_path import add_actual, add_desired, add_mark
from dqcontrol.films.drawn_scene import DrawnScene
from dqcontrol.films.film import Film
from dqcontrol.films.framing import framing_of_arm, some_samples
from dqcontrol.films.link_meshes import add_meshes, link_meshes
from dqcontrol.measures.plans_of_run import apart_at_plans, plans_of_run
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco, skeleton, skeleton_positions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dqcontrol.constraints.constraint_view import ConstraintView
    from dqcontrol.loop.record import Record
    from dqcontrol.robots.robot import Robot

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
