"""MuJoCo's coordinates of a mobile manipulator and the things around it, from what was recorded of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.plants.channels import BASE_POSITION, BASE_QUATERNION
from dqcontrol.plants.mobile.running_mobile import coordinates_of
from dqcontrol.plants.mujoco.gripper import GRIPPER_OPENING, Gripper, fingers
from dqcontrol.plants.mujoco.world_model import body_channels, write_coordinates
from dqcontrol.world import Body

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


def recorded_coordinates(
    model: Any,
    robot: Robot,
    q: Array,
    readings: Mapping[str, Array],
    wheels: Sequence[str],
    gripper: Gripper | None,
    bodies: Mapping[str, Body],
) -> Array:
    """Return MuJoCo's coordinates at each sample, shape (N, nq).

    Parameters
    ----------
    model
        Of `MobilePlant.picture`, compiled.
    robot
        Whom it shows.
    q
        Configurations, shape (N, n), rad or m.
    readings
        By name what the plant sensed, each (N, size).
    wheels
        Names of the wheels' joints.
    gripper, bodies
        The plant's, and what of the world is shown.

    Raises
    ------
    ShapeError
        If the recording is not of this robot and plant.
    """
    needed = ["wheel_angle", *([GRIPPER_OPENING] if gripper else [])]
    needed += [channel.name for channel in body_channels(bodies)]
    missing = [name for name in needed if name not in readings]
    if missing or q.shape[1] != robot.configuration_size:
        raise ShapeError(
            f"record: is not of this robot and plant; missing: {', '.join(missing) or 'coordinates'}"
        )
    out = np.zeros((len(q), model.nq))
    base = coordinates_of(model, ["base"])[0]
    if BASE_POSITION in readings:
        out[:, base : base + 3] = readings[BASE_POSITION]
        out[:, base + 3 : base + 7] = readings[BASE_QUATERNION]
    else:  # a recording of an earlier version
        out[:, base : base + 2] = q[:, :2]
        out[:, base + 3], out[:, base + 6] = np.cos(q[:, 2] / 2), np.sin(q[:, 2] / 2)
    out[:, coordinates_of(model, wheels)] = readings["wheel_angle"]
    out[:, coordinates_of(model, robot.joint_names[3:])] = q[:, 3:]
    if gripper:
        closed = 0.5 * (gripper.opening - readings[GRIPPER_OPENING])
        out[:, coordinates_of(model, fingers())] = closed
    write_coordinates(bodies, model, readings, out)
    return out
