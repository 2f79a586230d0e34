"""A box that two hands carry between them in MuJoCo: held by friction, and by how hard they press."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.conversions import matrix_from_pose
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields
from dqcontrol.plants.channels import Channel
from dqcontrol.robots.files.mujoco_package import import_mujoco
from dqcontrol.robots.kinematics.kinematics_kernels import REVOLUTE
from dqcontrol.robots.poses import positions

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

GRIP_FORCE = "grip_force"
BOX_POSITION, BOX_QUATERNION = "box_position", "box_quaternion"
CHANNELS = (
    Channel(BOX_POSITION, ("x", "y", "z"), "m"),
    Channel(BOX_QUATERNION, ("w", "x", "y", "z"), ""),
    Channel(GRIP_FORCE, ("first", "second"), "N"),
)
_PAD = 0.01, 0.05, 0.05  # half sizes of the hands' pads, m
_WOOD = (0.76, 0.60, 0.42, 1.0)
_RUBBER = (0.15, 0.15, 0.17, 1.0)


class CarriedBox(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A box between two hands, each with a square pad of 10 cm: as long as they are apart at the start.

    Parameters
    ----------
    mass
        kg.
    height, depth
        Of the box across the line between the hands, m.
    friction
        Between pads and box.
    squeeze
        How much nearer to each other than the box allows the servos' targets start, m: their stiffness makes a force of
        it.
    """

    spec_key: ClassVar[str] = "plant.box"
    mass: Annotated[float, Meta(gt=0, description="kg")] = 1.0
    height: Annotated[float, Meta(gt=0, description="m")] = 0.2
    depth: Annotated[float, Meta(gt=0, description="m")] = 0.2
    friction: Annotated[float, Meta(gt=0)] = 0.8
    squeeze: Annotated[float, Meta(ge=0, description="m")] = 0.006

    def add(self, spec: Any, robot: Robot, start: Array, timestep: float) -> None:
        """Add pads to both hands of a robot's model, and the box between them at a start configuration.

        Raises
        ------
        ValueRangeError
            If the robot has not two hands, or they are too near for a box.
        """
        if len(robot.ends) != 2:
            raise ValueRangeError(
                f"plant.box: is carried by two hands, and {robot.name} has {len(robot.ends)}; take it away"
            )
        mujoco = import_mujoco()
        frames = robot.frames(start)
        hands = [frames[row] for row in robot.ends]
        first, second = (positions(hand) for hand in hands)
        apart = float(np.linalg.norm(first - second))
        size = self.half_sizes(robot, start)
        if size[0] < 0.02:
            raise ValueRangeError(
                f"plant.box: both hands start {apart:.3g} m apart, too near for a box; change 'start'"
            )
        along = (first - second) / apart
        up = np.eye(3)[2] if abs(along[2]) < 0.9 else np.eye(3)[0]
        across = np.cross(up, along)
        across /= np.linalg.norm(across)
        turn = np.empty(4)
        mujoco.mju_mat2Quat(turn, np.column_stack([along, across, np.cross(along, across)]).reshape(9))
        for k, (row, hand) in enumerate(zip(robot.ends, hands, strict=True)):
            self._add_pad(mujoco, spec, robot, row, hand, turn, k, timestep)
        box = spec.worldbody.add_body(name="box", pos=0.5 * (first + second), quat=turn)
        box.add_freejoint(name="box")
        spec.option.cone = (
            mujoco.mjtCone.mjCONE_ELLIPTIC
        )  # and friction as stiff as pressure allows: no creeping
        spec.option.impratio = 50.0
        geom = box.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, rgba=_WOOD, mass=self.mass, name="box")
        geom.size = size
        self._rub(geom, timestep)

    def half_sizes(self, robot: Robot, start: Array) -> Array:
        """Return half the sizes of the box between the hands at a start configuration, shape (3,), m."""
        first, second = (positions(robot.frames(start)[row]) for row in robot.ends)
        apart = float(np.linalg.norm(first - second))
        return np.array([0.5 * apart - _PAD[0], 0.5 * self.depth, 0.5 * self.height])

    def squeezed(self, robot: Robot, start: Array) -> Array:
        """Return by how much the servos' targets differ at the start: both hands move half the squeeze to the other."""
        frames, count = robot.frames(start), robot.configuration_size
        first, second = (positions(frames[row]) for row in robot.ends)
        along = (first - second) / np.linalg.norm(first - second)
        rows, rates = [], []
        for row, side in zip(robot.ends, (-1.0, 1.0), strict=True):
            rows.append(_hand_jacobian(robot, frames, row, count))
            rates.append(np.concatenate([np.zeros(3), 0.5 * side * self.squeeze * along]))
        return np.linalg.pinv(np.vstack(rows), rcond=1e-3) @ np.concatenate(rates)

    def _add_pad(
        self,
        mujoco: Any,
        spec: Any,
        robot: Robot,
        row: int,
        hand: Array,
        turn: Array,
        k: int,
        timestep: float,
    ) -> None:
        """Add the pad of a hand, parallel to the end of the box."""
        back, relative = hand[:4] * [1, -1, -1, -1], np.empty(4)
        mujoco.mju_mulQuat(relative, back, turn)
        quaternion = np.empty(4)
        mujoco.mju_mulQuat(quaternion, np.ascontiguousarray(robot.chain[row, :4]), relative)
        body = spec.body(f"link_{int(robot.parents[row]) + 1}")
        pad = body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            rgba=_RUBBER,
            mass=0,
            name=f"pad_{k + 1}",
            pos=robot.chain[row, 4:7],
            quat=quaternion,
        )
        pad.size = _PAD
        self._rub(pad, timestep)

    def _rub(self, geom: Any, timestep: float) -> None:
        geom.friction, geom.condim = (self.friction, 0.02, 0.001), 4
        geom.solref[:2] = 4 * timestep, 1.0


def _hand_jacobian(robot: Robot, frames: Array, row: int, count: int) -> Array:
    """Return the Jacobian of [ω ; ṗ] of a hand, from the frames of the joints that carry it."""
    jacobian, end = np.zeros((6, count)), positions(frames[row])
    while (row := int(robot.parents[row])) >= 0:
        axis, origin = matrix_from_pose(frames[row])[:3, 2], positions(frames[row])
        slides, column = robot.chain[row, 7] != REVOLUTE, int(robot.row_coordinates[row])
        turn = np.zeros(3) if slides else axis
        jacobian[:, column] = [*turn, *(axis if slides else np.cross(axis, end - origin))]
    return jacobian


class BoxSensors:
    """Where a carried box is, and how hard each hand presses it."""

    def __init__(self, model: Any, data: Any) -> None:
        mujoco = import_mujoco()
        self._data, self._model, self._force = data, model, mujoco.mj_contactForce
        self._body = model.body("box").id
        self._box = model.geom("box").id
        self._pads = [model.geom(f"pad_{k}").id for k in (1, 2)]
        self.readings: Array = np.zeros(sum(channel.size for channel in CHANNELS))
        self._wrench = np.zeros(6)

    def read(self) -> None:
        """Update the readings."""
        data, out = self._data, self.readings
        out[:3], out[3:7] = data.xpos[self._body], data.xquat[self._body]
        out[7:] = 0.0
        for i in range(data.ncon):
            pair = data.contact[i].geom
            if self._box not in pair:
                continue
            other = int(pair[0] + pair[1]) - self._box
            if other in self._pads:
                self._force(self._model, data, i, self._wrench)
                out[7 + self._pads.index(other)] += self._wrench[0]
