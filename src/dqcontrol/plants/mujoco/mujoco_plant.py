"""An arm with masses under position servos or an impedance, moved by MuJoCo: the plant, and the arm in motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.contact import Impedance, PreparedImpedance
from dqcontrol.errors import DivergedError, ValueRangeError, as_each
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.mujoco.gripper import Gripper, LiveGripper, Pads, add_gripper, fingers
from dqcontrol.plants.mujoco.mujoco_model import (
    JointServos,
    add_inertias,
    compiled,
    mass_matrix,
    skeleton,
    viscous_damping,
)
from dqcontrol.plants.mujoco.world_model import WorldContacts, add_links, add_world
from dqcontrol.plants.mujoco.wrist_sensor import TOOL, MujocoWrist, add_wrist
from dqcontrol.plants.plant import Channel, RunningPlant, as_command, plants_that_drive, start_within_limits
from dqcontrol.plants.sensors import Wrist
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.robot import Robot, base_coordinates
from dqcontrol.world import World

_STEP = 1e-5  # rad, m and their rates, for slopes
_OF_SERVOS = ("bandwidth", "damping_ratio", "stiffness", "damping", "pads")


class TorqueDrive:
    """What steps a model with a new torque at every time step, in place of its servos.

    The servos stay as what moves the targets and clips the torques: without gains, their bias is the torque.
    """

    def __init__(self, plant: MujocoPlant, robot: Robot, model: Any, data: Any) -> None:
        law = plant.prepared_impedance(robot)  # MuJoCo bears the weight, that of tools and grippers too
        assert plant.impedance is not None
        assert law is not None
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
        self.law: PreparedImpedance = law
        self.law.check_period(data.qpos[:n].copy(), plant.timestep)
        model.actuator_gainprm[:n] = 0.0
        model.actuator_biasprm[:n] = 0.0
        data.act[:n] = data.qpos[:n]
        self._q, self._rates = data.qpos[:n], data.qvel[:n]
        self._target, self._leads = data.act[:n], data.ctrl[:n]
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
            behind = self.law.torque(*(at - change).reshape(4, n), wrench=_NOTHING)
            slopes[:, i] = (ahead - behind) / (2 * _STEP)
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
        self._gripper = LiveGripper(plant.gripper, model, data, len(robot.ends)) if plant.gripper else None
        world, period = plant.world, substeps * plant.timestep
        self._world = WorldContacts(world, robot, model, data, period, seed) if world else None
        if self._world is not None:
            self._world.check_start()
            self.seen = self._world.bodies.seen
        self._wrist = MujocoWrist(plant.wrist, model, data, seed) if plant.wrist else None
        if self._wrist is not None:
            self.wrench: Array = self._wrist.wrench
        parts = (self._world, self._wrist, self._gripper)
        self._parts = [part for part in parts if part is not None]
        channels = [channel for part in self._parts for channel in part.channels]
        self.channels: tuple[Channel, ...] = tuple(channels)
        self.readings: Array = np.zeros(sum(channel.size for channel in self.channels))
        self._read()
        self._rate, self._target = data.ctrl[:n], data.act
        self._advance = self._wrist.advance if self._wrist else import_mujoco().mj_step
        self.drive = TorqueDrive(plant, robot, model, data) if plant.impedance else None
        if self.drive is not None:
            self._advance = self.drive.advancing(self._advance, self._wrist.filtered if self._wrist else None)
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
            body = int(self.model.body(f"link_{joint + 1}").id)
            if self._wrist is not None:
                tool = self.model.body(TOOL)
                body = int(tool.id) if tool.parentid[0] == body else body
            applied[body, :3] = force
            applied[body, 3:] = np.cross(point - self.data.xipos[body], force)

    def _read(self) -> None:
        """Read what is felt, and how far the gripper is open."""
        for part in self._parts:
            part.read()
        if self._parts:
            np.concatenate([part.readings for part in self._parts], out=self.readings)


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


class MujocoPlant(JointServos, frozen=True, kw_only=True, tag="mujoco"):
    """Joints with masses, gravity and torque limits, held by position servos or by an impedance.

    Each servo applies τ = k_p (q* − q) − k_d q̇, clipped to the joint's effort limit. The velocity command u
    becomes servo targets once a period T; the target q* moves linearly from where it is to its new value over
    the period, as the interpolators of real arms do: a target that jumped would kick the joints by k_p T u.

    The arm starts at rest and in balance: the first target is start + τ_g / k_p, with τ_g the part of the
    gravity torque that is not compensated. As that part changes with the configuration, the joints sag.
    Position limits are mechanical stops, where a joint has both.

    With ``impedance`` the arm is driven by torque: at each time step those of springs and dampers between the end
    effector and its pose at the targets, with the same limits, in place of the servos'. Measured are then the
    targets, which are what a law leads; else it would wind up the springs of an arm that gives way.

    Parameters
    ----------
    command_mode
        ``"integrated"``: q* grows by T u, whatever the joint does; at constant u the joint moves with
        velocity u, k_d / k_p seconds late. ``"measured"``: q* = measured q + T u, as of drivers that add the
        command to the encoder's reading; the joint then settles at the velocity u k_p T / (k_p T + k_d) and
        gives way to whatever part of gravity is not compensated.
    bandwidth
        Hz; k_p = M (2π bandwidth)² for each joint, M the diagonal of the joint-space inertia at the start,
        armature included: one number, or one a joint. In specs ``file`` names a plant file of `dqcontrol identify`,
        of which bandwidths, damping ratios, encoders and the command mode are taken.
    damping_ratio
        ζ; k_d = 2 ζ √(k_p M): one number, or one a joint.
    stiffness, damping
        k_p (N·m/rad or N/m) and k_d (N·m·s/rad or N·s/m) in place of those: one number, or one a joint.
    timestep
        s; the control period must be a multiple of it.
    gravity
        m/s² in the base frame; (0, 0, 0) for none.
    gravity_compensation
        Share of the gravity torque that the arm's own controller adds, 0 to 1; 1 as in most industrial arms.
    armature
        Rotor inertia seen at the joint, kg m² (kg for sliding joints): one number, or one a joint.
    viscous_friction, dry_friction
        N·m·s/rad and N·m (N·s/m and N): one number, or one a joint.
    gripper
        At each end effector; none if omitted.
    pads
        On both of two end effectors, to carry something between them; none if omitted.
    wrist
        A force sensor at the end effector with a tool; nothing if omitted.
    impedance
        See `dqcontrol.contact.Impedance`; position servos if omitted. Its sensor is the wrist's, without noise.
    world
        What links touch, each other included; nothing if omitted. A spec gives its own.
    position_limit
        True: targets do not leave the position limits either.
    encoder_resolution
        Step of the measured position, rad or m: one number, or one a joint; 0 for none.
    encoder_noise
        Standard deviation of the measured position, rad or m, white: one number, or one a joint.

    Raises
    ------
    UnknownNameError, ValueRangeError, ShapeError
        If a parameter lies outside of what is allowed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm = dqc.load_robot("iiwa7")
    >>> plant = MujocoPlant(bandwidth=10).start(arm, np.full(7, 0.3), period=0.01, steps=1, seed=0)
    >>> plant.step(np.zeros(7))
    >>> bool(abs(plant.q - 0.3).max() < 1e-6)
    True
    """

    gripper: Gripper | None = None
    pads: Pads | None = None
    wrist: Wrist | None = None
    impedance: Impedance | None = None
    world: World | None = None
    touches_world: ClassVar[bool] = True

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningMujoco:
        """Return the arm at rest at start.

        Parameters
        ----------
        robot
            An arm with inertias.
        start
            First configuration, shape (n,), rad or m, within the position limits.
        period
            Control period T, s.
        steps
            Number of periods; a live arm can be stepped further, as its noise is drawn step by step.
        seed
            Of the encoder noise; the same seed gives bit-equal runs.

        Raises
        ------
        MissingExtraError
            If mujoco is not installed.
        ShapeError, ValueRangeError
            If start, period or a parameter does not fit the robot, its inertias do not allow physics, or its effort
            limits cannot hold it at start.
        """
        if base_coordinates(robot).any():
            raise ValueRangeError(
                f"plant.kind: mujoco moves arms, and {robot.name} has a mobile base; {plants_that_drive(robot)}"
            )
        if robot.follows:
            raise ValueRangeError(
                f"plant.kind: in physics of {robot.name} {robot.follows[0]} would have to follow another joint "
                "(mimic), which no servo of it does; take the ideal or the servo plant"
            )
        if self.pads is not None and (self.world is None or self.gripper is not None):
            others = "'world'" if self.world is None else "pads or a gripper, not both"
            raise ValueRangeError(f"plant.pads: press a body of the world between them; give {others}")
        start = start_within_limits(robot, start)
        substeps = self.substeps(period)
        mujoco, model = import_mujoco(), self._model(robot, start)
        data: Any = mujoco.MjData(model)
        data.qpos[: len(start)] = start
        mujoco.mj_forward(model, data)
        self.set_servos(robot, model, data, start, np.arange(len(start)))
        mujoco.mj_forward(model, data)
        if self.pads is not None:
            data.act[:] += self.pads.squeezed(robot, start)
        return RunningMujoco(self, robot, model, data, substeps, seed)

    def _model(self, robot: Robot, start: Array) -> Any:
        """Build the model; gains are set later, at the start configuration."""
        mujoco = import_mujoco()
        n = robot.configuration_size
        spec = skeleton(robot)
        add_inertias(spec, robot)
        self.add_servos(spec, robot)
        if self.world is None:
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT  # nothing here touches anything
        else:
            add_links(spec, robot, self.timestep, padded=self.pads is not None, gripper=self.gripper)
            add_world(spec, self.world.bodies, self.timestep)
            spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC  # with friction as stiff as pressure allows:
            spec.option.impratio = 50.0  # no creeping
            # what lies costs nothing
            spec.option.enableflags |= getattr(mujoco.mjtEnableBit, "mjENBL_SLEEP", 0)
        if self.pads is not None:
            self.pads.add(spec, robot, start, self.timestep)
        if self.wrist is not None:
            add_wrist(spec, self.wrist, robot, self.timestep, self.gravity_compensation)
        if self.gripper is not None:
            for k, row in enumerate(robot.ends):
                link = spec.body(f"link_{int(robot.parents[row]) + 1}")
                add_gripper(spec, self.gripper, link, robot.chain[row], self.timestep, k)
                for name in fingers(k):
                    spec.body(name).gravcomp = self.gravity_compensation
        for i, name in enumerate(robot.joint_names):
            spec.body(f"link_{i + 1}").gravcomp = self.gravity_compensation
            spec.joint(name).actgravcomp = True
        model = compiled(spec)
        viscous_damping(model)[:n] = as_each("plant.viscous_friction", self.viscous_friction, n)
        return model

    def by_effort(self) -> Self:
        """Return it with servos that only hold, while nothing drives the joints."""
        return replace(self, impedance=None)

    def prepared_impedance(self, robot: Robot) -> PreparedImpedance | None:
        """Return its impedance for a robot, with what MuJoCo leaves of the weight."""
        if self.impedance is None:
            return None
        return self.impedance.prepare(robot, self.gravity, 1.0 - self.gravity_compensation, self.armature)

    def compliance(self, robot: Robot, start: Array) -> Array:
        """Return 1/k_p of each joint at start; 0 of an impedance, which is on the safe side."""
        live = self.start(robot, start, self.timestep, 1, 0)
        return np.zeros(len(start)) if live.drive is not None else 1.0 / live.stiffness

    def linear_model(self, robot: Robot, start: Array, period: float) -> LinearModel:
        """Return all joints together, coupled by their inertia at start, in MuJoCo's own time steps.

        A step h takes v⁺ = (M + hD)⁻¹ (M v + h k_p (q* − q)) with D of servos and viscous friction, then
        q⁺ = q + h v⁺. What changes with the configuration (gravity, inertia), dry friction, effort limits and
        encoders are left out. Torques of an impedance are taken by their slopes;
        as if a law saw the joints, which move later than the targets that it sees.
        """
        h, steps, n = self.timestep, self.substeps(period), robot.configuration_size
        live = self.start(robot, start, period, 1, 0)
        if live.drive is not None:
            return live.drive.linear_model(live.model, live.data, h, steps, viscous_damping(live.model)[:n])
        mass, unit, zero = mass_matrix(live.model, live.data)[:n, :n], np.eye(n), np.zeros((n, n))
        damping = np.diag(live.damping + viscous_damping(live.model)[:n])
        pull = h * np.linalg.solve(mass + h * damping, np.diag(live.stiffness))
        velocity = np.hstack([-pull, np.linalg.solve(mass + h * damping, mass), pull])
        step = np.eye(3 * n)  # of q, v and q*
        step[n : 2 * n] = velocity
        step[:n] += h * velocity
        transition, inputs = np.eye(3 * n), np.zeros((3 * n, n))
        for _ in range(steps):
            transition, inputs = step @ transition, step @ inputs
            inputs[2 * n :] += h * unit
        if self.command_mode == "measured":  # the target moves at the rate that ends at measured + T u
            transition += inputs @ np.hstack([unit, zero, -unit]) / period
        return LinearModel(transition, inputs)
