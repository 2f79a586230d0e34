"""What a reader of a log should know of it: gaps in time, single samples far off, joints beyond their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.robots import Robot

_GAP = 3.0  # periods
_FAR = 12.0  # standard deviations of the noise
_STEPS = 3.0  # times what a joint moves in a period, or the least step that it was ever seen to make
_LEAST = 1e-3  # rad or m
_BEYOND = 0.05  # rad or m over a limit


def remarks(time: Array, q: Array, robot: Robot, names: Sequence[str]) -> tuple[str, ...]:
    """Return a line for each thing that is unusual in a log.

    Parameters
    ----------
    time
        Shape (N,), s.
    q
        Configurations, shape (N, n), rad or m.
    robot
        For its limits and units.
    names
        Of its joints.
    """
    return (*_gaps(time), *_outliers(time, q, robot, names), *_beyond(q, robot, names))


def _gaps(time: Array) -> list[str]:
    steps = np.diff(time)
    if len(steps) < 3:
        return []
    period = float(np.median(steps))
    wide = np.flatnonzero(steps > _GAP * period)
    if not len(wide):
        return []
    longest = wide[steps[wide].argmax()]
    return [
        f"time: {len(wide)} gap{'s' * (len(wide) > 1)} of more than {_GAP:g} periods of {period:.4g} s, "
        f"the longest {steps[longest]:.4g} s at {time[longest]:.4g} s"
    ]


def spikes(values: Array) -> Array:
    """Return by how much each sample stands out from both its neighbours to the same side; 0 where it does not.

    A spike is larger than 12 standard deviations of the noise, as the median of the second differences gives it, and
    than what the signal moves in three periods.
    """
    if len(values) < 5:
        return np.zeros(len(values))
    steps = np.diff(values)
    sizes = np.abs(steps)
    noise = float(np.median(np.abs(np.diff(steps)))) / (0.6745 * np.sqrt(6))
    moving = sizes[sizes > 0]
    quantum = float(moving.min()) if len(moving) else 0.0
    least = max(_FAR * noise, _STEPS * quantum, _STEPS * float(np.quantile(sizes, 0.9)), _LEAST)
    found = np.zeros(len(values))
    out = (steps[:-1] * steps[1:] < 0) & (np.minimum(sizes[:-1], sizes[1:]) > least)
    found[1:-1][out] = np.minimum(sizes[:-1], sizes[1:])[out]
    return found


def _outliers(time: Array, q: Array, robot: Robot, names: Sequence[str]) -> list[str]:
    lines = []
    for i, name in enumerate(names):
        sizes = spikes(q[:, i])
        count = int(np.count_nonzero(sizes))
        if count:
            unit = "rad" if robot.joint_types[i] == "revolute" else "m"
            lines.append(
                f"{name}: {count} sample{'s' * (count > 1)} far from both neighbours, the largest by "
                f"{sizes.max():.3g} {unit} at {time[sizes.argmax()]:.4g} s; they count in all peaks"
            )
    return lines


def _beyond(q: Array, robot: Robot, names: Sequence[str]) -> list[str]:
    limits = robot.limits
    over = np.maximum(limits.lower - q.min(axis=0), q.max(axis=0) - limits.upper)
    lines = [f"{names[i]} by {over[i]:.3g}" for i in range(len(names)) if over[i] > _BEYOND]
    if not lines:
        return []
    return [
        f"joints leave the limits of {robot.name} ({', '.join(lines)} rad or m): other units, zeros or signs?"
    ]
