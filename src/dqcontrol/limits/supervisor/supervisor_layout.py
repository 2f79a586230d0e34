"""Where a supervisor's numbers stand in its arrays."""

from __future__ import annotations

AT_REST = 50  # status: stopped, and no longer moving

# parameters: head, then acceleration, lower, upper, tracking error, coordinate, is joint (m each), velocity (m), drives
DT, WINDOW, STALE, SLOW, HOLD, RAMP, FROM_MEASURED, BOXED, BOX = 0, 1, 2, 3, 4, 5, 6, 7, 8
HEAD = 14
# state: memory, then last good measurement (n), position command, rate (m each), both before smoothing (m each), the
# last rates before smoothing (window × m)
MODE, FAULT, SCALE, HOLDING, ENDING, BAD, NOW, INDEX = 0, 1, 2, 3, 4, 5, 6, 7
MEMORY = 8
RUNNING, STOPPED, RETURNING = 0.0, 1.0, 2.0
GO, END, STOP_NOW, RESET = 0, 1, 2, 3  # requests


def work_size(n: int, m: int) -> int:
    """Return the room that a step needs."""
    return (8 + 14 * m) + 6 * m + 36 + 36 + 6 + 3 + n + 3 * m
