"""Places of a supervisor's numbers in its arrays: each array is taken apart once, into parts with names."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, STATUS, WRITE, inline
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS, ROLLER_COLUMNS
from dqcontrol.robots.kinematics.pose_task_kernels import COLUMNS

# kinematics, memory, moment, measured, wanted, measured effort and wrench (empty: not measured), state, out
SUPERVISOR = STATUS(ADDRESS, WRITE, READ, READ, READ, READ, READ, WRITE, WRITE)

AT_REST = 50  # status: stopped, and no longer moving
OUTSIDE_BOX, IN_ZONE = 51, 52  # what a start is refused for
GO, END, STOP, RESET, FINISH = range(5)  # requests
RUNNING, STOPPED, RETURNING = 0.0, 1.0, 2.0  # modes

# head of the parameters: single numbers, those of limits inf where there is none
(
    DT,
    WINDOW,
    STALE,
    LONGEST_STEP,
    SLOW,
    HOLD,
    RAMP,
    FROM_MEASURED,
    JOINT_TOLERANCE,
    HAND_TOLERANCE,
    OVERSPEED,
    JUMP,
    LONGEST_BASE_JUMP,
    FROZEN_AFTER,
    HAND_SPEED_LIMIT,
    HAND_ACCELERATION_LIMIT,
    CONTACT_FORCE,
    CONTACT_TORQUE,
    CONTACT_EFFORT,
    PAYLOAD_WEIGHT,
    FOOTPRINT,
    KEEP_OUT_MARGIN,
    BOXED,
    BOX,
) = range(24)
PAYLOAD_CENTER = BOX + 6  # (3)
SENSOR_BIAS = PAYLOAD_CENTER + 3  # (6): force and torque that are measured without load
ZONE_COLUMNS = 6
MOST_HANDS = 2  # as many frames as a task has

# memory: single numbers of the state; the last are the commanded end effectors one period ago
MODE, FAULT, SCALE, HOLDING, ENDING, BAD, NOW, INDEX, SILENT, LATENESS, STARTED, HAND_BEFORE = range(12)
MEMORY = HAND_BEFORE + 3 * MOST_HANDS


class Sizes(NamedTuple):
    """How many there are; they stand last in the head of the parameters.

    Attributes
    ----------
    coordinates, inputs, drives, rollers
        Of the robot: also of drives, and of wheels with rollers.
    points, zones
        Rows of `Bounds`.
    table_rows, table_columns
        Of what the robot's kinematics read.
    tree, frames, hands
        Rows of its tree, none of a chain, and of all its frames; how many of these, the last, are end effectors.
    """

    coordinates: int = 0
    inputs: int = 0
    drives: int = 0
    rollers: int = 0
    points: int = 0
    zones: int = 0
    table_rows: int = 0
    table_columns: int = 0
    tree: int = 0
    frames: int = 0
    hands: int = 0


sizes_of: MemoryLayout[Sizes] = MemoryLayout(Sizes)
SIZES = SENSOR_BIAS + 6
HANDS, HEAD = SIZES + sizes_of.place("hands"), SIZES + sizes_of.size()


class Moment(NamedTuple):
    """Of a step.

    Attributes
    ----------
    age, elapsed
        Of the measurement, and since the last step, s.
    request
        See above.
    known
        1 if the scratch buffer holds what kinematics writes for this measurement: who asked the law has it. Else 0.
    still
        How long steps have been taken while the robot's clock has not moved, s.
    """

    age: float
    elapsed: float
    request: float
    known: float
    still: float


class Bounds(NamedTuple):
    """Parameters by name; each row has one number an input.

    Attributes
    ----------
    head
        Single numbers, see above.
    coordinate, is_joint
        Index of the coordinate that an input moves, and whether that is a joint.
    drives, rollers
        Bases that cannot move sideways, and wheels with rollers; see `dqcontrol.robots.kinematics.driving`.
    points
        Rows of 4: row of a joint, and a point fixed to its link, m.
    zones
        That a base keeps out of, see `supervisor_step.clearance`.
    """

    head: Annotated[Array, HEAD]
    acceleration: Annotated[Array, "sizes.inputs"]
    lower: Annotated[Array, "sizes.inputs"]
    upper: Annotated[Array, "sizes.inputs"]
    tracking: Annotated[Array, "sizes.inputs"]
    effort: Annotated[Array, "sizes.inputs"]
    coordinate: Annotated[Array, "sizes.inputs"]
    is_joint: Annotated[Array, "sizes.inputs"]
    velocity: Annotated[Array, "sizes.inputs"]
    drives: Annotated[Array, "sizes.drives", DRIVE_COLUMNS]
    rollers: Annotated[Array, "sizes.rollers", ROLLER_COLUMNS]
    points: Annotated[Array, "sizes.points", 4]
    zones: Annotated[Array, "sizes.zones", ZONE_COLUMNS]


class Memory(NamedTuple):
    """State by name.

    Attributes
    ----------
    numbers
        Single numbers, see above.
    good
        Last good measurement.
    sent, sent_rate
        Position command and its rate.
    position, rate
        The same before smoothing.
    speed
        Measured speed, smoothed.
    sent_then, unchanged
        Position command when the measured joint last changed, and time since then, s.
    usual_effort
        Slow mean of the measured effort; NaN before the first.
    past
        Last rates before smoothing, a row each period of the window.
    """

    numbers: Annotated[Array, MEMORY]
    good: Annotated[Array, "coordinates"]
    sent: Annotated[Array, "inputs"]
    sent_rate: Annotated[Array, "inputs"]
    position: Annotated[Array, "inputs"]
    rate: Annotated[Array, "inputs"]
    speed: Annotated[Array, "inputs"]
    sent_then: Annotated[Array, "inputs"]
    unchanged: Annotated[Array, "inputs"]
    usual_effort: Annotated[Array, "inputs"]
    past: Annotated[Array, ..., "inputs"]


class Scratch(NamedTuple):
    """Work memory by name: of kinematics, of the look ahead, and of the rates that are being limited."""

    buffer: Annotated[Array, "8 + 14 * sizes.inputs"]
    jacobian: Annotated[Array, 6, "sizes.inputs"]
    gram: Annotated[Array, 6, 6]
    vectors: Annotated[Array, 6, 6]
    column: Annotated[Array, 6]
    frames: Annotated[Array, "8 * sizes.frames"]
    hand: Annotated[Array, 3 * MOST_HANDS]
    ahead: Annotated[Array, 3 * MOST_HANDS]
    config: Annotated[Array, "sizes.coordinates"]
    look: Annotated[Array, "sizes.inputs"]
    trial: Annotated[Array, "sizes.inputs"]
    sums: Annotated[Array, "sizes.inputs"]
    asked: Annotated[Array, "sizes.inputs"]
    rates: Annotated[Array, "sizes.inputs"]


moment_layout: MemoryLayout[Moment] = MemoryLayout(Moment)
bounds_layout: MemoryLayout[Bounds] = MemoryLayout(Bounds, "sizes")
state_layout: MemoryLayout[Memory] = MemoryLayout(Memory, "coordinates", "inputs")
scratch_layout: MemoryLayout[Scratch] = MemoryLayout(Scratch, "sizes")


class SupervisorMemory(NamedTuple):
    """What a supervisor was prepared with, and scratch: `Bounds`, the robot's table and its tree, `Scratch`.

    The table is what its kinematics read. The tree has the rows of all joints, then those of the end effectors; a chain
    has none: its frames are found from its table.
    """

    bounds: Annotated[Array, bounds_layout.sized("sizes")]
    table: Annotated[Array, "sizes.table_rows", "sizes.table_columns"]
    tree: Annotated[Array, "sizes.tree", COLUMNS]
    scratch: Annotated[Array, scratch_layout.sized("sizes")]


supervisor_memory: MemoryLayout[SupervisorMemory] = MemoryLayout(SupervisorMemory, "sizes")


class Parts(NamedTuple):
    """All that a supervisor's two arrays hold, by name."""

    table: Array
    tree: Array
    bounds: Bounds
    memory: Memory
    scratch: Scratch


@inline
def taken_apart(memory, state):
    """Return the parts of what a supervisor was prepared with, and of its state."""
    sizes = sizes_of(memory[SIZES:HEAD])
    prepared = supervisor_memory(memory, sizes)
    return Parts(
        prepared.table,
        prepared.tree,
        bounds_layout(prepared.bounds, sizes),
        state_layout(state, sizes.coordinates, sizes.inputs),
        scratch_layout(prepared.scratch, sizes),
    )
