"""Which numbers of a robot are told by joint states and by odometry, and which go to its joints and to its base."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError
from dqcontrol.robots import Robot, WholeBody
from dqcontrol.robots.robot import base_coordinates
from dqcontrol.robots.whole_body import Base, Drive

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class RobotParts:
    """A robot as its topics see it: joints, and perhaps one mobile base.

    Attributes
    ----------
    robot
        As the spec has it; with drives in either form.
    """

    robot: Robot

    def __post_init__(self) -> None:
        if isinstance(self.robot, WholeBody) and len(self.robot.bases) > 1:
            raise ShapeError(
                f"robot: {self.robot.name} has {len(self.robot.bases)} mobile bases; ROS 2 tells of one"
            )

    @cached_property
    def base(self) -> Base | None:
        """The mobile base, if there is one."""
        parts = self.robot.parts if isinstance(self.robot, WholeBody) else ()
        bases = (part for part in parts if isinstance(part, Base))
        return next(bases, None)

    @cached_property
    def driven(self) -> Robot:
        """The robot with inputs that it can follow: v and ω of a drive."""
        return self.robot.in_form("constrained")

    @cached_property
    def place(self) -> Indices:
        """Coordinates x, y and φ of the base; none without one."""
        return np.flatnonzero(base_coordinates(self.robot))

    @cached_property
    def joints(self) -> Indices:
        """Coordinates of the joints."""
        return np.flatnonzero(~base_coordinates(self.robot))

    @cached_property
    def joint_inputs(self) -> Indices:
        """Inputs of `driven` that move joints, in the order of the joints."""
        return np.flatnonzero(~base_coordinates(self.robot)[self.driven.input_coordinates])

    @cached_property
    def base_inputs(self) -> Indices:
        """Inputs of `driven` that move the base: v and ω, or ẋ, ẏ and φ̇."""
        return np.flatnonzero(base_coordinates(self.robot)[self.driven.input_coordinates])

    @cached_property
    def own_joint_inputs(self) -> Indices:
        """Inputs of the robot as the spec has it that move joints."""
        return np.flatnonzero(~base_coordinates(self.robot)[self.robot.input_coordinates])

    @property
    def joint_names(self) -> list[str]:
        """Names of the joints."""
        return [self.robot.joint_names[i] for i in self.joints]

    def followed(self, q: Array, rates: Array) -> Array:
        """Return inputs of `driven` for rates of the robot as the spec has it, at a configuration (n,)."""
        if isinstance(self.robot, WholeBody) and self.robot.form == "unconstrained":
            return self.robot.feasible_inputs(q, rates)
        return rates

    def driven_positions(self, position: Array) -> Array:
        """Return position commands of `driven` for those of the robot as the spec has it."""
        is_whole = len(position) == self.robot.configuration_size
        return position[self.driven.input_coordinates] if is_whole else position

    def base_twist(self, q: Array, inputs: Array) -> tuple[float, float, float]:
        """Return the base's velocity ahead and to the left, m/s, and its turning, rad/s, for inputs of `driven`."""
        u = inputs[self.base_inputs]
        if isinstance(self.base, Drive):
            return float(u[0]), 0.0, float(u[1])
        c, s = np.cos(q[self.place[2]]), np.sin(q[self.place[2]])
        return float(c * u[0] + s * u[1]), float(c * u[1] - s * u[0]), float(u[2])

    def base_rates(self, q: Array, twist: Array) -> Array:
        """Return the inputs of the base that have it move so; the inverse of `base_twist`, which drives may lack."""
        ahead, left, turn = twist
        if isinstance(self.base, Drive):
            return np.array([ahead, turn])
        c, s = np.cos(q[self.place[2]]), np.sin(q[self.place[2]])
        return np.array([c * ahead - s * left, s * ahead + c * left, turn])
