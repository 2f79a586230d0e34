"""A prepared law asked for one command, compiled: kinematics, preferred motion, the law within its limits.

All that a law was prepared with lies in one memory of numbers, part after part; a plan of whole numbers says where. So
a call from Python hands over few arrays, each of which costs 30 ns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, WRONG_SIZE, inline, kernel, types
from dqcontrol.compiled.intrinsics import as_matrix, caller
from dqcontrol.compiled.law_signature import call_law
from dqcontrol.laws.null_space import PREFERENCE
from dqcontrol.limits.position_limit import POSITION_LIMIT
from dqcontrol.limits.velocity_limit import LIMIT
from dqcontrol.references.sample import TIME
from dqcontrol.robots.kinematics_kernels import call_chain, split

LAW_FAILED = 100  # added to the law's status; the kinematics' own stays

PLAN = types.Array(types.intp, 1, "C")
# plan, memory, q, sample, its number (−1: by its time and the period, s), state, out
STEP = STATUS(PLAN, WRITE, INPUT, READ, types.intp, types.float64, WRITE, WRITE)

# plan: addresses (0: nothing to do there), sizes, then where each part of the memory begins, and its end
_KINEMATICS, _PREFERENCE, _LAW, _POSITION_LIMIT, _LIMIT, _COORDINATES, _ROWS, _STATE = range(8)
_DELIVERED, _SENT = 8, 9  # where the state takes the hand's twist, and the command, that left; 0: nowhere
_PARTS = 10
_call_preference, _call_limit, _call_position_limit = map(caller, (PREFERENCE, LIMIT, POSITION_LIMIT))


def memory_layout(
    addresses: Sequence[int],
    coordinates: int,
    rows: int,
    state_size: int,
    feedback: tuple[int, int],
    sizes: Sequence[int],
) -> NDArray[np.intp]:
    """Return the plan of a memory whose parts have these sizes."""
    return np.array(
        [*addresses, coordinates, rows, state_size, *feedback, 0, *np.cumsum(sizes)], dtype=np.intp
    )


@inline
def unpack(plan, memory):
    """Return addresses and parts, as `compute_command` takes them."""
    at = plan[_PARTS:]
    rows, n = plan[_ROWS], plan[_COORDINATES]
    parameters = memory[at[3] : at[4]]
    return (
        (plan[_KINEMATICS], plan[_PREFERENCE], plan[_LAW], plan[_POSITION_LIMIT], plan[_LIMIT]),
        as_matrix(memory[at[0] : at[1]], n + 1, 8),
        (memory[at[1] : at[2]], memory[at[2] : at[3]]),
        as_matrix(parameters, rows, parameters.shape[0] // rows),
        memory[at[4] : at[5]],
        memory[at[5] : at[6]],
        (memory[at[6] : at[7]], memory[at[7] : at[8]]),
        memory[at[8] : at[9]],
        (plan[_DELIVERED], plan[_SENT]),
    )


@inline
def compute_command(prepared, q, sample, k, state, out):
    """Write the command for sample number k."""
    addresses, chain, preferring, rows, work, buffer, limiting_positions, limits, _ = prepared
    kinematics, preference, law, position_limit, limit = addresses
    pose, pose_jacobian, twist_jacobian = split(buffer)
    status = call_chain(kinematics, chain, q, buffer)
    if status != OK:
        return status
    if preference != 0:
        _call_preference(preference, q, twist_jacobian, preferring[0], preferring[1], work[0 : out.shape[0]])
    parameters = rows[min(k, rows.shape[0] - 1)]
    if position_limit != 0:
        status = _call_position_limit(
            position_limit,
            law,
            q,
            pose,
            pose_jacobian,
            twist_jacobian,
            sample,
            parameters,
            state,
            work,
            limiting_positions[0],
            limiting_positions[1],
            out,
        )
    else:
        status = call_law(law, q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out)
    if status != OK:
        return LAW_FAILED + status
    if limit != 0:
        _call_limit(limit, q, limits, out)
    note_sent(prepared, state, out)
    return OK


@inline
def note_sent(prepared, state, command):
    """Write what left, as a twist of the hand and as a command, where the state of a law or a limit wants it."""
    delivered, sent = prepared[8]
    if delivered != 0:
        pose, _, twist_jacobian = split(prepared[5])
        note_delivered(pose, twist_jacobian, command, state[delivered : delivered + 6])
    if sent != 0:
        for i in range(command.shape[0]):
            state[sent + i] = command[i]


@inline
def note_delivered(pose, twist_jacobian, command, out):
    """Write the hand's twist [ω ; ṗ] under a command."""
    for k in range(6):
        out[k] = 0.0
        for i in range(command.shape[0]):
            out[k] += twist_jacobian[k, i] * command[i]
    px, py, pz = position(pose)
    a, b, c = out[0], out[1], out[2]
    out[3] += b * pz - c * py
    out[4] += c * px - a * pz
    out[5] += a * py - b * px


@kernel(STEP)
def step(plan, memory, q, sample, k, period, state, out):
    """Write the command for one sample."""
    buffer = memory[plan[_PARTS + 5] : plan[_PARTS + 6]]
    if 8 + 14 * out.shape[0] != buffer.shape[0] or state.shape[0] != plan[_STATE]:
        return WRONG_SIZE
    if k < 0:
        k = max(round(sample[TIME] / period), 0)
    return compute_command(unpack(plan, memory), q, sample, k, state, out)


# plan, memory, state, command
SENT = STATUS(PLAN, WRITE, WRITE, READ)


@kernel(SENT)
def sent(plan, memory, state, command):
    """Tell the law what left in place of its last command."""
    note_sent(unpack(plan, memory), state, command)
    return OK
