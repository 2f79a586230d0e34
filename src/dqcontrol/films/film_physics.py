"""A robot among the things around it, as physics has them, for the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.figures.tilted_base import recorded_frames
from dqcontrol.films.film import Film
from dqcontrol.films.framing import Framing
from dqcontrol.films.link_meshes import LinkMesh, add_meshes, link_meshes, mesh_corners

if TYPE_CHECKING:
    from dqcontrol.arrays import Array
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import PhysicsPicture
    from dqcontrol.robots.robot import Robot

_MARGIN = 0.35  # m; around what moves
_POSTURES = 50  # looked at to find the room


def film_physics(robot: Robot, picture: PhysicsPicture, record: Record) -> Film:
    """Return what a camera needs of a run in physics.

    Raises
    ------
    ShapeError
        If the recording is not of this robot and plant.
    """
    readings = {name: signal.values for name, signal in record.readings.items()}
    meshes = link_meshes(robot)
    add_meshes(picture.spec, robot, meshes)
    return Film(
        picture.spec,
        _framing(robot, picture.things, record, meshes),
        lambda model: picture.coordinates(model, record.q, readings),
        azimuth=-110.0,
        elevation=-38.0,
        is_overlaid=False,
    )


def _framing(robot: Robot, things: Array, record: Record, meshes: list[LinkMesh]) -> Framing:
    """Return the room that holds the robot on its whole way, its goals, and the things around it."""
    some = np.linspace(0, len(record.q) - 1, min(len(record.q), _POSTURES)).astype(int)
    frames = recorded_frames(robot, record, some)[:, 2:].reshape(-1, 8)
    corners = mesh_corners(robot, record.q[some], meshes)
    points = np.vstack([translation(frames), translation(record.desired[:, :8]), corners, things])
    margin = np.array([_MARGIN, _MARGIN, 0.0])
    lower, upper = points.min(axis=0) - margin, points.max(axis=0) + margin
    lower[2] = min(lower[2], 0.0)
    extent = float(np.linalg.norm(upper - lower))
    height = float(upper[2] - lower[2])
    return Framing(extent, 0.0, 0.5 * (lower + upper), 0.95 * extent + 0.6 * height, stands=True)
