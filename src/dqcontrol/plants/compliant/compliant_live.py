"""A compliant arm in motion: one control period at a time."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, SafetyWarning, as_positive, unknown_name
from dqcontrol.plants.channels import Channel
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.compliant_step import advance, physics_step, settle
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.loads_and_faults import loss_table, payload_table, push_table
from dqcontrol.plants.compliant.obstacle import obstacle_table
from dqcontrol.plants.compliant.wrist import LiveWrist
from dqcontrol.plants.live_plant import LivePlant
from dqcontrol.plants.plant import as_command
from dqcontrol.robots.gravity import WORK

if TYPE_CHECKING:
    from dqcontrol.plants.compliant.compliant_arm import Arm
    from dqcontrol.plants.compliant.compliant_plant import CompliantPlant


_JOINT_CHANNELS = {
    "motor_angle": "rad",
    "reference": "rad",
    "desired_torque": "N·m",
    "spring_torque": "N·m",
    "motor_current": "A",
}
_JOINT_COLUMNS = [
    column.REFERENCE,
    column.DESIRED_TORQUE,
    column.SENSED,
    column.CURRENT,
]  # of all but the motors' angles


class LiveCompliant(LivePlant):
    """An arm in motion; made by `CompliantPlant.start`.

    Attributes
    ----------
    model, data
        MuJoCo's own model and state, for whoever needs more.
    q, measured
        True link angles and those that the encoders give behind their filters, shape (n,), rad, updated in place.
    effort
        Measured torques of the springs, shape (n,), N·m.
    wrench
        Force and torque measured at the wrist, shape (6,), N and N·m.
    """

    model: Any
    data: Any

    def __init__(self, plant: CompliantPlant, arm: Arm, seed: int) -> None:
        robot, model, data, n = arm.robot, arm.model, arm.data, arm.robot.configuration_size
        self.model, self.data = model, data
        self.q, self.measured = data.qpos[:n], np.empty(n)
        self._arm, self._state = arm, arm.state
        self._shared = np.zeros(column.SHARED)
        self._shared[[column.MODE, column.ASKED_MODE]] = column.MODES[plant.mode]
        self._shared[column.RAMP], self._shared[column.RAMP_STEP] = 1.0, TICK / arm.file.ramp_time
        self._shared[column.MOST_AGE] = round(arm.file.safety.command_timeout / TICK)
        self._shared[column.MOST_LOST] = round(arm.file.safety.sensor_timeout / TICK)
        self._rng = np.random.default_rng(seed)
        self._noise, self._noise_scale = np.zeros((arm.ticks, n)), plant.encoder_noise
        self._moves, self._from_measured = np.zeros(n), plant.command_mode == "measured"
        self._pushed = bool(plant.pushes)
        self._wrist = wrist = LiveWrist(arm.file.wrist_sensor, plant.wrist_fault)
        self._scale = arm.scale
        self._draw()
        settle(
            arm.constants, arm.state, data.qpos, data.qvel, arm.rotors, self._noise[0],
            data.sensordata, wrist.coefficients, wrist.memory, wrist.filtered,
        )  # fmt: skip
        self._physics = (physics_step(), model._address, data._address)
        links = {f"link {i + 1}": model.body(f"link_{i + 1}").id for i in range(n)}
        hand, payload = model.body("hand").id, model.body("payload").id
        self._touched = model.body("contact").id
        obstacles = obstacle_table(plant.obstacles, self._touched)
        self._contact = np.zeros(4 if len(obstacles) else 0)
        self._tables = (
            arm.constants,
            arm.state,
            self._shared,
            robot.chain,
            arm.bodies,
            np.array([*plant.gravity, plant.gravity_factor]),
            np.zeros((4 + WORK, n)),
            self._noise,
            loss_table(plant.encoder_losses, n),
            push_table(plant.pushes, {"hand": payload, **links}),
            payload_table(plant.payload),
            obstacles,
            self._contact,
            np.array([payload, hand, *links.values(), 0], dtype=np.float64),  # 0: the world
            model.body_mass,
            model.body_subtreemass,
            data.xfrc_applied,
            data.ctrl,
            data.qpos,
            data.qvel,
            arm.rotors,
            data.sensordata,
            wrist.coefficients,
            wrist.memory,
            wrist.filtered,
        )
        self.channels = _channels(robot.joint_names, bool(plant.obstacles), bool(arm.scale))
        self.readings = np.zeros(sum(channel.size for channel in self.channels))
        self._joint_readings = self.readings[: len(_JOINT_CHANNELS) * n].reshape(-1, n)
        self._other_readings = self.readings[len(_JOINT_CHANNELS) * n :]
        self.effort = self._joint_readings[list(_JOINT_CHANNELS).index("spring_torque")]
        self.wrench = self._other_readings[0:6]
        self._rotors = arm.rotors.astype(np.intp)
        self._measure()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return float(self._shared[column.TICKS]) * TICK

    @property
    def mode(self) -> str:
        """Mode of the joint controllers."""
        return next(name for name, number in column.MODES.items() if number == self._shared[column.MODE])

    @property
    def target(self) -> Array:
        """The angles q_desired as commanded, shape (n,), rad."""
        return self._state[:, column.TARGET].copy()

    @property
    def reference(self) -> Array:
        """The angles that the joint controllers follow, shape (n,), rad."""
        return self._state[:, column.REFERENCE].copy()

    @property
    def encoders(self) -> Array:
        """The encoders' last readings, before their filters, shape (n,), rad."""
        return self._state[:, column.ENCODER].copy()

    @property
    def servo_stiffness(self) -> Array:
        """The gains of the modes THETA and THETA_MJ, shape (n,), N·m/rad."""
        return self._arm.constants[:, column.SERVO_P].copy()

    def _fault_in_words(self) -> str:
        what, joint = column.FAULTS[int(self._shared[column.FAULT])], int(self._shared[column.FAULTY_JOINT])
        return what if joint < 0 else f"{self._arm.robot.joint_names[joint]}: {what}"

    def switch(self, mode: str) -> None:
        """Ask for another mode, which takes over within the ramp time, and clear a fault.

        Raises
        ------
        UnknownNameError
            If there is no such mode.
        """
        if mode not in column.MODES:
            raise unknown_name("mode", str(mode), column.MODES)
        self._shared[column.ASKED_MODE] = column.MODES[mode]
        self._shared[column.FAULT], self.fault = 0.0, ""

    def step(self, command: ArrayLike) -> None:
        """Move the arm for one control period; see `LivePlant.step`."""
        moves = self._moves
        np.multiply(as_command(command, len(moves)), self._arm.ticks * TICK, out=moves)
        self._shared[column.AGE] = 0.0
        self._advance(self._arm.ticks, self._from_measured)

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
            self._advance(min(ticks, self._arm.ticks), False)
            ticks -= self._arm.ticks

    def _advance(self, ticks: int, from_measured: bool) -> None:
        self._draw()
        self._contact[:] = 0.0
        if advance(*self._physics, ticks, self._arm.steps, self._moves, from_measured, *self._tables):
            raise DivergedError(f"plant: the arm diverged before {self.time:g} s, q = {self.q}")
        self._measure()
        if self._shared[column.FAULT] and not self.fault:
            self.fault = self._fault_in_words()
            warnings.warn(
                f"{self.fault}: the motors are off since before {self.time:g} s", SafetyWarning, stacklevel=3
            )

    def _draw(self) -> None:
        if self._noise_scale:
            self._rng.standard_normal(out=self._noise)
            self._noise *= self._noise_scale

    def _measure(self) -> None:
        state, shared, other = self._state, self._shared, self._other_readings
        self.measured[:] = state[:, column.ANGLE]
        self._joint_readings[0] = self.data.qpos[self._rotors]
        self._joint_readings[1:] = state.T[_JOINT_COLUMNS]
        self._wrist.read(self.time, self._rng, other[0:6])
        if self._pushed:
            forces = self.data.xfrc_applied[:, :3]
            np.subtract(forces.sum(axis=0), forces[self._touched], out=other[6:9])
        other[9], other[10] = shared[column.PAYLOAD], shared[column.MODE]
        if len(self._contact):
            other[11:14] = self._contact[:3]
        if self._scale:
            self._scale.weigh(self.measured, other[0:6])
            other[-1] = self._scale.mass


def _channels(joints: tuple[str, ...], contact: bool, weighed: bool) -> tuple[Channel, ...]:
    """Return what is read, in the order of `LiveCompliant.readings`."""
    axes = ("x", "y", "z")
    return (
        *(Channel(name, joints, unit) for name, unit in _JOINT_CHANNELS.items()),
        Channel("wrist_force", axes, "N"),
        Channel("wrist_torque", axes, "N·m"),
        Channel("push", axes, "N"),
        Channel("payload", (), "kg"),
        Channel("mode", (), ""),
        *([Channel("contact", axes, "N")] if contact else []),
        *([Channel("payload_estimate", (), "kg")] if weighed else []),
    )
