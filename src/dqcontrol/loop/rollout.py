"""The closed loop, compiled: one function for every robot, law and plant."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, kernel
from dqcontrol.compiled.intrinsics import ADDRESS, caller
from dqcontrol.compiled.memory_layout import Bundle
from dqcontrol.contact.contact_layout import WRENCH
from dqcontrol.controller.command_kernel import LAW_FAILED, PLAN, compute_command, note_sent, unpack
from dqcontrol.plants.disturbance import DISTURBANCE, ROW
from dqcontrol.plants.plant import PLANT, CompiledPlant
from dqcontrol.supervisor.supervisor_layout import AT_REST, NOW, SUPERVISOR

PLANT_FAILED = 2 * LAW_FAILED  # added to the status of what failed; the kinematics' own stays
HALTED = AT_REST  # by the supervisor

SETTLED = STATUS(READ, READ, READ, WRITE)

_call_supervisor, _call_disturbance = caller(SUPERVISOR), caller(DISTURBANCE)
_call_plant, _call_settled = caller(PLANT), caller(SETTLED)


class Stages(NamedTuple):
    """Addresses of what a loop calls; 0 for none."""

    kinematics: Annotated[int, ADDRESS]
    supervisor: Annotated[int, ADDRESS]
    disturbance: Annotated[int, ADDRESS]
    plant: Annotated[int, ADDRESS]
    settled: Annotated[int, ADDRESS]


class LawArrays(NamedTuple):
    """Of a prepared law.

    Attributes
    ----------
    plan
        See `Plan`.
    memory
        See `PreparedMemory`.
    state
        What it keeps from sample to sample.
    """

    plan: Annotated[Array, PLAN]
    memory: Annotated[Array, WRITE]
    state: Annotated[Array, WRITE]


class SupervisorArrays(NamedTuple):
    """Of a prepared supervisor, empty without one.

    Attributes
    ----------
    memory
        See `SupervisorMemory`.
    moment
        See `Moment`.
    state
        See `supervisor_layout.Memory`.
    codes
        Its interventions, one number a sample.
    """

    memory: Annotated[Array, WRITE]
    moment: Annotated[Array, READ]
    state: Annotated[Array, WRITE]
    codes: Annotated[Array, WRITE]


class DisturbanceArrays(NamedTuple):
    """Of a disturbance.

    Attributes
    ----------
    rows
        What it is to do, one row a sample; none without a disturbance.
    parameters, work
        Of its kernel.
    realised
        Inertial twist that it gave the end effector, one row a sample; at least one row.
    """

    rows: Annotated[Array, READ2]
    parameters: Annotated[Array, READ]
    work: Annotated[Array, WRITE]
    realised: Annotated[Array, WRITE2]


class PlantArrays(NamedTuple):
    """Of a plant.

    Attributes
    ----------
    parameters, state
        Of its kernel.
    noise
        Random numbers that it uses, one row a sample.
    q, measured
        Configuration, and what the encoders say of it, shape (n,), rad or m.
    wrench
        Measured, shape (6,), N and N·m; NaN where it measures none.
    readings
        What else it senses.
    """

    parameters: Annotated[Array, READ]
    state: Annotated[Array, WRITE]
    noise: Annotated[Array, READ2]
    q: Annotated[Array, WRITE]
    measured: Annotated[Array, WRITE]
    wrench: Annotated[Array, READ]
    readings: Annotated[Array, READ]


class Records(NamedTuple):
    """What is recorded, one row a sample: see `PlantArrays`, for what was sent to the plant ``command``, and ``kept``.

    That is the report of the law's constraints; it and ``readings`` are without numbers where there are none.
    """

    q: Annotated[Array, WRITE2]
    measured: Annotated[Array, WRITE2]
    command: Annotated[Array, WRITE2]
    kept: Annotated[Array, WRITE2]
    readings: Annotated[Array, WRITE2]


class Course(NamedTuple):
    """What is followed, and how far.

    Attributes
    ----------
    samples
        Of the desired motion.
    stop
        Tolerance, and how many consecutive samples within it end the loop.
    done
        Steps done; with a supervisor also the last one whose command the law could not find, from 1, and its status.
    settling
        Count and scratch of `settled`.
    """

    samples: Annotated[Array, READ2]
    stop: Annotated[Array, READ]
    done: Annotated[Array, WRITE]
    settling: Annotated[Array, WRITE]


stages: Bundle[Stages] = Bundle(Stages)
law_arrays: Bundle[LawArrays] = Bundle(LawArrays)
supervisor_arrays: Bundle[SupervisorArrays] = Bundle(SupervisorArrays)
disturbance_arrays: Bundle[DisturbanceArrays] = Bundle(DisturbanceArrays)
plant_arrays: Bundle[PlantArrays] = Bundle(PlantArrays)
records: Bundle[Records] = Bundle(Records)
course: Bundle[Course] = Bundle(Course)

_NOTHING: Array = np.zeros(0)
UNSUPERVISED: SupervisorArrays = supervisor_arrays(**dict.fromkeys(SupervisorArrays._fields, _NOTHING))
UNDISTURBED: DisturbanceArrays = disturbance_arrays(
    rows=np.zeros((0, ROW)), realised=np.zeros((1, 6)), parameters=_NOTHING, work=_NOTHING
)


def moved_plant(plant: CompiledPlant) -> PlantArrays:
    """Return the arrays of a plant."""
    return plant_arrays(
        parameters=plant.parameters,
        state=plant.state,
        noise=plant.noise,
        q=plant.q,
        measured=plant.measured,
        wrench=plant.wrench if plant.wrench.size else np.full(WRENCH, np.nan),
        readings=plant.readings,
    )


_ARRAYS = law_arrays, supervisor_arrays, disturbance_arrays, plant_arrays, course, records
ROLLOUT = STATUS(stages.type, *(each.type for each in _ARRAYS))


@kernel(SETTLED)
def settled(pose, desired, stop, count):
    """Count consecutive samples with |vec8(1 − short(x*x_d))| within the tolerance; return 1 when there are enough."""
    error = count[1:9]
    conjugate_multiply(pose, desired, error)
    error[0] = 1.0 - abs(error[0])
    total = 0.0
    for i in range(8):
        total += error[i] * error[i]
    count[0] = count[0] + 1.0 if math.sqrt(total) < stop[0] else 0.0
    return 1 if count[0] >= stop[1] else 0


@kernel(ROLLOUT)
def rollout(stages, law, supervisor, disturbance, plant, course, records):
    """Run the loop until the samples end, the error has settled or something fails."""
    q, measured, samples, stop = plant.q, plant.measured, course.samples, course.stop
    n, m = q.shape[0], records.command.shape[1]
    prepared = unpack(law.plan, law.memory)
    table, pose = prepared.memory.table, prepared.memory.kinematics[0:8]
    supervising = supervisor.memory.shape[0] > 0
    nothing = stop[0:0]
    last_disturbance = disturbance.rows.shape[0] - 1
    for k in range(samples.shape[0]):
        command = records.command[k]
        for i in range(n):
            records.q[k, i] = q[i]
            records.measured[k, i] = measured[i]
        for i in range(records.readings.shape[1]):
            records.readings[k, i] = plant.readings[i]
        for i in range(WRENCH if prepared.plan.contact != 0 else 0):
            prepared.memory.contact_work[i] = plant.wrench[i]
        status = compute_command(prepared, measured, samples[k], k, law.state, command)
        for i in range(records.kept.shape[1]):
            records.kept[k, i] = prepared.memory.constraint_work[i]
        if status != OK:
            if not supervising:
                return status
            for i in range(m):
                command[i] = math.nan
            course.done[1], course.done[2] = k + 1.0, float(status)
        course.done[0] = k + 1.0
        if supervising:
            supervised = _call_supervisor(
                stages.supervisor,
                stages.kinematics,
                supervisor.memory,
                supervisor.moment,
                measured,
                command,
                nothing,
                nothing,
                supervisor.state,
                command,
            )
            supervisor.codes[k] = supervisor.state[NOW]
            note_sent(prepared, law.state, command)
            if supervised == AT_REST:
                return HALTED
        if (
            status == OK
            and stop[1] > 0.0
            and _call_settled(stages.settled, pose, samples[k], stop, course.settling) == 1
        ):
            return OK
        if last_disturbance >= 0:
            status = _call_disturbance(
                stages.disturbance,
                stages.kinematics,
                table,
                disturbance.rows[min(k, last_disturbance)],
                disturbance.parameters,
                disturbance.work,
                q,
                disturbance.realised[k],
            )
            if status != OK:
                return PLANT_FAILED + status
        status = _call_plant(
            stages.plant, command, plant.parameters, plant.noise[k], plant.state, q, measured
        )
        if status != OK:
            return PLANT_FAILED + status
    return OK
