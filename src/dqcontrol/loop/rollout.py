"""The closed loop, compiled: one function for every robot, law and plant."""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, kernel
from dqcontrol.compiled.intrinsics import ADDRESS, caller
from dqcontrol.laws.command_kernel import LAW_FAILED, PLAN, compute_command, note_sent, unpack
from dqcontrol.limits.supervisor.supervisor_layout import AT_REST, DT, GO, NOW
from dqcontrol.limits.supervisor.supervisor_step import SUPERVISOR
from dqcontrol.plants.disturbance_step import DISTURBANCE
from dqcontrol.plants.plant import PLANT

PLANT_FAILED = 2 * LAW_FAILED  # added to the status of what failed; the kinematics' own stays
HALTED = AT_REST  # by the supervisor

SETTLED = STATUS(READ, READ, READ, WRITE)

_call_supervisor, _call_disturbance = caller(SUPERVISOR), caller(DISTURBANCE)
_call_plant, _call_settled = caller(PLANT), caller(SETTLED)

ROLLOUT = STATUS(
    *5 * [ADDRESS],  # kinematics, supervisor, disturbance, plant, `settled`; 0 for none
    READ2,  # chain
    PLAN,  # of the law
    WRITE,  # its memory
    WRITE,  # its state
    READ,  # supervisor parameters
    WRITE,  # supervisor state
    WRITE,  # supervisor work
    WRITE,  # record of its interventions
    READ2,  # disturbance
    READ,  # disturbance parameters
    WRITE,  # disturbance work
    READ,  # plant parameters
    WRITE,  # plant state
    READ2,  # plant noise
    WRITE,  # q
    WRITE,  # measured
    READ2,  # samples
    READ,  # stop: tolerance, consecutive samples
    WRITE2,  # record of q
    WRITE2,  # record of measured
    WRITE2,  # record of commands
    WRITE2,  # record of disturbances, at least one row
    WRITE,  # steps done, then the count of `settled` and its scratch (1 + 9)
)


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
def rollout(
    kinematics,
    supervise,
    disturb,
    plant,
    settled_at,
    chain,
    plan,
    memory,
    law_state,
    supervisor_parameters,
    supervisor_state,
    supervisor_work,
    code_record,
    disturbance,
    disturbance_parameters,
    disturbance_work,
    plant_parameters,
    plant_state,
    noise,
    q,
    measured,
    samples,
    stop,
    q_record,
    measured_record,
    command_record,
    disturbance_record,
    steps,
):
    """Run the loop until the samples end, the error has settled or something fails."""
    n = q.shape[0]
    m = command_record.shape[1]
    law = unpack(plan, memory)
    pose = law[5][0:8]
    supervising = supervisor_parameters.shape[0] > 0
    last_disturbance = disturbance.shape[0] - 1
    for k in range(samples.shape[0]):
        for i in range(n):
            q_record[k, i] = q[i]
            measured_record[k, i] = measured[i]
        status = compute_command(law, measured, samples[k], k, law_state, command_record[k])
        if status != OK:
            if not supervising:
                return status
            for i in range(m):
                command_record[k, i] = math.nan
        steps[0] = k + 1.0
        if supervising:
            supervised = _call_supervisor(
                supervise,
                kinematics,
                chain,
                measured,
                0.0,
                supervisor_parameters[DT],
                GO,
                command_record[k],
                supervisor_parameters[0:0],
                supervisor_parameters[0:0],
                supervisor_parameters,
                supervisor_state,
                supervisor_work,
                command_record[k],
            )
            code_record[k] = supervisor_state[NOW]
            note_sent(law, law_state, command_record[k])
            if supervised == AT_REST:
                return HALTED
        if (
            status == OK
            and stop[1] > 0.0
            and _call_settled(settled_at, pose, samples[k], stop, steps[1:10]) == 1
        ):
            return OK
        if last_disturbance >= 0:
            status = _call_disturbance(
                disturb,
                kinematics,
                chain,
                disturbance[min(k, last_disturbance)],
                disturbance_parameters,
                disturbance_work,
                q,
                disturbance_record[k],
            )
            if status != OK:
                return PLANT_FAILED + status
        status = _call_plant(plant, command_record[k], plant_parameters, noise[k], plant_state, q, measured)
        if status != OK:
            return PLANT_FAILED + status
    return OK
