"""An arm in MuJoCo whose joints are driven by the torques of an impedance."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from dqcontrol.contact import PreparedImpedance
from dqcontrol.errors import ValueRangeError
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.mujoco.mujoco_servos import mass_matrix

if TYPE_CHECKING:
    from collections.abc import Callable

    from dqcontrol.arrays import Array
    from dqcontrol.plants.mujoco.mujoco_plant import MujocoPlant
    from dqcontrol.robots.robot import Robot

_STEP = 1e-5  # rad, m and their rates, for slopes
_OF_SERVOS = ("bandwidth", "damping_ratio", "stiffness", "damping", "pads")


class TorqueDrive:
    """What steps a model with a new torque at every time step, in place of its servos.

    The servos stay as what moves the targets and clips the torques: without gains, their bias is the torque.
    """

    def __init__(self, plant: MujocoPlant, robot: Robot, model: Any, data: Any) -> None:
        assert plant.impedance is not None  # MuJoCo bears the weight, that of tools and grippers too
        of_servos = [name for name in _OF_SERVOS if getattr(plant, name) != getattr(type(plant)(), name)]
        if of_servos:
            raise ValueRangeError(
                f"plant.impedance: stands in place of the joints' servos; leave out {', '.join(of_servos)}"
            )
        if plant.command_mode != "integrated":
            raise ValueRangeError(
                "plant.impedance: pulls towards a target that stays; command_mode: integrated"
            )
        if plant.impedance.feels and plant.wrist is None:
            raise ValueRangeError("plant.impedance.mass: takes a measured wrench; give the plant a 'wrist'")
        n = robot.configuration_size
        law = plant.prepared_impedance(robot)
        assert law is not None
        self.law: PreparedImpedance = law
        self.law.check_period(data.qpos[:n].copy(), plant.timestep)
        model.actuator_gainprm[:n] = 0.0
        model.actuator_biasprm[:n] = 0.0
        data.act[:n] = data.qpos[:n]
        self._q, self._rates, self._target, self._leads = (
            data.qpos[:n],
            data.qvel[:n],
            data.act[:n],
            data.ctrl[:n],
        )
        self._bias = model.actuator_biasprm[:n, 0]

    def advancing(self, step: Callable[[Any, Any, int], None], wrench: Array | None) -> Any:
        """Return what takes a number of time steps by way of another, with a sensor's wrench."""

        def advance(model: Any, data: Any, count: int) -> None:
            for _ in range(count):
                self._bias[:] = self.law.torque(self._q, self._rates, self._target, self._leads, wrench)
                step(model, data, 1)

        return advance

    def linear_model(self, model: Any, data: Any, timestep: float, steps: int, viscous: Array) -> LinearModel:
        """Return how small commands move the arm: semi-implicit time steps, and torques by their slopes."""
        n, h = len(self._q), timestep
        at = np.concatenate([self._q, np.zeros(n), self._q, np.zeros(n)])
        slopes = np.empty((n, 4 * n))
        for i, change in enumerate(_STEP * np.eye(4 * n)):
            ahead = self.law.torque(*(at + change).reshape(4, n), wrench=_NOTHING).copy()
            slopes[:, i] = (ahead - self.law.torque(*(at - change).reshape(4, n), wrench=_NOTHING)) / (
                2 * _STEP
            )
        mass = mass_matrix(model, data)[:n, :n]
        pull = h * np.linalg.solve(mass + h * np.diag(viscous), slopes)
        pull[:, n : 2 * n] += np.linalg.solve(mass + h * np.diag(viscous), mass)
        step = np.zeros((4 * n, 4 * n))
        step[n : 2 * n] = pull
        step[:n] = h * pull
        step[:n, :n] += np.eye(n)
        step[2 * n : 3 * n, 2 * n :] = np.hstack([np.eye(n), h * np.eye(n)])
        step[3 * n :, 3 * n :] = np.eye(n)
        whole = np.linalg.matrix_power(step, steps)
        return LinearModel(whole[: 3 * n, : 3 * n], whole[: 3 * n, 3 * n :])


_NOTHING = np.zeros(6)
