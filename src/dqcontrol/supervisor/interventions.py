"""Names of all that a supervisor does to commands, and the category of each of its stops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

INTERVENTIONS = "interventions"  # name of the signal in recordings

# One bit each, so that a sample's interventions are one number in a recording.
(
    VELOCITY,
    ACCELERATION,
    POSITION,
    SLOWED,
    HELD,
    WORKSPACE,
    MEASUREMENT,
    COMMAND,
    TRACKING,
    EMERGENCY,
    SOFT_STOP,
    REJOINING,
    HAND_SPEED,
    HAND_ACCELERATION,
    IMPOSSIBLE,
    GAP,
    PERIOD,
    MEASURED_POSITION,
    MEASURED_WORKSPACE,
    OVERSPEED,
    JUMP,
    FROZEN,
    EFFORT,
    CONTACT,
    BASE_JUMP,
    KEEP_OUT,
    CLOCK,
) = (2**i for i in range(27))

# The reason in words, and the stop category of IEC 60204-1 of what stops. 0 removes the power at once: only the robot
# can, and says so by its fault. In the others the supervisor brakes within its limits; 1: then the power is to be
# removed, 2: then it holds under power.
_TABLE = (
    (VELOCITY, "velocity limit", None),
    (ACCELERATION, "acceleration limit", None),
    (POSITION, "position limit", None),
    (SLOWED, "slowed near a singularity", None),
    (HELD, "held near a singularity", None),
    (WORKSPACE, "workspace box", None),
    (MEASUREMENT, "measurement stale or impossible", 1),
    (COMMAND, "command not finite", 2),
    (TRACKING, "tracking error too large", 1),
    (EMERGENCY, "emergency stop", 1),
    (SOFT_STOP, "soft stop", 2),
    (REJOINING, "command returns to the measured joints", None),
    (HAND_SPEED, "hand speed limit", None),
    (HAND_ACCELERATION, "hand acceleration limit", None),
    (IMPOSSIBLE, "limits that cannot be kept together", None),
    (GAP, "gap in time", 2),
    (PERIOD, "periods too long", 2),
    (MEASURED_POSITION, "measured joint beyond its limits", 1),
    (MEASURED_WORKSPACE, "measured hand outside the workspace", 1),
    (OVERSPEED, "measured joint too fast", 1),
    (JUMP, "measured joint jumped", 1),
    (FROZEN, "measured joint frozen while commanded to move", 1),
    (EFFORT, "joint effort too large", 1),
    (CONTACT, "contact", 1),
    (BASE_JUMP, "measured base jumped", 1),
    (KEEP_OUT, "keep-out zone", None),
    (CLOCK, "clock stands still", 2),
)
REASONS = {bit: text for bit, text, _ in _TABLE}
_CATEGORIES = {bit: category for bit, _, category in _TABLE if category is not None}
STOPS = sum(_CATEGORIES)


class Intervention(NamedTuple):
    """One reason, from its first sample to its last.

    Attributes
    ----------
    start, end
        s.
    reason
        One of ``REASONS``.
    """

    start: float
    end: float
    reason: str


def reasons(code: float) -> tuple[str, ...]:
    """Return the reasons in a sample's number.

    Examples
    --------
    >>> reasons(5)
    ('velocity limit', 'position limit')
    """
    return tuple(text for bit, text in REASONS.items() if int(code) & bit)


def stop_category(code: float) -> int | None:
    """Return the category (IEC 60204-1) of the stop that a sample's number names, the strictest of several.

    1: braked within the limits, then the power of the drives is to be removed; 2: braked, then held under power.
    None if the number names no stop. Category 0, power removed at once, is the robot's own.

    Examples
    --------
    >>> stop_category(TRACKING), stop_category(SOFT_STOP), stop_category(VELOCITY)
    (1, 2, None)
    """
    return min((category for bit, category in _CATEGORIES.items() if int(code) & bit), default=None)


def describe_stop(code: float) -> str:
    """Return a stop's category and reasons in words.

    Examples
    --------
    >>> describe_stop(TRACKING)
    'stop category 1: tracking error too large'
    """
    category, words = stop_category(code), ", ".join(reasons(code))
    return words if category is None else f"stop category {category}: {words}"


def list_interventions(time: ArrayLike, codes: ArrayLike) -> list[Intervention]:
    """Return when a supervisor intervened and why, in the order of time.

    Parameters
    ----------
    time
        Shape (N,), s.
    codes
        Sums of reasons, one a sample, shape (N,).

    Examples
    --------
    >>> list_interventions([0.0, 0.1, 0.2, 0.3], [0, 1, 1, 0])
    [Intervention(start=0.1, end=0.2, reason='velocity limit')]
    """
    times, numbers = np.asarray(time, dtype=np.float64), np.asarray(codes).astype(np.int64).ravel()
    found = []
    for bit, text in REASONS.items():
        acting = np.concatenate([[0], (numbers & bit) != 0, [0]]).astype(np.int8)
        edges = np.diff(acting)
        for first, after in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
            found.append(Intervention(float(times[first]), float(times[after - 1]), text))
    return sorted(found)
