"""State of a compliant arm between control periods, by name: one memory of ours, and MuJoCo's own arrays."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, WRITE2, types
from dqcontrol.compiled.memory_layout import Bundle, MemoryLayout
from dqcontrol.plants.compliant.joint_columns import COEFFICIENTS, CONSTANTS, MEMORY, SHARED, STATE
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
    constants: Annotated[Array, "joints", CONSTANTS]
    state: Annotated[Array, "joints", STATE]
    shared: Annotated[Array, SHARED]
    chain: Annotated[Array, "joints + 1", 8]
    bodies: Annotated[Array, "joints", 4]
    rotors: Annotated[Array, "joints"]
    losses: Annotated[Array, "losses", 3]
    pushes: Annotated[Array, "pushes", 6]
    payloads: Annotated[Array, "payloads", 3]
    carriers: Annotated[Array, "joints + 3"]
    wrist_filter: Annotated[Array, COEFFICIENTS]
    wrist_memory: Annotated[Array, 6, MEMORY]
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


MEMORY_SIZES = ArmPlan._fields[5:]
arm_plan: MemoryLayout[ArmPlan] = MemoryLayout(ArmPlan)
arm_memory: MemoryLayout[ArmMemory] = MemoryLayout(ArmMemory, *MEMORY_SIZES)
physics_arrays: Bundle[PhysicsArrays] = Bundle(PhysicsArrays)
