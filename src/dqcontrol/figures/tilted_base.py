"""Where a robot is whose base may tilt: what a recording says of it beside the configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.loop.record import Record
from dqcontrol.plants.channels import BASE_POSITION, BASE_QUATERNION
from dqcontrol.robots.robot import Robot


def recorded_frames(robot: Robot, record: Record, samples: NDArray[np.int_] | slice) -> Array:
    """Return the frames of a robot at some samples, tilted and lifted as its base was, (…, n + 1, 8).

    Without a recorded pose of the base they are those of `Robot.frames`.
    """
    frames = robot.frames(record.q[samples])
    lean = base_motion(record, samples)
    return frames if lean is None else algebra.multiply(lean[..., None, :], frames)


def base_motion(record: Record, samples: NDArray[np.int_] | slice) -> Array | None:
    """Return what moves an upright base to where it was at some samples, (…, 8); None if that is not recorded."""
    if BASE_POSITION not in record.readings or BASE_QUATERNION not in record.readings:
        return None
    x, y, heading = record.q[samples, :3].T
    still = np.zeros_like(x)
    upright = algebra.pose(
        np.stack([np.cos(heading / 2), still, still, np.sin(heading / 2)], axis=1),
        np.stack([x, y, still], axis=1),
    )
    rotation = record.readings[BASE_QUATERNION].values[samples]
    unit = rotation / np.linalg.norm(rotation, axis=1)[:, None]
    true = algebra.pose(unit, record.readings[BASE_POSITION].values[samples])
    return algebra.multiply(true, algebra.conjugate(upright))
