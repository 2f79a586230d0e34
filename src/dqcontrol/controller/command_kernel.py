"""A prepared law asked for one command, compiled: kinematics, preferred motion, the law, limits, constraints.

All that a law was prepared with lies in one memory of numbers, part after part; a plan of whole numbers says where. So
a call from Python hands over few arrays, each of which costs 30 ns.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import (
    INPUT,
    OK,
    READ,
    STATUS,
    WRITE,
    WRONG_SIZE,
    apart,
    inline,
    kernel,
    shared,
    types,
)
from dqcontrol.compiled.intrinsics import CONSTRAINT, call_law, caller
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.contact.admittance_step import give_back
from dqcontrol.contact.contact_layout import CONTACT, CONTACT_STATE, LEFT, WRENCH, contact_work
from dqcontrol.controller.task_levels import TASKS
from dqcontrol.laws.null_space import PREFERENCE, WORK_SIZE
from dqcontrol.limits.position_limit import POSITION_LIMIT
from dqcontrol.limits.rates import LIMIT
from dqcontrol.references.sample import SAMPLE_SIZE, TIME
from dqcontrol.robots.kinematics.kinematics_kernels import call_chain, split

LAW_FAILED = 100  # added to the law's status; the kinematics' own stays

PLAN = types.Array(types.intp, 1, "C")
# plan, memory, q, sample, its number (−1: by its time and the period, s), state, out
STEP = STATUS(PLAN, WRITE, INPUT, READ, types.intp, types.float64, WRITE, WRITE)

_call_preference, _call_limit, _call_position_limit = map(caller, (PREFERENCE, LIMIT, POSITION_LIMIT))
_call_tasks = caller(TASKS)
_call_constraint = caller(CONSTRAINT)
_call_contact, _call_left = caller(CONTACT), caller(LEFT)


class Plan(NamedTuple):
    """Which stages a prepared law has, and the sizes of its memory.

    Attributes
    ----------
    kinematics, preference, law, position_limit, limit, tasks, constraint, contact, left
        Addresses; 0 where nothing is to be done.
    contact_at
        Where the state has what contact remembers.
    delivered_at, last_at, sent_at
        Where the state takes what left, of the law the end effector's twist and the command, of its limits the command;
        0: nowhere.
    state
        Its size.
    table_rows, table_columns, rows, columns, work, inputs, preferring, position_limiting, limiting, tasking,
    tasking_work, constraining, constraint_work, contacting, contact_work
        Of the robot, of the law's parameters over time, and of the parts of `PreparedMemory`.
    """

    kinematics: int
    preference: int
    law: int
    position_limit: int
    limit: int
    tasks: int
    constraint: int
    contact: int
    left: int
    contact_at: int
    delivered_at: int
    last_at: int
    sent_at: int
    state: int
    table_rows: int
    table_columns: int
    inputs: int
    preferring: int
    rows: int
    columns: int
    work: int
    position_limiting: int
    limiting: int
    tasking: int
    tasking_work: int
    constraining: int
    constraint_work: int
    contacting: int
    contact_work: int


class PreparedMemory(NamedTuple):
    """What a law was prepared with, and scratch.

    Attributes
    ----------
    table
        What the robot's kinematics read: its chain, or what of a tree is driven.
    preferring, preference_work
        Parameters and scratch of the preferred motion.
    parameters
        Of the law, one row a sample, or one for all.
    work
        Scratch of the law; it begins with the preferred motion.
    kinematics
        What `split` takes apart.
    position_limiting, position_limit_work
        Parameters and scratch of the limit on positions.
    limiting
        Parameters of the limit on velocities.
    tasking, tasking_work
        Parameters and scratch of further tasks.
    constraining, constraint_work
        Parameters and scratch of constraints; the scratch begins with the report of the last sample.
    contacting, contact_work
        Of the contact stage, see `ContactParameters` and `ContactWork`; empty without one.
    """

    table: Annotated[Array, "table_rows", "table_columns"]
    preferring: Annotated[Array, "preferring"]
    preference_work: Annotated[Array, WORK_SIZE]
    parameters: Annotated[Array, "rows", "columns"]
    work: Annotated[Array, "work"]
    kinematics: Annotated[Array, "8 + 14 * inputs"]
    position_limiting: Annotated[Array, "position_limiting"]
    position_limit_work: Annotated[Array, "2 * inputs + state"]
    limiting: Annotated[Array, "limiting"]
    tasking: Annotated[Array, "tasking"]
    tasking_work: Annotated[Array, "tasking_work"]
    constraining: Annotated[Array, "constraining"]
    constraint_work: Annotated[Array, "constraint_work"]
    contacting: Annotated[Array, "contacting"]
    contact_work: Annotated[Array, "contact_work"]


_plan = MemoryLayout(Plan)
_FIRST_SIZE = Plan._fields.index("state")
_MEMORY_SIZES = Plan._fields[_FIRST_SIZE:]
prepared_memory: MemoryLayout[PreparedMemory] = MemoryLayout(PreparedMemory, *_MEMORY_SIZES)


class Prepared(NamedTuple):
    """A prepared law for compiled code."""

    plan: Plan
    memory: PreparedMemory


@inline
def unpack(plan, memory):
    """Return plan and memory by name."""
    stages = _plan(plan)
    return Prepared(stages, prepared_memory(memory, *stages[_FIRST_SIZE:]))


@inline
def compute_command(prepared, q, sample, k, state, out):
    """Write the command for sample number k."""
    plan, memory = prepared.plan, prepared.memory
    pose, pose_jacobian, twist_jacobian = split(memory.kinematics)
    status = call_chain(plan.kinematics, memory.table, q, memory.kinematics)
    if status != OK:
        return status
    if plan.contact != 0:
        at, room = plan.contact_at, memory.contact_work
        status = _call_contact(
            plan.contact, pose, sample, k, memory.contacting, state[at : at + CONTACT_STATE], room
        )
        if status != OK:
            return LAW_FAILED + status
        sample = room[WRENCH : WRENCH + SAMPLE_SIZE]  # laws, tasks and constraints follow the compliant frame
    work = memory.work
    if plan.preference != 0:
        preferred = work[0 : out.shape[0]]
        _call_preference(
            plan.preference, q, twist_jacobian, memory.preferring, memory.preference_work, preferred
        )
    parameters = memory.parameters[min(k, plan.rows - 1)]
    if plan.position_limit != 0:
        status = _call_position_limit(
            plan.position_limit,
            plan.law,
            q,
            pose,
            pose_jacobian,
            twist_jacobian,
            sample,
            parameters,
            state,
            work,
            memory.position_limiting,
            memory.position_limit_work,
            out,
        )
    else:
        status = call_law(
            plan.law, q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out
        )
    if status != OK:
        return LAW_FAILED + status
    if plan.tasks != 0:
        status = _call_tasks(
            plan.tasks, q, pose, twist_jacobian, sample, k, memory.tasking, memory.tasking_work, out
        )
        if status != OK:
            return LAW_FAILED + status
    if plan.contact != 0:
        note_asked(out, memory.contact_work)
    if plan.limit != 0:
        _call_limit(plan.limit, q, memory.limiting, out)
    if plan.constraint != 0:
        m = out.shape[0]
        # of further tasks, if there are any
        metric = memory.tasking_work[max(plan.tasking_work - m * m, 0) :]
        status = _call_constraint(
            plan.constraint,
            plan.kinematics,
            memory.table,
            q,
            sample,
            k,
            twist_jacobian,
            metric,
            state,
            memory.constraining,
            memory.constraint_work,
            out,
        )
        if status != OK:
            return LAW_FAILED + status
    note_sent(prepared, state, out)
    return OK


@inline
def note_sent(prepared, state, command):
    """Write what left, as the end effector's twist and as a command, where the state of a law or a limit wants it."""
    plan = prepared.plan
    delivered, last, sent = plan.delivered_at, plan.last_at, plan.sent_at
    if delivered != 0:
        pose, _, twist_jacobian = split(prepared.memory.kinematics)
        note_delivered(pose, twist_jacobian, command, state[delivered : delivered + 6])
    if plan.left != 0:
        own = state[plan.contact_at : plan.contact_at + CONTACT_STATE]
        memory = prepared.memory
        _tell_contact(plan.left, memory.kinematics, command, memory.contacting, own, memory.contact_work)
    if last != 0:
        for i in range(command.shape[0]):
            state[last + i] = command[i]
    if sent != 0:
        for i in range(command.shape[0]):
            state[sent + i] = command[i]


@apart
def _tell_contact(left, kinematics, command, parameters, state, work):
    """Call `note_left` by its address: loops without contact do not wait until it is compiled."""
    pose, _, twist_jacobian = split(kinematics)
    _call_left(left, pose, twist_jacobian, command, parameters, state, work)


@shared
def note_delivered(pose, twist_jacobian, command, out):
    """Write the end effector's twist [ω ; ṗ] under a command."""
    for k in range(6):
        out[k] = 0.0
        for i in range(command.shape[0]):
            out[k] += twist_jacobian[k, i] * command[i]
    px, py, pz = position(pose)
    a, b, c = out[0], out[1], out[2]
    out[3] += b * pz - c * py
    out[4] += c * px - a * pz
    out[5] += a * py - b * px


@inline
def note_asked(command, work):
    """Write what the law asks, for the contact stage."""
    room = contact_work(work)
    for i in range(command.shape[0]):
        room.command[i] = command[i]
    for i in range(6):
        room.back[i] = 0.0
    room.noted[0] = 1.0


@kernel(LEFT)
def note_left(pose, twist_jacobian, command, parameters, state, work):
    """Let the contact stage give back what did not leave, as twists of the end effector."""
    room = contact_work(work)
    lacks = False
    for i in range(command.shape[0]):
        lacks = lacks or command[i] != room.command[i]
    for i in range(6):
        lacks = lacks or room.back[i] != 0.0
    if lacks:
        note_delivered(pose, twist_jacobian, room.command, room.asked)
        note_delivered(pose, twist_jacobian, command, room.delivered)
        give_back(parameters, state, work)
    return OK


@kernel(STEP)
def step(plan, memory, q, sample, k, period, state, out):
    """Write the command for one sample."""
    prepared = unpack(plan, memory)
    if out.shape[0] != prepared.plan.inputs or state.shape[0] != prepared.plan.state:
        return WRONG_SIZE
    if k < 0:
        k = max(round(sample[TIME] / period), 0)
    return compute_command(prepared, q, sample, k, state, out)


# plan, memory, state, command
SENT = STATUS(PLAN, WRITE, WRITE, READ)


@kernel(SENT)
def sent(plan, memory, state, command):
    """Tell the law what left in place of its last command."""
    note_sent(unpack(plan, memory), state, command)
    return OK
