"""A mobile manipulator in physics, for the camera: it, its wheels, fingers, cubes and baskets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.figures.tilted_base import recorded_frames
from dqcontrol.films.film import Film
from dqcontrol.films.framing import Framing
from dqcontrol.films.link_meshes import LinkMesh, add_meshes, link_meshes, mesh_corners
from dqcontrol.plants.channels import BASE_POSITION, BASE_QUATERNION
from dqcontrol.plants.mobile.gripper import FINGERS
from dqcontrol.plants.mobile.mobile_live import coordinates_of
from dqcontrol.plants.mobile.wheeled_base import WHEELS

if TYPE_CHECKING:
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.mobile import MobilePlant
    from dqcontrol.robots.robot import Robot

_MARGIN = 0.35  # m; around what moves
_POSTURES = 50  # looked at to find the room


def film_mobile(robot: Robot, plant: MobilePlant, record: Record) -> Film:
    """Return what a camera needs of a mobile manipulator's run.

    Raises
    ------
    ShapeError
        If the recording is not of this robot and plant.
    """
    spec, meshes = plant.picture_model(robot), link_meshes(robot)
    add_meshes(spec, robot, meshes)
    return Film(
        spec,
        _framing(robot, plant, record, meshes),
        lambda model: _configurations(robot, plant, record, model),
        azimuth=-110.0,
        elevation=-38.0,
    )


def _framing(robot: Robot, plant: MobilePlant, record: Record, meshes: list[LinkMesh]) -> Framing:
    """Return the room that holds the robot on its whole way, its goals, and the things around it."""
    things = [[*thing.position, 0.0] for thing in (*plant.scene.cubes, *plant.scene.baskets)]
    some = np.linspace(0, len(record.q) - 1, min(len(record.q), _POSTURES)).astype(int)
    frames = recorded_frames(robot, record, some)[:, 2:].reshape(-1, 8)
    corners = mesh_corners(robot, record.q[some], meshes)
    points = np.vstack([translation(frames), translation(record.desired[:, :8]), corners, *things])
    margin = np.array([_MARGIN, _MARGIN, 0.0])
    lower, upper = points.min(axis=0) - margin, points.max(axis=0) + margin
    lower[2] = min(lower[2], 0.0)
    extent = float(np.linalg.norm(upper - lower))
    height = float(upper[2] - lower[2])
    return Framing(extent, 0.0, 0.5 * (lower + upper), 0.95 * extent + 0.6 * height, stands=True)


def _configurations(robot: Robot, plant: MobilePlant, record: Record, model: Any) -> NDArray[np.float64]:
    """Return MuJoCo's coordinates at each sample."""
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
    if BASE_POSITION in readings:
        out[:, base : base + 3] = readings[BASE_POSITION].values
        out[:, base + 3 : base + 7] = readings[BASE_QUATERNION].values
    else:  # a recording of an earlier version
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
