"""Ideal joints."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.compile import OK, WRONG_SIZE, kernel
from dqcontrol.errors import ShapeError, as_array, as_positive
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.plant import PLANT, Array, CompiledPlant, Plant, start_configuration
from dqcontrol.robots.serial_arm import SerialArm


@kernel(PLANT)
def integrate(command, parameters, noise, state, q, measured):
    """Advance q by T (u + bias)."""
    if command.shape[0] != q.shape[0]:
        return WRONG_SIZE
    for i in range(q.shape[0]):
        q[i] += parameters[0] * (command[i] + parameters[1 + i])
        measured[i] = q[i]
    return OK


class Integrator(Plant, frozen=True, kw_only=True, tag="integrator"):
    """Ideal joints: q(k+1) = q(k) + T (u(k) + bias), measured without error.

    Parameters
    ----------
    bias
        What the joints do beyond the command, rad/s or m/s: one number, or one a joint.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> plant = dqc.plants.Integrator().start(dqc.load_robot("iiwa7"), np.zeros(7), dt=0.01, steps=1, seed=0)
    >>> plant.step(np.ones(7))
    >>> float(plant.q[0])
    0.01
    """

    bias: Annotated[float | list[float], Meta(description="rad/s or m/s")] = 0.0

    def start(self, robot: SerialArm, q0: Array, dt: float, steps: int, seed: int) -> CompiledPlant:
        """Return the plant at q0.

        Raises
        ------
        ShapeError, ValueRangeError
            If q0, dt or the bias does not fit.
        """
        q0, dt = start_configuration(robot, q0), as_positive("dt", dt)
        bias = as_array("plant.bias", self.bias)
        if bias.shape not in ((), q0.shape):
            raise ShapeError(f"plant.bias: expected one number or {len(q0)}, got shape {bias.shape}")
        parameters = np.concatenate([[dt], np.broadcast_to(bias, q0.shape)])
        return CompiledPlant(integrate, parameters, np.zeros(1), q0, np.zeros((steps, 1)))

    def linear_model(self, robot: SerialArm, q0: Array, dt: float) -> LinearModel:
        """Return q⁺ = q + T u."""
        return LinearModel(np.ones((1, 1)), np.full((1, 1), dt))
