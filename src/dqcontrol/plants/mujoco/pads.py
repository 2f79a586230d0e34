"""Pads on two hands in MuJoCo, between which they carry a body: held by friction, and by how hard they press."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.conversions import matrix_from_pose
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.mujoco.gripper import BODIES
from dqcontrol.robots.files.mujoco_package import import_mujoco
from dqcontrol.robots.kinematics.kinematics_kernels import REVOLUTE
from dqcontrol.robots.poses import positions

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

GRIP_FORCE = "grip_force"
PADS = ("pad_1", "pad_2")
_PAD = 0.01, 0.05, 0.05  # half sizes of the end effectors' pads, m
_RUBBER = (0.15, 0.15, 0.17, 1.0)


class Pads(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A square pad of 10 cm on each of two end effectors, facing each other: they carry a body between them.

    What they press is held by friction, of that body.

    Parameters
    ----------
    squeeze
        How much nearer to each other the servos' targets start than the end effectors do, m: their stiffness makes a
        force of it.
    """

    spec_key: ClassVar[str] = "plant.pads"
    squeeze: Annotated[float, Meta(ge=0, description="m")] = 0.006

    def add(self, spec: Any, robot: Robot, start: Array, timestep: float) -> None:
        """Add pads to both end effectors of a robot's model, parallel to each other at a start configuration.

        Raises
        ------
        ValueRangeError
            If the robot has not two end effectors, or they are at one place.
        """
        first, second = (positions(hand) for hand in _hands(robot, start))
        apart = float(np.linalg.norm(first - second))
        if apart < 2 * _PAD[0]:
            raise ValueRangeError(
                f"plant.pads: both end effectors start {apart:.3g} m apart, too near for a body; change 'start'"
            )
        mujoco = import_mujoco()
        along = (first - second) / apart
        up = np.eye(3)[2] if abs(along[2]) < 0.9 else np.eye(3)[0]
        across = np.cross(up, along)
        across /= np.linalg.norm(across)
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, np.column_stack([along, across, np.cross(along, across)]).reshape(9))
        for k, (row, hand) in enumerate(zip(robot.ends, _hands(robot, start), strict=True)):
            relative, quaternion = np.empty(4), np.empty(4)
            mujoco.mju_mulQuat(relative, hand[:4] * [1, -1, -1, -1], turn)
            mujoco.mju_mulQuat(quaternion, np.ascontiguousarray(robot.chain[row, :4]), relative)
            body = spec.body(f"link_{int(robot.parents[row]) + 1}")
            pad = body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, rgba=_RUBBER, mass=0, name=PADS[k])
            pad.pos, pad.quat, pad.size = robot.chain[row, 4:7], quaternion, _PAD
            pad.contype, pad.conaffinity, pad.condim, pad.friction = 0, BODIES, 4, [0, 0, 0]
            pad.solref[:2] = 4 * timestep, 1.0

    def squeezed(self, robot: Robot, start: Array) -> Array:
        """Return by how much the servos' targets differ at the start: each moves half the squeeze inward."""
        frames, count = robot.frames(start), robot.configuration_size
        first, second = (positions(hand) for hand in _hands(robot, start))
        along = (first - second) / np.linalg.norm(first - second)
        rows, rates = [], []
        for row, side in zip(robot.ends, (-1.0, 1.0), strict=True):
            rows.append(_hand_jacobian(robot, frames, row, count))
            rates.append(np.concatenate([np.zeros(3), 0.5 * side * self.squeeze * along]))
        return np.linalg.pinv(np.vstack(rows), rcond=1e-3) @ np.concatenate(rates)


def _hands(robot: Robot, start: Array) -> list[Array]:
    """Return the poses of both end effectors, or say that a robot has not two."""
    if len(robot.ends) != 2:
        raise ValueRangeError(
            f"plant.pads: are on two end effectors, and {robot.name} has {len(robot.ends)}; take them away"
        )
    frames = robot.frames(start)
    return [frames[row] for row in robot.ends]


def _hand_jacobian(robot: Robot, frames: Array, row: int, count: int) -> Array:
    """Return the Jacobian of [ω ; ṗ] of an end effector, from the frames of the joints that carry it."""
    jacobian, end = np.zeros((6, count)), positions(frames[row])
    while (row := int(robot.parents[row])) >= 0:
        axis, origin = matrix_from_pose(frames[row])[:3, 2], positions(frames[row])
        slides, column = robot.chain[row, 7] != REVOLUTE, int(robot.row_coordinates[row])
        turn = np.zeros(3) if slides else axis
        jacobian[:, column] = [*turn, *(axis if slides else np.cross(axis, end - origin))]
    return jacobian
