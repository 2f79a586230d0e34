"""A robot among the things around it, as physics has them, for the camera."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import ShapeError
from dqcontrol.figures.tilted_base import recorded_frames
from dqcontrol.films.film import Film
from dqcontrol.films.framing import Framing, some_samples
from dqcontrol.films.link_meshes import LinkMesh, add_meshes, link_meshes, mesh_corners
from dqcontrol.loop.signals import Signal
from dqcontrol.plants.mobile.wheeled_base import WHEELS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from dqcontrol.arrays import Array
    from dqcontrol.loop.record import Record
    from dqcontrol.plants.plant import PhysicsPicture
    from dqcontrol.robots.robot import Robot

_MARGIN = 0.35  # m; around what moves
_POSTURES = 50  # looked at to find the room


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
