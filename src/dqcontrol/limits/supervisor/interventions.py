"""What a supervisor does to commands, by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

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
) = (2**i for i in range(12))

REASONS = {
    VELOCITY: "velocity limit",
    ACCELERATION: "acceleration limit",
    POSITION: "position limit",
    SLOWED: "slowed near a singularity",
    HELD: "held near a singularity",
    WORKSPACE: "workspace box",
    MEASUREMENT: "measurement stale or impossible",
    COMMAND: "command not finite",
    TRACKING: "tracking error too large",
    EMERGENCY: "emergency stop",
    SOFT_STOP: "soft stop",
    REJOINING: "command returns to the measured joints",
}


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
