"""A compliant arm put together, in motion, one control period at a time, and as its loop sees it near its start."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import DivergedError, SafetyWarning, ValueRangeError, as_each, as_positive, unknown_name
from dqcontrol.plants.compliant import compliant_step, joint_columns as column
from dqcontrol.plants.compliant.compliant_plant import CompliantPlant
from dqcontrol.plants.compliant.controller_file import (
    ControllerFile,
    constants_table,
    gravity_bodies,
    load_controllers,
    static_state,
)
from dqcontrol.plants.compliant.elastic_model import TICK, elastic_model, steps_per_tick
from dqcontrol.plants.compliant.joint_columns import LOWER, MEMORY, UPPER, WITH_GRAVITY, butterworth
from dqcontrol.plants.compliant.loads_and_faults import (
    LiveWrist,
    PayloadScale,
    loss_table,
    payload_table,
    push_table,
)
from dqcontrol.plants.linear_model import LinearModel
from dqcontrol.plants.mujoco.mujoco_model import mass_matrix
from dqcontrol.plants.mujoco.world_model import WorldContacts
from dqcontrol.plants.plant import Channel, ControllerSettings, RunningPlant, as_command, start_within_limits
from dqcontrol.plants.sensors import AXES
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.kinematics.gravity import WORK
from dqcontrol.robots.robot import Robot


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm ready to move.

    Attributes
    ----------
    robot, file
        What it is made of.
    model, data
        MuJoCo's, at the start configuration.
    constants, state
        Of the joint controllers, columns of `joint_table`, one row a joint.
    bodies
        Table of the controllers' model of gravity, shape (n, 4).
    rotors
        Which coordinate of the model is each joint's motor, shape (n,).
    scale
        What weighs the payload; None if nothing does.
    ticks, exchange, steps
        Ticks of the joint controllers in a period, and from one exchange with the control loop to the next; steps of
        the physics in a tick.
    """

    robot: Robot
    file: ControllerFile
    model: Any
    data: Any
    constants: Array
    state: Array
    bodies: Array
    rotors: Array
    scale: PayloadScale | None
    ticks: int
    exchange: int
    steps: int


def assemble(plant: CompliantPlant, robot: Robot, start: ArrayLike, period: float) -> Arm:
    """Put the arm of a plant together, at rest at start (n,), rad, for control periods period, s.

    Raises
    ------
    Error
        If something does not fit the robot, or its motors cannot hold it at start.
    """
    mujoco = import_mujoco()
    file = load_controllers(robot, plant.controllers)
    start, ticks, n = start_within_limits(robot, start), _ticks("period", period), robot.configuration_size
    exchange = 1 if plant.exchange_period is None else _ticks("plant.exchange_period", plant.exchange_period)
    actuation = file.actuation(plant.springs, as_each("plant.dry_friction", plant.dry_friction, n))
    elastic, hand = actuation.elastic, file.hand(plant.hand)
    scene = {"gravity": plant.gravity, "accurate": plant.accurate, "world": plant.world}
    model = elastic_model(robot, actuation, hand=hand, **scene)
    data: Any = mujoco.MjData(model)
    data.qpos[:n] = start
    mujoco.mj_forward(model, data)
    load = data.qfrc_bias[:n].copy()
    own = n + int(elastic.sum())  # coordinates of links and rotors; those of the world come after
    data.qpos[n:own] = (start + load / actuation.stiffness)[elastic]
    inertia = mass_matrix(model, data)[:own, :own]
    steps = steps_per_tick(inertia, robot, actuation, plant.accurate)
    model.opt.timestep = TICK / steps
    mujoco.mj_forward(model, data)
    moved = np.diag(inertia)[:n] + np.where(elastic, actuation.rotor_inertia, 0.0)
    constants = constants_table(plant, file, actuation, moved)
    constants[:, LOWER] = np.maximum(constants[:, LOWER], robot.limits.lower)
    constants[:, UPPER] = np.minimum(constants[:, UPPER], robot.limits.upper)
    state = static_state(robot, constants, column.MODES[plant.mode], start, load, plant.gravity_factor)
    rotors = np.arange(n, dtype=np.float64)
    rotors[elastic] = n + np.arange(np.count_nonzero(elastic))
    bodies, scale = gravity_bodies(robot, hand), None
    if plant.payload_compensation is not None:
        if plant.mode not in WITH_GRAVITY:
            raise ValueRangeError(
                f"plant.payload_compensation: needs a mode with a model of gravity, {', '.join(WITH_GRAVITY)}; "
                f"got {plant.mode}"
            )
        period = ticks * TICK  # exactly
        scale = PayloadScale(plant.payload_compensation, robot, hand, bodies, plant.gravity, period)
    return Arm(robot, file, model, data, constants, state, bodies, rotors, scale, ticks, exchange, steps)


def _ticks(field: str, period: float) -> int:
    """Return how many ticks of the joint controllers a period has."""
    period = as_positive(field, period)
    ticks = round(period / TICK)
    if ticks < 1 or abs(ticks * TICK - period) > 1e-9 * period:
        raise ValueRangeError(
            f"{field}: must be a multiple of the joint controllers' {TICK:g} s, got {period:g} s "
            f"({max(1, ticks) * TICK:g} would do)"
        )
    return ticks


_HOLDS = "THETA_GC"
_SHAKING = 1  # marks a stream of random numbers beside that of the encoders
_JOINT_CHANNELS = {
    "motor_angle": "rad",
    "reference": "rad",
    "desired_torque": "N·m",
    "spring_torque": "N·m",
    "motor_current": "A",
}
# of all but the motors' angles
_JOINT_COLUMNS = [column.REFERENCE, column.DESIRED_TORQUE, column.SENSED, column.CURRENT]


class RunningCompliant(RunningPlant):
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
    memory
        All that its kernels keep, by name.
    """

    model: Any
    data: Any
    memory: compliant_step.ArmMemory

    def __init__(self, plant: CompliantPlant, arm: Arm, seed: int) -> None:
        model, data, n = arm.model, arm.data, arm.robot.configuration_size
        self.model, self.data = model, data
        self.q: Array = data.qpos[:n]
        self.measured: Array = np.empty(n)
        self._arm, self._rng = arm, np.random.default_rng(seed)
        self._noise, self._noise_scale = np.zeros((arm.ticks, n)), plant.encoder_noise
        self._gravity = np.array(plant.gravity)
        self._shaking = plant.base_shaking / math.sqrt(arm.ticks * TICK)
        self._shaking_rng = np.random.default_rng([seed, _SHAKING])
        self._moves, self._pushed, self._idle = np.zeros(n), bool(plant.pushes), np.zeros(n)
        self._plan, self._numbers, self.memory = _memory(plant, arm)
        self._holding = self._plan.copy()  # of ticks without a new command
        self._holding[compliant_step.arm_plan.place("from_measured")] = 0
        self._physics = compliant_step.physics_arrays(
            positions=data.qpos,
            velocities=data.qvel,
            motors=data.ctrl,
            sensors=data.sensordata,
            forces=data.xfrc_applied,
            masses=model.body_mass,
            subtree_masses=model.body_subtreemass,
        )
        self._wrist = LiveWrist(arm.file.wrist_sensor, self.memory.wrench, plant.wrist_fault)
        self._springs = plant.prepared_impedance(arm.robot)
        if self._springs is not None:
            self._springs.check_period(self.q.copy(), TICK)
        self._mode = plant.mode
        self._draw()
        compliant_step.settle(self._plan, self._numbers, self._physics, self._noise[0])
        world, period = plant.world, arm.ticks * TICK
        self._world = WorldContacts(world, arm.robot, model, data, period, seed) if world else None
        self.channels: tuple[Channel, ...] = _channels(arm.robot.joint_names, bool(arm.scale))
        own = sum(channel.size for channel in self.channels)
        if self._world is not None:
            self._world.check_start()
            self.seen = self._world.bodies.seen
            self.channels = (*self.channels, *self._world.channels)
        self.readings: Array = np.zeros(sum(channel.size for channel in self.channels))
        self._joint_readings = self.readings[: len(_JOINT_CHANNELS) * n].reshape(-1, n)
        self._other_readings = self.readings[len(_JOINT_CHANNELS) * n : own]
        self._world_readings = self.readings[own:]
        self.effort: Array = self._joint_readings[list(_JOINT_CHANNELS).index("spring_torque")]
        self.wrench: Array = self._other_readings[0:6]
        self._rotors = arm.rotors.astype(np.intp)
        self._measure()

    @property
    def time(self) -> float:
        """Time since the start, s."""
        return float(self.memory.shared[column.TICKS]) * TICK

    @property
    def mode(self) -> str:
        """Mode of the joint controllers."""
        return list(column.MODES)[int(self.memory.shared[column.MODE])]

    @property
    def target(self) -> Array:
        """The angles q_desired as commanded, shape (n,), rad."""
        return self.memory.state[:, column.TARGET].copy()

    @property
    def reference(self) -> Array:
        """The angles that the joint controllers follow, shape (n,), rad."""
        return self.memory.state[:, column.REFERENCE].copy()

    @property
    def encoders(self) -> Array:
        """The encoders' last readings, before their filters, shape (n,), rad."""
        return self.memory.state[:, column.ENCODER].copy()

    def _fault_in_words(self) -> str:
        fault, joint = self.memory.shared[[column.FAULT, column.FAULTY_JOINT]].astype(int)
        what = column.FAULTS[fault]
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
        self.memory.shared[column.ASKED_MODE] = column.MODES[mode]
        self.memory.shared[column.FAULT], self.fault = 0.0, ""

    def set_joint_control(self, control: ControllerSettings) -> None:
        """Tell the joint controllers their mode, stiffness, slew rate, and torque or duty, from the next tick on.

        Slew rates stay within those of the controller file. After a fault the motors stay off until `switch`.

        Raises
        ------
        UnknownNameError
            If there is no such mode.
        """
        constants = self.memory.constants
        if control.stiffness is not None:
            constants[:, column.STIFFNESS] = control.stiffness
        if control.slew_rate is not None:
            fastest = self._arm.constants[:, column.SLEW]
            constants[:, column.SLEW] = np.minimum(TICK * control.slew_rate, fastest)
            constants[:, column.SPEED] = control.slew_rate
        if control.asked is not None:
            is_duty = (control.mode or self.mode) == "PWM"
            constants[:, column.DUTY_ASKED if is_duty else column.TORQUE_ASKED] = control.asked
        is_new = column.MODES.get(control.mode) != self.memory.shared[column.ASKED_MODE]
        if control.mode and is_new and not self.fault:
            self.switch(control.mode)

    def take_effort(self, effort: Array | None) -> None:
        """Drive the joints by torques in the plant's own mode, else hold them; see `RunningPlant.take_effort`."""
        if effort is not None:
            self.set_joint_control(ControllerSettings(self._mode, asked=effort))
        elif self.mode != _HOLDS:
            self.memory.state[:, column.ASKED] = self.memory.state[:, column.ANGLE]
            self.set_joint_control(ControllerSettings(_HOLDS))

    def step(self, command: ArrayLike) -> None:
        """Move the arm for one control period; see `RunningPlant.step`."""
        moves = self._moves
        np.multiply(as_command(command, len(moves)), self._arm.ticks * TICK, out=moves)
        self.memory.shared[column.AGE] = 0.0
        self._advance(self._plan, self._arm.ticks)

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
            self._advance(self._holding, min(ticks, self._arm.ticks))
            ticks -= self._arm.ticks

    def _advance(self, plan: NDArray[np.intp], ticks: int) -> None:
        self._draw()
        moving = self._world is not None and self._world.bodies.moves
        if moving or self._springs is not None:
            failed = self._advance_by_ticks(plan, ticks)
        else:
            arrays = self._numbers, self._physics
            failed = compliant_step.advance(plan, *arrays, ticks, self._moves, self._noise)
        if failed:
            raise DivergedError(f"plant: the arm diverged before {self.time:g} s, q = {self.q}")
        self._measure()
        if self.memory.shared[column.FAULT] and not self.fault:
            self.fault: str = self._fault_in_words()
            off = f"the motors are off since before {self.time:g} s"
            warnings.warn(f"{self.fault}: {off}", SafetyWarning, stacklevel=3)

    def _advance_by_ticks(self, plan: NDArray[np.intp], ticks: int) -> bool:
        """Take ticks one by one, at each of which bodies are elsewhere that move as they say, and torques new."""
        springs, state = self._springs, self.memory.state
        moves = self._moves if springs is None else self._moves / ticks
        for k in range(ticks):
            if self._world is not None:
                self._world.bodies.place(self.time + TICK)
            if springs is not None:
                q, rates, target = (state[:, each] for each in (column.ANGLE, column.VELOCITY, column.ASKED))
                self.memory.constants[:, column.TORQUE_ASKED] = springs.torque(q, rates, target, moves / TICK)
            if compliant_step.advance(plan, self._numbers, self._physics, 1, moves, self._noise[k : k + 1]):
                return True
            if springs is None:
                plan, moves = self._holding, self._idle
        return False

    def _draw(self) -> None:
        if self._noise_scale:
            self._rng.standard_normal(out=self._noise)
            self._noise *= self._noise_scale
        if self._shaking:  # gravity is what an arm in an accelerated base feels
            shake = self._shaking * self._shaking_rng.standard_normal(3)
            np.add(self._gravity, shake, out=self.model.opt.gravity)

    def _measure(self) -> None:
        memory, other = self.memory, self._other_readings
        self.measured[:] = memory.state[:, column.TOLD if self._springs is None else column.ASKED]
        self._joint_readings[0] = self.data.qpos[self._rotors]
        self._joint_readings[1:] = memory.state.T[_JOINT_COLUMNS]
        self._wrist.read(self.time, self._rng, other[0:6])
        if self._pushed:
            other[6:9] = self.data.xfrc_applied[:, :3].sum(axis=0)
        other[9], other[10] = memory.shared[column.PAYLOAD], memory.shared[column.MODE]
        if scale := self._arm.scale:
            scale.weigh(self.measured, other[0:6], memory.bodies)
            other[-1] = scale.mass
        if self._world is not None:
            self._world.read()
            self._world_readings[:] = self._world.readings


def _memory(plant: CompliantPlant, arm: Arm) -> tuple[NDArray[np.intp], Array, compliant_step.ArmMemory]:
    """Return the plan of an arm's kernels, their memory, and the memory's parts by name."""
    model, n = arm.model, arm.robot.configuration_size
    links = {f"link {i + 1}": model.body(f"link_{i + 1}").id for i in range(n)}
    payload = model.body("payload").id
    losses, payloads = loss_table(plant.encoder_losses, n), payload_table(plant.payload)
    pushes = push_table(plant.pushes, {"hand": payload, **links})
    shared = np.zeros(column.SHARED)
    shared[[column.MODE, column.ASKED_MODE]] = column.MODES[plant.mode]
    shared[column.RAMP], shared[column.RAMP_STEP] = 1.0, TICK / arm.file.ramp_time
    shared[column.EXCHANGE] = arm.exchange
    shared[column.MOST_AGE] = round(arm.file.safety.command_timeout / TICK)
    shared[column.MOST_LOST] = round(arm.file.safety.sensor_timeout / TICK)
    plan = compliant_step.ArmPlan(
        step=compliant_step.physics_step(),
        model=model._address,
        data=arm.data._address,
        steps=arm.steps,
        from_measured=plant.command_mode == "measured",
        joints=n,
        losses=len(losses),
        pushes=len(pushes),
        payloads=len(payloads),
    )
    numbers = compliant_step.arm_memory.pack(
        gravity=plant.gravity,
        gravity_factor=plant.gravity_factor,
        constants=arm.constants,
        state=arm.state,
        shared=shared,
        chain=arm.robot.chain,
        bodies=arm.bodies,
        rotors=arm.rotors,
        losses=losses,
        pushes=pushes,
        payloads=payloads,
        carriers=[payload, model.body("hand").id, *links.values(), 0],  # 0: the world
        wrist_filter=butterworth(arm.file.wrist_sensor.cutoff, TICK),
        wrist_memory=np.zeros((6, MEMORY)),
        wrench=np.zeros(6),
        **dict.fromkeys(("angles", "torques", "rotor_angles", "rotor_velocities"), np.zeros(n)),
        work=np.zeros(WORK * n),
    )
    return np.array(plan, dtype=np.intp), numbers, compliant_step.arm_memory(numbers, *plan[5:])


def _channels(joints: tuple[str, ...], weighed: bool) -> tuple[Channel, ...]:
    """Return what is read, in the order of `RunningCompliant.readings`."""
    return (
        *(Channel(name, joints, unit) for name, unit in _JOINT_CHANNELS.items()),
        Channel("wrist_force", AXES, "N"),
        Channel("wrist_torque", AXES, "N·m"),
        Channel("push", AXES, "N"),
        Channel("payload", (), "kg"),
        Channel("mode", (), ""),
        *([Channel("payload_estimate", (), "kg")] if weighed else []),
    )


_HORIZON = 0.2  # s, in which what matters of a state is seen: more than a spring's or a filter's time
_CHANGE = 1e-5  # rad, rad/s, N·m
_REMEMBERED = [  # by each joint controller from one period to the next; the measured angle first
    column.ANGLE,
    column.TARGET,
    column.ENCODER,
    column.VELOCITY,
    column.SENSED,
    column.TORQUE_RATE,
    *range(column.ANGLE_MEMORY, column.TORQUE_RATE_MEMORY + MEMORY),
]
_OF_THE_LOOP = {column.ANGLE: column.TOLD, column.TARGET: column.ASKED}  # the same where all ticks exchange
_LEFT_OUT = [column.POSITION_I, column.TORQUE_I, column.ANGLE_RESOLUTION, column.TORQUE_RESOLUTION]
_WITHOUT = (
    "pushes",
    "payload",
    "payload_compensation",
    "world",
    "encoder_losses",
    "encoder_noise",
    "dry_friction",
    "base_shaking",
    "wrist_fault",
)
_LIMITS = [column.SLEW, column.MAX_TORQUE, column.MAX_CURRENT, column.UPPER]


def linearised(plant: CompliantPlant, robot: Robot, start: Array, period: float) -> LinearModel | None:
    """Return all joints together: what a period makes of small changes of state and commands about rest at start.

    None if commands do not move the joints, as without stiffness, or if an exchange does not begin each period: then
    one period is not like the next.

    Left out: gravity, steps and noise of sensors, loads, dry friction, contacts, limits, and the joint controllers'
    integrals, which bear their share of gravity at their limits.
    """
    bare = type(plant)()
    still = changed(plant, gravity=(0.0, 0.0, 0.0), **{name: getattr(bare, name) for name in _WITHOUT})
    arm = assemble(still, robot, start, period)
    if arm.ticks % arm.exchange:
        return None
    at_once = arm.exchange == 1
    remembered = _REMEMBERED if at_once else [*_OF_THE_LOOP.values(), *_REMEMBERED]
    arm.constants[:, _LEFT_OUT] = 0.0
    arm.constants[:, _LIMITS] = np.inf
    arm.constants[:, column.LOWER] = -np.inf
    arm.model.jnt_limited[:] = 0
    n, mode = len(start), column.MODES[plant.mode]
    rest = static_state(robot, arm.constants, mode, arm.data.qpos[:n].copy(), np.zeros(n), 1.0)
    live = RunningCompliant(still, replace(arm, state=rest), 0)
    state, qpos, qvel = arm_state = live.memory.state, live.data.qpos, live.data.qvel
    rest = [part.copy() for part in arm_state]

    def after_a_period(change: Array, command: Array) -> Array:
        for part, before in zip(arm_state, rest, strict=True):
            part[:] = before
        known, angles, rates = np.split(change, [n * len(remembered), -len(qvel)])
        state[:, remembered] += known.reshape(-1, n).T
        if at_once:
            state[:, list(_OF_THE_LOOP.values())] = state[:, list(_OF_THE_LOOP)]
        qpos[:] += angles
        qvel[:] += rates
        live.step(command)
        return np.concatenate([state[:, remembered].T.ravel(), qpos, qvel])

    size = n * len(remembered) + len(qpos) + len(qvel)
    zero_state, idle = np.zeros(size), np.zeros(n)
    transition = _slopes(lambda change: after_a_period(change, idle), size)
    inputs = _slopes(lambda command: after_a_period(zero_state, command), n)
    return LinearModel(transition, inputs).reduced(round(_HORIZON / period))


def _slopes(function: Callable[[Array], Array], size: int) -> Array:
    """Return the derivatives of a function at zero by central differences, a column each argument."""
    steps = _CHANGE * np.eye(size)
    return np.column_stack([(function(step) - function(-step)) / (2 * _CHANGE) for step in steps])
