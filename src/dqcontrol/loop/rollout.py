"""The closed loop, compiled: one function for every robot, law and plant."""

from __future__ import annotations

import math

from dqcontrol.algebra.kernels import conjugate_multiply
from dqcontrol.compile import OK, READ, READ2, STATUS, WRITE, WRITE2, kernel, types
from dqcontrol.laws.law import LAW
from dqcontrol.laws.null_space import PREFERENCE
from dqcontrol.limits.command_limits import LIMIT
from dqcontrol.limits.position_limit import POSITION_LIMIT
from dqcontrol.limits.supervisor_layout import AT_REST, GO, NOW
from dqcontrol.limits.supervisor_step import SUPERVISOR
from dqcontrol.plants.disturbance_step import DISTURBANCE
from dqcontrol.plants.plant import PLANT
from dqcontrol.robots.kernels import CHAIN

LAW_FAILED, PLANT_FAILED = 100, 200  # added to the status of what failed; the kinematics' own stays
HALTED = AT_REST  # by the supervisor

SETTLED = STATUS(READ, READ, READ, WRITE)
ROLLOUT = STATUS(
    types.FunctionType(CHAIN),
    types.FunctionType(PREFERENCE),
    types.FunctionType(LAW),
    types.FunctionType(POSITION_LIMIT),
    types.FunctionType(LIMIT),
    types.FunctionType(SUPERVISOR),
    types.FunctionType(DISTURBANCE),
    types.FunctionType(PLANT),
    types.FunctionType(SETTLED),
    READ2,  # chain
    READ,  # preference parameters
    WRITE,  # preference work
    READ2,  # law parameters
    WRITE,  # law state
    WRITE,  # law work
    WRITE,  # kinematics buffer
    READ,  # position limit parameters
    WRITE,  # position limit work
    READ,  # limit parameters
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
    preference,
    law,
    position_limit,
    limit,
    supervise,
    disturb,
    plant,
    settled_at,
    chain,
    preference_parameters,
    preference_work,
    law_parameters,
    law_state,
    work,
    buffer,
    position_limit_parameters,
    position_limit_work,
    limit_parameters,
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
    pose = buffer[0:8]
    pose_jacobian = buffer[8 : 8 + 8 * m].reshape(8, m)
    twist_jacobian = buffer[8 + 8 * m : 8 + 14 * m].reshape(6, m)
    preferred = work[0:m]
    last = law_parameters.shape[0] - 1
    # A call by pointer with its arrays costs 50 ns: stages that do nothing have no parameters and are passed over.
    preferring, limiting = preference_parameters.shape[0] > 0, limit_parameters.shape[0] > 0
    limiting_positions = position_limit_parameters.shape[0] > 0
    supervising = supervisor_parameters.shape[0] > 0
    last_disturbance = disturbance.shape[0] - 1
    for k in range(samples.shape[0]):
        for i in range(n):
            q_record[k, i] = q[i]
            measured_record[k, i] = measured[i]
        status = kinematics(chain, measured, buffer)
        if status == OK:
            if preferring:
                preference(measured, twist_jacobian, preference_parameters, preference_work, preferred)
            if limiting_positions:
                status = position_limit(
                    law,
                    measured,
                    pose,
                    pose_jacobian,
                    twist_jacobian,
                    samples[k],
                    law_parameters[min(k, last)],
                    law_state,
                    work,
                    position_limit_parameters,
                    position_limit_work,
                    command_record[k],
                )
            else:
                status = law(
                    measured,
                    pose,
                    pose_jacobian,
                    twist_jacobian,
                    samples[k],
                    law_parameters[min(k, last)],
                    law_state,
                    work,
                    command_record[k],
                )
            if status != OK:
                status += LAW_FAILED
        if status == OK:
            if limiting:
                limit(measured, limit_parameters, command_record[k])
        elif supervising:
            for i in range(m):
                command_record[k, i] = math.nan
        else:
            return status
        steps[0] = k + 1.0
        if supervising:
            supervised = supervise(
                kinematics,
                chain,
                measured,
                0.0,
                GO,
                command_record[k],
                supervisor_parameters,
                supervisor_state,
                supervisor_work,
                command_record[k],
            )
            code_record[k] = supervisor_state[NOW]
            if supervised == AT_REST:
                return HALTED
        if status == OK and stop[1] > 0.0 and settled_at(pose, samples[k], stop, steps[1:10]) == 1:
            return OK
        if last_disturbance >= 0:
            status = disturb(
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
        status = plant(command_record[k], plant_parameters, noise[k], plant_state, q, measured)
        if status != OK:
            return PLANT_FAILED + status
    return OK
