"""A mobile manipulator in physics, for the camera: it, its wheels, fingers, cubes and baskets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.films.film import Film
from dqcontrol.films.framing import Room
from dqcontrol.plants.mobile.gripper import FINGERS
from dqcontrol.plants.mobile.mobile_live import coordinates_of
from dqcontrol.plants.mobile.wheeled_base import WHEELS

if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.mobile import MobilePlant
    from dqcontrol.robots.robot import Robot

_MARGIN = 0.35  # m; around what moves


def film_mobile(robot: Robot, plant: MobilePlant, record: Record) -> Film:
    """Return what a camera needs of a mobile manipulator's run.

    Raises
    ------
    ShapeError
        If the recording is not of this robot and plant.
    """
    return Film(
        plant.picture_model(robot),
        _room(plant, record),
        lambda model: _configurations(robot, plant, record, model),
        azimuth=-110.0,
        elevation=-38.0,
    )


def _room(plant: MobilePlant, record: Record) -> Room:
    """Return the room that holds all that is to be seen."""
    things = [[*thing.position, 0.0] for thing in (*plant.scene.cubes, *plant.scene.baskets)]
    base = np.hstack([record.q[:, :2], np.zeros((len(record.q), 1))])
    points = np.vstack([base, translation(record.desired[:, :8]), *things])
    margin = np.array([_MARGIN, _MARGIN, 0.0])
    lower, upper = points.min(axis=0) - margin, points.max(axis=0) + margin
    extent = float(np.linalg.norm(upper - lower))
    return Room(extent, 0.0, 0.5 * (lower + upper), 0.95 * extent)


def _configurations(robot: Robot, plant: MobilePlant, record: Record, model: Any) -> NDArray[np.float64]:
    """Return MuJoCo's coordinates at each sample; the base stands upright."""
    readings = record.readings
    cubes = [f"cube_{i + 1}" for i in range(len(plant.scene.cubes))]
    needed = ["wheel_angle", *(["gripper_opening"] if plant.gripper else [])]
    needed += [f"{cube}_{what}" for cube in cubes for what in ("position", "quaternion")]
    missing = [name for name in needed if name not in readings]
    if missing or record.q.shape[1] != robot.configuration_size:
        raise ShapeError(
            f"record: is not of this robot and plant; missing: {', '.join(missing) or 'coordinates'}"
        )
    out = np.zeros((len(record.q), model.nq))
    base = coordinates_of(model, ["base"])[0]
    out[:, base : base + 2] = record.q[:, :2]
    out[:, base + 3], out[:, base + 6] = np.cos(record.q[:, 2] / 2), np.sin(record.q[:, 2] / 2)
    out[:, coordinates_of(model, [f"wheel_{name}" for name in WHEELS])] = readings["wheel_angle"].values
    out[:, coordinates_of(model, robot.joint_names[3:])] = record.q[:, 3:]
    if plant.gripper:
        closed = 0.5 * (plant.gripper.opening - readings["gripper_opening"].values)
        out[:, coordinates_of(model, FINGERS)] = closed
    for name in cubes:
        first = coordinates_of(model, [name])[0]
        out[:, first : first + 3] = readings[f"{name}_position"].values
        out[:, first + 3 : first + 7] = readings[f"{name}_quaternion"].values
    return out
