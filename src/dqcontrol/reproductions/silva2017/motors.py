"""Motors that give up above their torque: what [S17] saw on the robot, in a model of ours."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.plants.channels import Channel
from dqcontrol.plants.plant import Plant
from dqcontrol.robots import Robot

GRAVITY = 9.81
# kg, from one joint to the next and of the hand: those of a similar arm with AX-12 servos (ua-ros-pkg,
# smart_arm.xacro), since nobody publishes those of this arm. Each is taken to be half way between its joints, that of
# the hand half way to its end, which is 0.17 m ahead of the last axis.
MASSES = (0.125, 0.405, 0.18, 0.12, 0.13)
_HAND = 0.085  # m
FIRST = 3  # coordinate of the arm's first joint
# N·m that a motor can hold for long: 45 % of the AX-18A's stall torque of 1.77 N·m. Assumed.
HOLDS = 0.8


def gravity_torques(robot: Robot, q: Array) -> Array:
    """Return |torque| about each joint of the arm on the base that holds it still, shape (…, 5), N·m."""
    frames = robot.frames(q)[..., FIRST:, :]
    points = algebra.translation(frames)
    one = np.array([1.0, 0, 0, 0])
    ahead = algebra.multiply(frames[..., -1, :], algebra.pose(one, np.array([_HAND, 0, 0])))
    between = 0.5 * (points[..., : len(MASSES) - 1, :] + points[..., 1 : len(MASSES), :])
    middles = np.concatenate([between, algebra.translation(ahead)[..., None, :]], axis=-2)
    axes = algebra.translation(algebra.multiply(frames, algebra.pose(one, np.array([0, 0, 1.0])))) - points
    weight = np.array([0, 0, GRAVITY])
    torques = np.zeros((*np.shape(q)[:-1], len(MASSES)))
    for i in range(len(MASSES)):
        for k in range(i, len(MASSES)):
            arm = middles[..., k, :] - points[..., i, :]
            torques[..., i] += MASSES[k] * np.sum(axes[..., i, :] * np.cross(arm, weight), axis=-1)
    return np.abs(torques)


class TiringMotors(Plant, frozen=True, kw_only=True, tag="tiring-motors"):
    """Ideal joints, each of which stays where it is for good once gravity has asked too much of its motor for a while.

    Parameters
    ----------
    torque
        That a motor can hold, N·m.
    patience
        For how long it holds more, s.
    """

    torque: Annotated[float, Meta(gt=0, description="N·m")] = HOLDS
    patience: Annotated[float, Meta(ge=0, description="s")] = 1.0

    def start(self, robot: Robot, q0: Array, dt: float, steps: int, seed: int) -> LiveMotors:
        """Return the plant at q0."""
        return LiveMotors(self, robot, np.array(q0, dtype=np.float64), dt)


class LiveMotors:
    """`TiringMotors` at work."""

    def __init__(self, plant: TiringMotors, robot: Robot, q0: Array, dt: float) -> None:
        self._plant, self._robot, self._dt = plant, robot, dt
        self.q = q0
        self.measured: Array = q0.copy()
        count = len(MASSES)
        self.channels: tuple[Channel, ...] = (
            Channel("motor_torque", robot.joint_names[FIRST : FIRST + count], "N·m"),
        )
        self.readings: Array = gravity_torques(robot, q0)
        self._strained = np.zeros(count)
        self._gone = np.zeros(count, dtype=bool)

    @property
    def fault(self) -> str:
        """Which motors gave up."""
        names = [self._robot.joint_names[FIRST + i] for i in np.flatnonzero(self._gone)]
        return f"{', '.join(names)} gave up" if names else ""

    def step(self, command: Array) -> None:
        """Move for one period, and tire."""
        first = self._robot.input_size - len(MASSES)
        obeyed = np.array(command, dtype=np.float64)
        obeyed[first:][self._gone] = 0.0
        self.q[:] = self._robot.integrate(self.q, obeyed, self._dt)
        self.measured[:] = self.q
        self.readings[:] = gravity_torques(self._robot, self.q)
        beyond = self.readings > self._plant.torque
        self._strained = np.where(beyond, self._strained + self._dt, 0.0)
        self._gone |= self._strained > self._plant.patience
