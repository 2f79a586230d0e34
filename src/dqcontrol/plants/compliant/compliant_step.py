"""A control period of a compliant arm: joint controllers at 1 kHz, MuJoCo's steps between them, sensors after them."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

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
from dqcontrol.compiled.intrinsics import ADDRESS, as_matrix, c_caller
from dqcontrol.errors import MissingExtraError
from dqcontrol.plants.compliant import joint_columns as column
from dqcontrol.plants.compliant.elastic_model import TICK
from dqcontrol.plants.compliant.filters import COEFFICIENTS, MEMORY, filtered, rest
from dqcontrol.plants.compliant.joint_controller import control, sense
from dqcontrol.plants.compliant.obstacle import touch
from dqcontrol.plants.mujoco.mujoco_model import import_mujoco
from dqcontrol.robots.gravity import WORK

FASTEST = 1e4  # rad/s; a joint beyond it has diverged
PHYSICS_STEP = types.void(types.intp, types.intp)  # void mj_step(const mjModel *, mjData *)
_call_step = c_caller(PHYSICS_STEP)

ADVANCE = STATUS(
    ADDRESS,  # of MuJoCo's step
    types.intp,  # address of the model
    types.intp,  # address of its data
    types.intp,  # ticks
    types.intp,  # steps a tick
    READ,  # how each target moves, rad
    types.boolean,  # from the measured angle
    READ2,  # constants, joint_table
    WRITE2,  # state
    WRITE,  # shared
    READ2,  # chain
    READ2,  # bodies of the controllers' model
    READ,  # gravity (3), factor on the model's torque
    WRITE2,  # scratch, (4 + WORK) × n
    READ2,  # encoder noise, a row a tick
    READ2,  # times without encoder: from, until, joint
    READ2,  # pushes: from, until, body, force
    READ2,  # payloads: from, until, mass
    READ2,  # obstacles, rows of `obstacle`
    WRITE,  # largest force of contact yet, and its norm
    READ,  # bodies that carry the payload, itself first
    WRITE,  # masses of the model
    WRITE,  # masses of its subtrees
    WRITE2,  # forces on its bodies
    WRITE,  # motors
    READ,  # coordinates
    READ,  # velocities
    READ,  # coordinates of the rotors, by number
    READ,  # wrench
    READ,  # coefficients of its filter
    WRITE2,  # memory of its filter
    WRITE,  # filtered wrench
)


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
def spring_torque(constants, state, qpos, qvel, rotor, i):
    """Return the torque that joint i's spring exerts on its link; a rigid joint's motor exerts it itself."""
    if constants[i, column.SPRING] == 0.0:
        return state[i, column.MOTOR_TORQUE]
    k = int(rotor[i])
    return constants[i, column.SPRING] * (qpos[k] - qpos[i]) + constants[i, column.SPRING_DAMPING] * (
        qvel[k] - qvel[i]
    )


@inline
def load(time, shared, pushes, payloads, carriers, mass, subtree_mass, forces):
    """Set what pushes and hangs on the arm at a time."""
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
    change = payload - shared[column.PAYLOAD]
    if change != 0.0:
        shared[column.PAYLOAD] = payload
        mass[int(carriers[0])] = payload
        for k in range(carriers.shape[0]):
            subtree_mass[int(carriers[k])] += change


@kernel(ADVANCE)
def advance(
    physics,
    model,
    data,
    ticks,
    steps,
    moves,
    from_measured,
    constants,
    state,
    shared,
    chain,
    bodies,
    gravity,
    scratch,
    noise,
    losses,
    pushes,
    payloads,
    obstacles,
    contact,
    carriers,
    mass,
    subtree_mass,
    forces,
    motors,
    qpos,
    qvel,
    rotor,
    wrench,
    wrench_filter,
    wrench_memory,
    filtered_wrench,
):
    """Move the targets, then let controllers and physics run for a number of ticks."""
    n = state.shape[0]
    for i in range(n):
        target = moves[i] + (state[i, column.ANGLE] if from_measured else state[i, column.TARGET])
        state[i, column.TARGET] = min(max(target, constants[i, column.LOWER]), constants[i, column.UPPER])
    for tick in range(ticks):
        time = (
            shared[column.TICKS] + 0.5
        ) * TICK  # of the tick's middle: no doubt about what begins or ends at its edge
        for i in range(n):
            scratch[2, i] = qpos[int(rotor[i])]
            scratch[3, i] = qvel[int(rotor[i])]
        control(
            constants,
            state,
            shared,
            chain,
            bodies,
            gravity[0:3],
            gravity[3],
            scratch[0],
            scratch[1],
            as_matrix(scratch[4:], 1, WORK * n)[0],
            scratch[2],
            scratch[3],
        )
        for i in range(n):
            motors[i] = state[i, column.MOTOR_TORQUE]
        load(time, shared, pushes, payloads, carriers, mass, subtree_mass, forces)
        for step in range(steps):
            if obstacles.shape[0] > 0:
                touch(
                    obstacles,
                    (shared[column.TICKS] + step / steps) * TICK,
                    chain,
                    qpos,
                    qvel,
                    forces,
                    contact,
                )
            _call_step(physics, model, data)
        shared[column.TICKS] += 1.0
        total = 0.0
        for i in range(qvel.shape[0]):
            total += qvel[i] * qvel[i]
        if not total < FASTEST * FASTEST:
            return NOT_FINITE
        for i in range(n):
            lost = False
            for k in range(losses.shape[0]):
                if losses[k, 0] <= time < losses[k, 1] and losses[k, 2] == i:
                    lost = True
            sense(
                constants[i],
                state[i],
                qpos[i] + noise[tick, i],
                spring_torque(constants, state, qpos, qvel, rotor, i),
                lost,
            )
        for i in range(6):
            filtered_wrench[i] = filtered(wrench_filter, wrench_memory[i], wrench[i])
    return OK


@kernel(STATUS(READ2, WRITE2, READ, READ, READ, READ, READ, READ, WRITE2, WRITE))
def settle(constants, state, qpos, qvel, rotor, noise, wrench, wrench_filter, wrench_memory, filtered_wrench):
    """Set sensors and filters as if the arm had been where it is for ever."""
    for i in range(state.shape[0]):
        sense(
            constants[i],
            state[i],
            qpos[i] + noise[i],
            spring_torque(constants, state, qpos, qvel, rotor, i),
            False,
        )
        state[i, column.ANGLE] = state[i, column.ENCODER]
        rest(
            constants[i, column.ANGLE_FILTER : column.ANGLE_FILTER + COEFFICIENTS],
            state[i, column.ANGLE_MEMORY : column.ANGLE_MEMORY + MEMORY],
            state[i, column.ENCODER],
        )
        state[i, column.VELOCITY] = state[i, column.TORQUE_RATE] = 0.0
        state[i, column.VELOCITY_MEMORY : column.TORQUE_RATE_MEMORY + MEMORY] = 0.0
    for i in range(6):
        rest(wrench_filter, wrench_memory[i], wrench[i])
        filtered_wrench[i] = wrench[i]
    return OK
