"""A compliant arm in motion: one control period at a time."""

from __future__ import annotations

import math
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import (
    DivergedError,
    SafetyWarning,
    ShapeError,
    ValueRangeError,
    as_array,
    as_positive,
    unknown_name,
)
from dqcontrol.plants import joint_table as of
from dqcontrol.plants.compliant_step import advance, physics_step, settle
from dqcontrol.plants.elastic_model import TICK
from dqcontrol.plants.filters import MEMORY, butterworth
from dqcontrol.plants.loads import loss_table, payload_table, push_table
from dqcontrol.plants.mujoco_model import import_mujoco
from dqcontrol.robots.serial_arm import SerialArm

if TYPE_CHECKING:
    from dqcontrol.plants.compliant import CompliantPlant
    from dqcontrol.plants.controller_file import ControllerFile

Array = NDArray[np.float64]


class LiveCompliant:
    """An arm in motion; made by `CompliantPlant.start`.

    Attributes
    ----------
    model, data
        MuJoCo's own model and state, for whoever needs more.
    q, measured
        True link angles and those that the encoders give behind their filters, shape (n,), rad, updated in place.
    """

    def __init__(
        self,
        plant: CompliantPlant,
        robot: SerialArm,
        file: ControllerFile,
        model: Any,
        data: Any,
        constants: Array,
        state: Array,
        bodies: Array,
        rotors: Array,
        counts: tuple[int, int],
        seed: int,
    ) -> None:
        n = robot.configuration_size
        self.model, self.data = model, data
        self.q: Array = data.qpos[:n]
        self.measured: Array = np.empty(n)
        self._names = robot.joint_names
        self._state, self._ticks = state, counts[0]
        self._shared = np.zeros(of.SHARED)
        self._shared[[of.MODE, of.ASKED_MODE]] = of.MODES[plant.mode]
        self._shared[of.RAMP], self._shared[of.RAMP_STEP] = 1.0, TICK / file.ramp_time
        self._shared[of.MOST_AGE] = round(file.safety.command_timeout / TICK)
        self._shared[of.MOST_LOST] = round(file.safety.sensor_timeout / TICK)
        self._rng = np.random.default_rng(seed)
        self._noise = np.zeros((self._ticks, n))
        self._noise_scale = plant.encoder_noise
        self._moves = np.zeros(n)
        self._from_measured = plant.command_mode == "measured"
        self._period = self._ticks * TICK
        self._told = False
        sensor = file.wrist_sensor
        self._wrench_noise = np.repeat([sensor.force_noise, sensor.torque_noise], 3)
        self._wrench_bias = np.array([*sensor.force_bias, *sensor.torque_bias])
        self._filtered_wrench, self._wrench = np.zeros(6), np.zeros(6)
        names = {f"link {i + 1}": model.body(f"link_{i + 1}").id for i in range(n)}
        carriers = [
            model.body(name).id for name in ("payload", "hand", *(f"link_{i + 1}" for i in range(n)), "world")
        ]
        wrench = data.sensordata
        wrench_filter, memory = butterworth(sensor.cutoff, TICK), np.zeros((6, MEMORY))
        mujoco = import_mujoco()
        mujoco.mj_forward(model, data)
        self._draw()
        settle(
            constants, state, data.qpos, data.qvel, rotors, self._noise[0], wrench, wrench_filter, memory,
            self._filtered_wrench,
        )  # fmt: skip
        self._physics = (physics_step(), model._address, data._address)
        self._tables = (
            constants,
            state,
            self._shared,
            robot.chain,
            bodies,
            np.array([*plant.gravity, plant.gravity_factor]),
            np.zeros((4, n)),
            self._noise,
            loss_table(plant.encoder_losses, n),
            push_table(plant.pushes, {"hand": carriers[0], **names}),
            payload_table(plant.payload),
            np.array(carriers, dtype=np.float64),
            model.body_mass,
            model.body_subtreemass,
            data.xfrc_applied,
            data.ctrl,
            data.qpos,
            data.qvel,
            rotors,
            wrench,
            wrench_filter,
            memory,
            self._filtered_wrench,
        )
        self._steps = counts[1]
        self._measure()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return float(self._shared[of.TICKS]) * TICK

    @property
    def mode(self) -> str:
        """Mode of the joint controllers."""
        return next(name for name, number in of.MODES.items() if number == self._shared[of.MODE])

    @property
    def target(self) -> Array:
        """The angles q_desired as commanded, shape (n,), rad."""
        return self._state[:, of.TARGET].copy()

    @property
    def reference(self) -> Array:
        """The angles that the joint controllers follow, shape (n,), rad."""
        return self._state[:, of.REFERENCE].copy()

    @property
    def encoders(self) -> Array:
        """The encoders' last readings, before their filters, shape (n,), rad."""
        return self._state[:, of.ENCODER].copy()

    @property
    def servo_stiffness(self) -> Array:
        """The gains of the modes THETA and THETA_MJ, shape (n,), N·m/rad."""
        return self._tables[0][:, of.SERVO_P].copy()

    @property
    def fault(self) -> str:
        """Why the motors were switched off; empty while all is well."""
        if self._shared[of.FAULT] == 0:
            return ""
        what, joint = of.FAULTS[int(self._shared[of.FAULT])], int(self._shared[of.FAULTY_JOINT])
        return what if joint < 0 else f"{self._names[joint]}: {what}"

    def switch(self, mode: str) -> None:
        """Ask for another mode, which takes over within the ramp time, and clear a fault.

        Raises
        ------
        UnknownNameError
            If there is no such mode.
        """
        if mode not in of.MODES:
            raise unknown_name("mode", str(mode), of.MODES)
        self._shared[of.ASKED_MODE] = of.MODES[mode]
        self._shared[of.FAULT], self._told = 0.0, False

    def step(self, command: ArrayLike) -> None:
        """Move the arm for one control period; `q` and `measured` are updated in place.

        Parameters
        ----------
        command
            Joint velocities u, shape (n,), rad/s.

        Raises
        ------
        ShapeError, ValueRangeError
            If the command has the wrong shape or is not finite.
        DivergedError
            If the arm left the finite numbers.
        """
        moves = self._moves
        if type(command) is not np.ndarray or command.shape != moves.shape or command.dtype != moves.dtype:
            command = as_array("command", command)
            if command.shape != moves.shape:
                raise ShapeError(f"command: expected shape {moves.shape}, got {command.shape}")
        if not math.isfinite(command.dot(command)):
            raise ValueRangeError(f"command: must be finite, got {command}")
        np.multiply(command, self._period, out=moves)
        self._shared[of.AGE] = 0.0
        self._advance(self._ticks, self._from_measured)

    def wait(self, duration: float) -> None:
        """Let time pass without a new command.

        Parameters
        ----------
        duration
            s.
        """
        self._moves[:] = 0.0
        ticks = round(as_positive("duration", duration, zero_allowed=True) / TICK)
        while ticks > 0:
            self._advance(min(ticks, self._ticks), False)
            ticks -= self._ticks

    def _advance(self, ticks: int, from_measured: bool) -> None:
        self._draw()
        if advance(*self._physics, ticks, self._steps, self._moves, from_measured, *self._tables):
            raise DivergedError(f"plant: the arm diverged before {self.time:g} s, q = {self.q}")
        self._measure()
        if self._shared[of.FAULT] and not self._told:
            self._told = True
            warnings.warn(
                f"{self.fault}: the motors are off since before {self.time:g} s", SafetyWarning, stacklevel=3
            )

    def _draw(self) -> None:
        if self._noise_scale:
            self._rng.standard_normal(out=self._noise)
            self._noise *= self._noise_scale

    def _measure(self) -> None:
        self.measured[:] = self._state[:, of.ANGLE]
        self._rng.standard_normal(out=self._wrench)
        self._wrench *= self._wrench_noise
        self._wrench += self._filtered_wrench
        self._wrench += self._wrench_bias
