"""A control period of a compliant arm: joint controllers at 1 kHz, MuJoCo's steps between them, sensors after them."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import (
    NOT_FINITE,
    OK,
    READ,
    READ2,
    STATUS,
    WRITE,
    WRITE2,
    inline,
    kernel,
    types,
)
from dqcontrol.compiled.intrinsics import c_caller
from dqcontrol.compiled.memory_layout import Bundle, MemoryLayout
from dqcontrol.errors import MissingExtraError
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.joint_columns import filtered, rest
from dqcontrol.plants.compliant.joint_controller import control, sense
from dqcontrol.robots.files.mjcf import import_mujoco
from dqcontrol.robots.kinematics.gravity import WORK

ARM_PLAN = types.Array(types.intp, 1, "C")


class ArmPlan(NamedTuple):
    """What is called, how often, and the sizes of the memory.

    Attributes
    ----------
    step, model, data
        Addresses of MuJoCo's step, of the model and of its data.
    steps
        Of the physics in a tick of the joint controllers.
    from_measured
        Whether a target is taken from the measured angle, 0 or 1.
    joints, losses, pushes, payloads
        Sizes of `ArmMemory`.
    """

    step: int
    model: int
    data: int
    steps: int
    from_measured: int
    joints: int
    losses: int
    pushes: int
    payloads: int


class ArmMemory(NamedTuple):
    """Tables of the joint controllers and of what acts on the arm, and scratch.

    Attributes
    ----------
    gravity, gravity_factor
        m/s², base frame, and the factor on the torque of the controllers' model.
    constants, state, shared
        Of the joint controllers: see `joint_columns`.
    chain
        Of the robot.
    bodies
        Of the controllers' model of gravity.
    rotors
        Which coordinate of the model is each joint's motor.
    losses
        Times without encoder: from, until, joint from 0.
    pushes
        From, until, body, force (3).
    payloads
        From, until, mass.
    carriers
        Bodies that carry the payload, itself first.
    wrist_filter, wrist_memory, wrench
        Coefficients and memory of the wrist sensor's filter, and the filtered wrench.
    angles, torques, rotor_angles, rotor_velocities, work
        Scratch.
    """

    gravity: Annotated[Array, 3]
    gravity_factor: float
    constants: Annotated[Array, "joints", column.CONSTANTS]
    state: Annotated[Array, "joints", column.STATE]
    shared: Annotated[Array, column.SHARED]
    chain: Annotated[Array, "joints + 1", 8]
    bodies: Annotated[Array, "joints", 4]
    rotors: Annotated[Array, "joints"]
    losses: Annotated[Array, "losses", 3]
    pushes: Annotated[Array, "pushes", 6]
    payloads: Annotated[Array, "payloads", 3]
    carriers: Annotated[Array, "joints + 3"]
    wrist_filter: Annotated[Array, column.COEFFICIENTS]
    wrist_memory: Annotated[Array, 6, column.MEMORY]
    wrench: Annotated[Array, 6]
    angles: Annotated[Array, "joints"]
    torques: Annotated[Array, "joints"]
    rotor_angles: Annotated[Array, "joints"]
    rotor_velocities: Annotated[Array, "joints"]
    work: Annotated[Array, f"{WORK} * joints"]


class PhysicsArrays(NamedTuple):
    """MuJoCo's own: coordinates, velocities, motors, sensors, forces on bodies, masses of bodies and their subtrees."""

    positions: Annotated[Array, READ]
    velocities: Annotated[Array, READ]
    motors: Annotated[Array, WRITE]
    sensors: Annotated[Array, READ]
    forces: Annotated[Array, WRITE2]
    masses: Annotated[Array, WRITE]
    subtree_masses: Annotated[Array, WRITE]


arm_plan: MemoryLayout[ArmPlan] = MemoryLayout(ArmPlan)
arm_memory: MemoryLayout[ArmMemory] = MemoryLayout(ArmMemory, *ArmPlan._fields[5:])
physics_arrays: Bundle[PhysicsArrays] = Bundle(PhysicsArrays)

FASTEST = 1e4  # rad/s; a joint beyond it has diverged
PHYSICS_STEP = types.void(types.intp, types.intp)  # void mj_step(const mjModel *, mjData *)
_call_step = c_caller(PHYSICS_STEP)

# plan, memory, MuJoCo's arrays, ticks, how each target moves (rad), encoder noise (a row a tick)
ADVANCE = STATUS(ARM_PLAN, WRITE, physics_arrays.type, types.intp, READ, READ2)
# plan, memory, MuJoCo's arrays, encoder noise
SETTLE = STATUS(ARM_PLAN, WRITE, physics_arrays.type, READ)


@cache
def physics_step() -> int:
    """Return the address of MuJoCo's ``mj_step``, for kernels.

    Raises
    ------
    MissingExtraError
        If MuJoCo's library is not where its package keeps it.
    """
    folder = Path(import_mujoco().__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    found = [path for name in names for path in sorted(folder.glob(name))]
    if not found:
        raise MissingExtraError(f"mujoco: has no library in {folder}; pip install 'dqcontrol[physics]'")
    return ctypes.cast(ctypes.CDLL(str(found[0])).mj_step, ctypes.c_void_p).value or 0


@inline
def unpack(plan, memory):
    """Return plan and memory by name."""
    sizes = arm_plan(plan)
    return sizes, arm_memory(memory, *sizes[5:])


@inline
def spring_torque(arm, physics, i):
    """Return the torque that joint i's spring exerts on its link; a rigid joint's motor exerts it itself."""
    constants = arm.constants[i]
    if constants[column.SPRING] == 0.0:
        return arm.state[i, column.MOTOR_TORQUE]
    k, damping = int(arm.rotors[i]), constants[column.SPRING_DAMPING]
    stretch, rate = physics.positions[k] - physics.positions[i], physics.velocities[k] - physics.velocities[i]
    return constants[column.SPRING] * stretch + damping * rate


@inline
def load(arm, physics, time):
    """Set what pushes and hangs on the arm at a time."""
    pushes, payloads, forces = arm.pushes, arm.payloads, physics.forces
    for k in range(pushes.shape[0]):
        for i in range(3):
            forces[int(pushes[k, 2]), i] = 0.0
    for k in range(pushes.shape[0]):
        if pushes[k, 0] <= time < pushes[k, 1]:
            for i in range(3):
                forces[int(pushes[k, 2]), i] += pushes[k, 3 + i]
    payload = 0.0
    for k in range(payloads.shape[0]):
        if payloads[k, 0] <= time < payloads[k, 1]:
            payload += payloads[k, 2]
    change = payload - arm.shared[column.PAYLOAD]
    if change != 0.0:
        arm.shared[column.PAYLOAD] = payload
        physics.masses[int(arm.carriers[0])] = payload
        for k in range(arm.carriers.shape[0]):
            physics.subtree_masses[int(arm.carriers[k])] += change


@inline
def sense_arm(arm, physics, noise, time):
    """Read all joints' sensors at a time, their encoders with this noise, rad, and filter the wrist's."""
    losses = arm.losses
    for i in range(arm.state.shape[0]):
        lost = False
        for k in range(losses.shape[0]):
            if losses[k, 0] <= time < losses[k, 1] and losses[k, 2] == i:
                lost = True
        angle = physics.positions[i] + noise[i]
        sense(arm.constants[i], arm.state[i], angle, spring_torque(arm, physics, i), lost)
    for i in range(6):
        arm.wrench[i] = filtered(arm.wrist_filter, arm.wrist_memory[i], physics.sensors[i])


@kernel(ADVANCE)
def advance(plan, memory, physics, ticks, moves, noise):
    """Move the targets, then let controllers and physics run for a number of ticks."""
    numbers, arm = unpack(plan, memory)
    constants, state, shared = arm.constants, arm.state, arm.shared
    n = state.shape[0]
    for i in range(n):
        before = state[i, column.TOLD] if numbers.from_measured != 0 else state[i, column.ASKED]
        target = moves[i] + before
        state[i, column.ASKED] = min(max(target, constants[i, column.LOWER]), constants[i, column.UPPER])
    for tick in range(ticks):
        # of the tick's middle: no doubt about what begins or ends at its edge
        time = (shared[column.TICKS] + 0.5) * TICK
        if shared[column.TICKS] % shared[column.EXCHANGE] == 0.0:
            for i in range(n):
                state[i, column.TARGET] = state[i, column.ASKED]
        for i in range(n):
            arm.rotor_angles[i] = physics.positions[int(arm.rotors[i])]
            arm.rotor_velocities[i] = physics.velocities[int(arm.rotors[i])]
        control(arm)
        for i in range(n):
            physics.motors[i] = state[i, column.MOTOR_TORQUE]
        load(arm, physics, time)
        for _ in range(numbers.steps):
            _call_step(numbers.step, numbers.model, numbers.data)
        shared[column.TICKS] += 1.0
        total = 0.0
        for i in range(physics.velocities.shape[0]):
            total += physics.velocities[i] * physics.velocities[i]
        if not total < FASTEST * FASTEST:
            return NOT_FINITE
        sense_arm(arm, physics, noise[tick], time)
        if shared[column.TICKS] % shared[column.EXCHANGE] == 0.0:
            for i in range(n):
                state[i, column.TOLD] = state[i, column.ANGLE]
    return OK


@kernel(SETTLE)
def settle(plan, memory, physics, noise):
    """Set sensors and filters as if the arm had been where it is for ever."""
    _, arm = unpack(plan, memory)
    constants, state = arm.constants, arm.state
    for i in range(state.shape[0]):
        angle = physics.positions[i] + noise[i]
        sense(constants[i], state[i], angle, spring_torque(arm, physics, i), False)
        state[i, column.ANGLE] = state[i, column.TOLD] = state[i, column.ENCODER]
        state[i, column.ASKED] = state[i, column.TARGET]
        coefficients = constants[i, column.ANGLE_FILTER : column.ANGLE_FILTER + column.COEFFICIENTS]
        filter_memory = state[i, column.ANGLE_MEMORY : column.ANGLE_MEMORY + column.MEMORY]
        rest(coefficients, filter_memory, state[i, column.ENCODER])
        state[i, column.VELOCITY] = state[i, column.TORQUE_RATE] = 0.0
        state[i, column.VELOCITY_MEMORY : column.TORQUE_RATE_MEMORY + column.MEMORY] = 0.0
    for i in range(6):
        rest(arm.wrist_filter, arm.wrist_memory[i], physics.sensors[i])
        arm.wrench[i] = physics.sensors[i]
    return OK
