"""An arm in motion in MuJoCo: one control period at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, ValueRangeError, as_each
from dqcontrol.plants.mujoco.gripper import LiveGripper
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.plants.mujoco.torque_drive import TorqueDrive
from dqcontrol.plants.mujoco.world_model import WorldContacts
from dqcontrol.plants.mujoco.wrist_sensor import TOOL, MujocoWrist
from dqcontrol.plants.plant import Channel, RunningPlant, as_command
from dqcontrol.plants.wrist import CHANNELS

if TYPE_CHECKING:
    from dqcontrol.plants.mujoco.mujoco_plant import MujocoPlant
    from dqcontrol.plants.mujoco.mujoco_servos import JointServos
    from dqcontrol.robots.robot import Robot


LOST = 1e12  # rad², m²; a configuration beyond it has diverged
_MOST_RATE = 1e10  # MuJoCo's mjMAXVAL


class RunningMujoco(RunningPlant):
    """An arm in motion; made by `MujocoPlant.start`.

    Attributes
    ----------
    model, data
        MuJoCo's own model and state, for whoever needs more.
    drive
        What drives the joints by the torques of an impedance; None: position servos.
    """

    model: Any
    data: Any
    can_be_pushed = True

    def __init__(
        self, plant: MujocoPlant, robot: Robot, model: Any, data: Any, substeps: int, seed: int
    ) -> None:
        n = robot.configuration_size
        self.model, self.data = model, data
        self._parents = robot.parents
        self.q: Array = data.qpos[:n]
        self.measured: Array = np.empty(n)
        hands = len(robot.ends)
        self._gripper = LiveGripper(plant.gripper, model, data, hands) if plant.gripper else None
        period = substeps * plant.timestep
        world, self.seen = plant.world, {}
        self._world = WorldContacts(world, robot, model, data, period, seed) if world else None
        if self._world is not None:
            self._world.check_start()
            self.seen = self._world.bodies.seen
            self.channels: tuple[Channel, ...] = self._world.channels
            self.readings: Array = self._world.readings
        self._wrist = MujocoWrist(plant.wrist, model, data, seed) if plant.wrist else None
        if self._wrist is not None:
            self.channels = (*self.channels, *CHANNELS)
            self._wrist_at = len(self.readings)
            self.readings = np.concatenate([self.readings, self._wrist.readings])
            self.wrench: Array = self._wrist.wrench
        if self._gripper is not None:
            self.channels = (*self.channels, self._gripper.channel)
            self.readings = np.concatenate([self.readings, np.zeros(hands)])
        self._read()
        self._rate, self._target = data.ctrl[:n], data.act
        self._advance = self._wrist.advance if self._wrist else import_mujoco().mj_step
        self.drive = TorqueDrive(plant, robot, model, data) if plant.impedance else None
        if self.drive is not None:
            self._advance = self.drive.advancing(self._advance, self._wrist.felt if self._wrist else None)
        self._substeps = substeps
        self._period = period
        self._from_measured = plant.command_mode == "measured"
        self._encoders = JointEncoders(plant, n, seed)
        self._servos: tuple[Array, Array] | None = None  # gains and biases, while efforts drive the joints
        # What a law leads are the springs' ends: fed back, an arm that gives way would wind them up to the force of
        # a stiff one.
        self._seen = self._target[:n] if self.drive else self.q
        self._encoders.read(self._seen, self.measured)

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return self.data.time

    @property
    def torque(self) -> Array:
        """Torque of servos and gravity compensation in the last time step, shape (n,), N·m or N."""
        return self.data.qfrc_actuator[: len(self.q)].copy()

    @property
    def velocity(self) -> Array:
        """Joint velocities, shape (n,), rad/s or m/s."""
        return self.data.qvel[: len(self.q)].copy()

    @property
    def target(self) -> Array:
        """The servos' targets q*, shape (n,), rad or m."""
        return self._target.copy()

    @property
    def stiffness(self) -> Array:
        """The servos' k_p, shape (n,), N·m/rad or N/m."""
        return self.model.actuator_gainprm[: len(self.q), 0].copy()

    @property
    def damping(self) -> Array:
        """The servos' k_d, shape (n,), N·m·s/rad or N·s/m."""
        return -self.model.actuator_biasprm[: len(self.q), 2]

    def step(self, command: ArrayLike) -> None:
        """Move the arm for one control period; see `RunningPlant.step`."""
        rate = self._rate
        rate[:] = as_command(command, len(rate))
        if self._from_measured:  # the rate that ends at measured + T u
            rate += (self.measured - self._target) / self._period
        check_rate(rate)
        if self._gripper is not None:
            self._gripper.drive(self.data.time)
        if self._world is None:
            self._advance(self.model, self.data, self._substeps)
        else:
            self._world.bodies.advance(self._advance, self.model, self._substeps)
        if not self.q.dot(self.q) < LOST:
            raise DivergedError(
                f"plant: the arm diverged before {self.data.time:g} s, q = {self.q}; "
                "try a smaller timestep, less bandwidth or stiffness, or more damping"
            )
        self._encoders.read(self._seen, self.measured)
        self._read()

    def close_gripper(self, closed: bool | None = True) -> None:
        """Tell the gripper to close or to open, from the next step on, whatever its schedule says; None: as that says.

        Raises
        ------
        ValueRangeError
            If the plant has no gripper.
        """
        if self._gripper is None:
            raise ValueRangeError("close_gripper: the plant has no gripper; give it 'gripper'")
        self._gripper.told = closed

    def take_effort(self, effort: Array | None) -> None:
        """Drive the joints by efforts, without their servos; see `RunningPlant.take_effort`."""
        n = len(self.q)
        gains, biases = self.model.actuator_gainprm[:n], self.model.actuator_biasprm[:n]
        if effort is not None:
            self._servos = self._servos or (gains.copy(), biases.copy())
            gains[:], biases[:] = 0.0, 0.0
            biases[:, 0] = effort
        elif self._servos is not None:
            gains[:], biases[:] = self._servos
            self._servos, self._target[:n] = None, self.q

    def push(self, row: int, point: Array, force: Array) -> None:
        """Push a link; see `RunningPlant.push`. A wrist's sensor feels what pushes the link at its end effector."""
        applied = self.data.xfrc_applied
        applied[:] = 0.0
        joint = int(self._parents[row]) if row >= len(self.q) else row  # behind the joints: end effectors
        if joint >= 0:
            body = self._body_of(joint)
            applied[body, :3] = force
            applied[body, 3:] = np.cross(point - self.data.xipos[body], force)

    def _body_of(self, joint: int) -> int:
        """Return the body that a link is, or what hangs on its wrist's sensor."""
        link = int(self.model.body(f"link_{joint + 1}").id)
        if self._wrist is None:
            return link
        tool = int(self.model.body(TOOL).id)
        return tool if self.model.body(tool).parentid[0] == link else link

    def _read(self) -> None:
        """Read what is felt, and how far the gripper is open."""
        if self._world is not None:
            self._world.read()
            self.readings[: len(self._world.readings)] = self._world.readings
        if self._wrist is not None:
            self._wrist.read()
            self.readings[self._wrist_at : self._wrist_at + len(self._wrist.readings)] = self._wrist.readings
        if self._gripper is not None:
            self._gripper.read(self.readings[-self._gripper.channel.size :])


def check_rate(rate: Array) -> None:
    """Say that a run diverged where MuJoCo would take a rate for a mistake, and silently let go of all servos."""
    largest = np.abs(rate).max()
    if not largest < _MOST_RATE:
        raise DivergedError(f"plant: a command of {largest:g} rad/s; MuJoCo takes less than {_MOST_RATE:g}")


class JointEncoders:
    """The encoders of n joints, with the plant's noise and resolution."""

    def __init__(self, plant: JointServos, n: int, seed: int) -> None:
        noise = as_each("plant.encoder_noise", plant.encoder_noise, n)
        self._noise = noise if noise.any() else None
        self._rng = np.random.default_rng(seed)
        resolution = as_each("plant.encoder_resolution", plant.encoder_resolution, n)
        self._stepped = np.flatnonzero(resolution)
        self._resolution = resolution[self._stepped]

    def read(self, q: Array, measured: Array) -> None:
        """Write what the encoders show at q."""
        measured[:] = q
        if self._noise is not None:
            measured += self._noise * self._rng.standard_normal(len(measured))
        if len(self._stepped):
            measured[self._stepped] = np.round(measured[self._stepped] / self._resolution) * self._resolution
