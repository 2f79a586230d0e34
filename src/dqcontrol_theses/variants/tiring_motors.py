"""Motors that give up when gravity asks too much of them for too long: what [S17 5.2.3.2] saw on the robot."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta, field

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.plants import Channel, Plant
from dqcontrol.robots import Robot

GRAVITY = 9.81
_ONE = np.array([1.0, 0, 0, 0])


class TiringMotors(Plant, frozen=True, kw_only=True, tag="tiring-motors"):
    """Ideal joints, each of which stays where it is for good once gravity has asked too much of its motor for a while.

    Only the weight of the links counts, as for an arm that moves slowly. Links are points half way between their
    joints. The defaults stand for the AX-18A arm of [S17], whose masses nobody publishes: they are those of a similar
    arm with AX-12 servos.

    Parameters
    ----------
    torque
        That a motor can hold for long, N·m; the default is 45 % of an AX-18A's stall torque of 1.77 N·m.
    patience
        For how long it holds more, s.
    masses
        Of what lies from one of the last joints to the next, and of the hand, kg: so many motors tire.
    hand
        Where the hand's middle is ahead of the last axis, m.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import TiringMotors
    >>> body = dqc.load_robot("little-john")
    >>> stretched = np.zeros(8)
    >>> live = TiringMotors(torque=0.8, patience=0.5).start(body, stretched, period=0.1, steps=10, seed=0)
    >>> for _ in range(10):
    ...     live.step(np.zeros(7))
    >>> live.fault
    'joint_2 gave up'
    """

    torque: Annotated[float, Meta(gt=0, description="N·m")] = 0.8
    patience: Annotated[float, Meta(ge=0, description="s")] = 1.0
    masses: Annotated[list[float], Meta(min_length=1, description="kg, one a motor")] = field(
        default_factory=lambda: [0.125, 0.405, 0.18, 0.12, 0.13]
    )
    hand: Annotated[float, Meta(description="m")] = 0.085

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> LiveMotors:
        """Return the plant at start.

        Raises
        ------
        ShapeError, ValueRangeError
            If the robot has fewer joints than there are masses, or a number is out of range.
        """
        count, joints = len(as_array("plant.masses", self.masses, (None,))), robot.configuration_size
        if count > joints:
            raise ShapeError(f"plant.masses: {robot.name} has {joints} joints, got {count} masses")
        return LiveMotors(self, robot, np.array(start, dtype=np.float64), period)

    def gravity_torques(self, robot: Robot, q: Array) -> Array:
        """Return |torque| about each of the last joints, on a base that holds them still, shape (…, motors), N·m."""
        masses, count = self.masses, len(self.masses)
        frames = robot.frames(q)[..., robot.configuration_size - count :, :]
        points = algebra.translation(frames)
        ahead = algebra.multiply(frames[..., -1, :], algebra.pose(_ONE, np.array([self.hand, 0, 0])))
        between = 0.5 * (points[..., : count - 1, :] + points[..., 1:count, :])
        middles = np.concatenate([between, algebra.translation(ahead)[..., None, :]], axis=-2)
        axes = (
            algebra.translation(algebra.multiply(frames, algebra.pose(_ONE, np.array([0, 0, 1.0])))) - points
        )
        weight = np.array([0, 0, GRAVITY])
        torques = np.zeros((*np.shape(q)[:-1], count))
        for i in range(count):
            for k in range(i, count):
                arm = middles[..., k, :] - points[..., i, :]
                torques[..., i] += masses[k] * np.sum(axes[..., i, :] * np.cross(arm, weight), axis=-1)
        return np.abs(torques)


class LiveMotors:
    """`TiringMotors` at work."""

    def __init__(self, plant: TiringMotors, robot: Robot, start: Array, period: float) -> None:
        self._plant, self._robot, self._period = plant, robot, period
        self.q = start
        self.measured: Array = start.copy()
        count = len(plant.masses)
        self._names = robot.joint_names[-count:]
        self.channels: tuple[Channel, ...] = (Channel("motor_torque", self._names, "N·m"),)
        self.readings: Array = plant.gravity_torques(robot, start)
        self._strained = np.zeros(count)
        self._gone = np.zeros(count, dtype=bool)

    @property
    def fault(self) -> str:
        """Which motors gave up."""
        names = [self._names[i] for i in np.flatnonzero(self._gone)]
        return f"{', '.join(names)} gave up" if names else ""

    def step(self, command: Array) -> None:
        """Move for one period, and tire."""
        obeyed = np.array(command, dtype=np.float64)
        obeyed[-len(self._gone) :][self._gone] = 0.0
        self.q[:] = self._robot.integrate(self.q, obeyed, self._period)
        self.measured[:] = self.q
        self.readings[:] = self._plant.gravity_torques(self._robot, self.q)
        beyond = self.readings > self._plant.torque
        self._strained = np.where(beyond, self._strained + self._period, 0.0)
        self._gone |= self._strained > self._plant.patience
