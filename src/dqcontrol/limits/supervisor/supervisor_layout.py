"""Where a supervisor's numbers stand in its arrays: each array is taken apart once, into parts with names."""

from __future__ import annotations

from typing import NamedTuple

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline
from dqcontrol.compiled.intrinsics import as_matrix

AT_REST = 50  # status: stopped, and no longer moving
GO, END, STOP_NOW, RESET, FINISH = range(5)  # requests
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
    BOXED,
    BOX,
) = range(22)
PAYLOAD_CENTER = BOX + 6  # (3)
DRIVES, POINTS, HEAD = PAYLOAD_CENTER + 3, PAYLOAD_CENTER + 4, PAYLOAD_CENTER + 5
ROWS = 8  # of m numbers after the head

# memory: single numbers of the state; the last is the commanded hand one period ago
MODE, FAULT, SCALE, HOLDING, ENDING, BAD, NOW, INDEX, SILENT, LATENESS, STARTED, HAND_BEFORE = range(12)
MEMORY = HAND_BEFORE + 3


class Bounds(NamedTuple):
    """Parameters by name; each row has one number an input.

    Attributes
    ----------
    head
        Single numbers, see above.
    coordinate, is_joint
        Index of the coordinate that an input moves, and whether that is a joint.
    speeds
        Velocity limits, then the drives, as `scale_down` takes them.
    drives, points
        Rows of 4: differential drives; index of a joint, and a point fixed to its link, m.
    """

    head: Array
    acceleration: Array
    lower: Array
    upper: Array
    tracking: Array
    effort: Array
    coordinate: Array
    is_joint: Array
    velocity: Array
    speeds: Array
    drives: Array
    points: Array


class Memory(NamedTuple):
    """State by name.

    Attributes
    ----------
    own
        Single numbers, see above.
    good
        Last good measurement (n).
    sent, sent_rate
        Position command and its rate (m).
    position, rate
        The same before smoothing (m).
    speed
        Measured speed, smoothed (m).
    sent_then, unchanged
        Position command when the measured joint last changed (m), and time since then, s.
    usual_effort
        Slow mean of the measured effort (m); NaN before the first.
    past
        Last rates before smoothing (window × m).
    """

    numbers: Array
    good: Array
    sent: Array
    sent_rate: Array
    position: Array
    rate: Array
    speed: Array
    sent_then: Array
    unchanged: Array
    usual_effort: Array
    past: Array


class Scratch(NamedTuple):
    """Work memory by name: of kinematics, of the look ahead, and of the rates that are being limited."""

    buffer: Array
    jacobian: Array
    gram: Array
    vectors: Array
    column: Array
    frames: Array
    hand: Array
    ahead: Array
    config: Array
    look: Array
    trial: Array
    sums: Array
    asked: Array
    rates: Array


def state_size(n: int, m: int, window: int) -> int:
    """Return the size of the state."""
    return MEMORY + n + (8 + window) * m


def work_size(n: int, m: int) -> int:
    """Return the room that a step needs."""
    return (8 + 14 * m) + 6 * m + 36 + 36 + 6 + 8 * (n + 1) + 6 + n + 5 * m


@inline
def unpack_parameters(parameters, m):
    """Return the parameters by name."""
    at = HEAD
    velocity = at + (ROWS - 1) * m
    drives = velocity + m
    points = drives + 4 * int(parameters[DRIVES])
    return Bounds(
        parameters[0:HEAD],
        parameters[at : at + m],
        parameters[at + m : at + 2 * m],
        parameters[at + 2 * m : at + 3 * m],
        parameters[at + 3 * m : at + 4 * m],
        parameters[at + 4 * m : at + 5 * m],
        parameters[at + 5 * m : at + 6 * m],
        parameters[at + 6 * m : at + 7 * m],
        parameters[velocity:drives],
        parameters[velocity:points],
        as_matrix(parameters[drives:points], int(parameters[DRIVES]), 4),
        as_matrix(parameters[points:], int(parameters[POINTS]), 4),
    )


@inline
def unpack_state(state, n, m, window):
    """Return the state by name."""
    at = MEMORY + n
    return Memory(
        state[0:MEMORY],
        state[MEMORY:at],
        state[at : at + m],
        state[at + m : at + 2 * m],
        state[at + 2 * m : at + 3 * m],
        state[at + 3 * m : at + 4 * m],
        state[at + 4 * m : at + 5 * m],
        state[at + 5 * m : at + 6 * m],
        state[at + 6 * m : at + 7 * m],
        state[at + 7 * m : at + 8 * m],
        as_matrix(state[at + 8 * m : at + (8 + window) * m], window, m),
    )


@inline
def unpack_work(work, n, m):
    """Return the work memory by name."""
    jacobian = 8 + 14 * m
    gram = jacobian + 6 * m
    frames = gram + 78
    hand = frames + 8 * (n + 1)
    config = hand + 6
    look = config + n
    return Scratch(
        work[0:jacobian],
        as_matrix(work[jacobian:gram], 6, m),
        as_matrix(work[gram : gram + 36], 6, 6),
        as_matrix(work[gram + 36 : gram + 72], 6, 6),
        work[gram + 72 : frames],
        work[frames:hand],
        work[hand : hand + 3],
        work[hand + 3 : config],
        work[config:look],
        work[look : look + m],
        work[look + m : look + 2 * m],
        work[look + 2 * m : look + 3 * m],
        work[look + 3 * m : look + 4 * m],
        work[look + 4 * m : look + 5 * m],
    )
