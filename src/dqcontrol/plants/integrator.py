"""Ideal joints and bases."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, WRONG_SIZE, kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.errors import as_each, as_positive
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import PLANT, CompiledPlant, Plant, start_configuration
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, advance
from dqcontrol.robots.robot import Robot


@kernel(PLANT)
def integrate(command, parameters, noise, state, q, measured):
    """Advance q by T (u + bias)."""
    if command.shape[0] != q.shape[0]:
        return WRONG_SIZE
    for i in range(q.shape[0]):
        q[i] += parameters[0] * (command[i] + parameters[1 + i])
        measured[i] = q[i]
    return OK


@kernel(PLANT)
def drive(command, parameters, noise, state, q, measured):
    """Let u + bias act on a robot with drives for T."""
    m = state.shape[0]
    if command.shape[0] != m:
        return WRONG_SIZE
    for i in range(m):
        state[i] = command[i] + parameters[1 + i]
    rows = (parameters.shape[0] - 1 - m) // DRIVE_COLUMNS
    advance(as_matrix(parameters[1 + m :], rows, DRIVE_COLUMNS), state, parameters[0], q)
    for i in range(q.shape[0]):
        measured[i] = q[i]
    return OK


class Integrator(Plant, frozen=True, kw_only=True, tag="integrator"):
    """Ideal joints and bases: q(k+1) = q(k) + T (u(k) + bias), measured without error.

    A differential drive moves exactly, on the arc of its v and ω; see `Robot.integrate`.

    Parameters
    ----------
    bias
        What the inputs do beyond the command, rad/s or m/s: one number, or one an input.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> plant = dqc.plants.Integrator().start(dqc.load_robot("iiwa7"), np.zeros(7), period=0.01, steps=1, seed=0)
    >>> plant.step(np.ones(7))
    >>> float(plant.q[0])
    0.01
    """

    is_ideal: ClassVar[bool] = True
    bias: Annotated[float | list[float], Meta(description="rad/s or m/s")] = 0.0

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> CompiledPlant:
        """Return the plant at start.

        Raises
        ------
        ShapeError, ValueRangeError
            If start, period or the bias does not fit.
        """
        start, period, m = start_configuration(robot, start), as_positive("period", period), robot.input_size
        parameters = np.concatenate([[period], as_each("plant.bias", self.bias, m), robot.drives.ravel()])
        move = drive if len(robot.drives) else integrate
        return CompiledPlant(move, parameters, np.zeros(m), start, np.zeros((steps, 1)))

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel:
        """Return q⁺ = q + T u."""
        return LinearModel(np.ones((1, 1)), np.full((1, 1), period))
