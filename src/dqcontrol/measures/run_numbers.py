"""The numbers of a record, found in one pass: those that are its metrics, and those by which its task is judged."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ2, STATUS, WRITE, inline, kernel
from dqcontrol.errors import ShapeError
from dqcontrol.files.long_array import row_by_row
from dqcontrol.loop.record import Record, row_norms
from dqcontrol.measures.run_kernels import GIVEN, NUMBERS, REACHED, TaskNumbers, measure_kernel
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots.limits import Limits

LAST = 0.1  # of the time in which the reference rests: an error that comes and goes is not reached
_SAME = 1e-9  # as poses: that a reference rests
_SLOW = 0.1  # of its greatest speed


class _Motion(NamedTuple):
    """Numbers of a desired motion, see `_measure_motion`.

    Attributes
    ----------
    last_step, largest_step
        Of its eight numbers from one sample to the next, Euclidean norm.
    distance, angle
        From its own mean, RMS, m and rad.
    farthest, widest
        From its end, the largest, m and rad.
    """

    last_step: float
    largest_step: float
    distance: float
    angle: float
    farthest: float
    widest: float


@inline
def _angle_between(rotation, other):
    """Return the angle, rad, between a rotation and the one whose quaternion the other four numbers are."""
    real = rotation[0] * other[0] + rotation[1] * other[1] + rotation[2] * other[2] + rotation[3] * other[3]
    return 2.0 * math.acos(min(abs(real), 1.0))


@kernel(STATUS(READ2, WRITE, WRITE))
def _measure_motion(desired, mean, out):
    """Write the numbers of `_Motion`; ``mean`` (7,) is scratch: mean rotation and position."""
    count = desired.shape[0]
    last_step, largest_step = 0.0, 0.0
    mean[:] = 0.0
    for i in range(count):
        row, real, square = desired[i], 0.0, 0.0
        for k in range(4):
            real += row[k] * desired[0, k]
        sign = 1.0 if real > 0.0 else (-1.0 if real < 0.0 else 0.0)
        for k in range(4):
            mean[k] += sign * row[k]
        x, y, z = position(row)
        mean[4] += x
        mean[5] += y
        mean[6] += z
        if i > 0:
            for k in range(8):
                square += (row[k] - desired[i - 1, k]) ** 2
            last_step = math.sqrt(square)
            largest_step = max(largest_step, last_step)
    size = math.sqrt(mean[0] ** 2 + mean[1] ** 2 + mean[2] ** 2 + mean[3] ** 2)
    for k in range(4):
        mean[k] /= size
    for k in range(4, 7):
        mean[k] /= count
    end = desired[count - 1]
    ex, ey, ez = position(end)
    distances, angles, farthest, widest = 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        x, y, z = position(desired[i])
        distances += (x - mean[4]) ** 2 + (y - mean[5]) ** 2 + (z - mean[6]) ** 2
        farthest = max(farthest, (x - ex) ** 2 + (y - ey) ** 2 + (z - ez) ** 2)
        angles += _angle_between(desired[i], mean) ** 2
        widest = max(widest, _angle_between(desired[i], end))
    out[0], out[1] = last_step, largest_step
    out[2], out[3] = math.sqrt(distances / count), math.sqrt(angles / count)
    out[4], out[5] = math.sqrt(farthest), widest
    return OK


@dataclass(frozen=True, eq=False)
class DesiredMotion:
    """What samples of a desired motion ask for, whatever a robot makes of it: the runs of a study share it.

    Attributes
    ----------
    times, poses
        When, shape (N,), s, and what is desired, shape (N, 8), inertial frame.
    numbers
        How far they go.
    rest
        The first sample of the last tenth of those at whose end they rest; None where they end moving.
    """

    times: Array
    poses: Array
    numbers: _Motion
    rest: int | None

    @classmethod
    def of(cls, desired: Array, known: DesiredMotion | None = None) -> DesiredMotion:
        """Return that of samples (N, 21): the known one if it is of the same poses."""
        if known is not None and np.array_equal(known.poses, desired[:, POSE]):
            return known
        times, poses = np.ascontiguousarray(desired[:, TIME]), np.ascontiguousarray(desired[:, POSE])
        out = np.empty(len(_Motion._fields))
        _measure_motion(desired, np.empty(7), out)
        numbers = _Motion(*out.tolist())
        # It has all but stopped at its last step: samples beyond its end rest whatever it did.
        rests = numbers.last_step <= _SLOW * numbers.largest_step + _SAME
        return cls(times, poses, numbers, _first_of_rest(poses) if rests else None)

    @cached_property
    def positions(self) -> Array:
        """Positions that are desired, shape (N, 3), m."""
        return row_by_row(algebra.translation, self.poses)

    @cached_property
    def directions(self) -> tuple[NDArray[np.bool_], Array]:
        """Which samples move, shape (N,), and in what directions these do, shape (k, 3)."""
        ahead = np.gradient(self.positions, self.times, axis=0)
        speed = row_norms(ahead)
        moves = speed > 1e-3 * speed.max(initial=0.0)
        return moves, ahead[moves] / speed[moves, None]


def _first_of_rest(poses: Array) -> int:
    there = row_by_row(lambda rows: (np.abs(rows - poses[-1]) <= _SAME).all(axis=1), poses)
    first = len(there) - int(there[::-1].argmin()) if not there.all() else 0
    return len(there) - max(1, int(LAST * (len(there) - first)))


@dataclass(frozen=True, eq=False)
class RunNumbers:
    """What one pass over a record finds.

    Attributes
    ----------
    desired
        What was asked for.
    skipped, judged
        The first samples that count for the settled errors, and for the task.
    values
        By `NUMBERS`; NaN where one does not exist.
    task
        What the errors come to at the samples that count for the task.
    limit_joint
        The joint that came nearest to a limit; empty without.
    """

    desired: DesiredMotion
    skipped: int
    judged: int
    values: list[float]
    task: TaskNumbers
    limit_joint: str

    def __getitem__(self, name: str) -> float:
        """Return a number by its name among `NUMBERS`."""
        return self.values[NUMBERS.index(name)]


def run_numbers(
    record: Record,
    limits: Limits | None = None,
    skip_initial: float = 0.0,
    band: float = 0.0,
    desired: DesiredMotion | None = None,
) -> RunNumbers:
    """Measure a record.

    Parameters
    ----------
    record, limits, skip_initial
        As for `evaluate`.
    band
        Of the error, for the settling time; 0: as a share of the first one.
    desired
        What its samples ask for, if that is known; it is found anew if they are others.

    Raises
    ------
    ShapeError
        If the limits do not fit the record.
    """
    desired = DesiredMotion.of(record.desired, desired)
    count, n, m = len(record), record.q.shape[1], record.command.shape[1]
    skipped = min(int(record.time.searchsorted(record.time[0] + skip_initial * (1 - 1e-12))), count - 1)
    judged = skipped if desired.rest is None else desired.rest
    if limits is None:
        lower, upper, per_speed = np.full(n, -np.inf), np.full(n, np.inf), np.zeros(m)
    else:
        check_fit(record, limits)
        lower, upper, per_speed = limits.lower, limits.upper, 1.0 / limits.velocity
    work, out = np.empty(REACHED + 2 * n), np.full(len(NUMBERS) + len(TaskNumbers._fields), math.nan)
    measure_kernel(
        GIVEN, record.time, record.desired, record.q, record.command, record.pose, lower, upper, per_speed, skipped,
        judged, band, work, out,
    )  # fmt: skip
    # One NaN for all, as Python calls two of them equal only if they are the same object: metrics can be compared.
    values = [value if value == value else math.nan for value in out.tolist()]
    joint, margin, path = "", NUMBERS.index("limit_margin"), values[NUMBERS.index("joint_path_length")]
    if path != path:  # of a joint that was nowhere the others say nothing
        values[margin] = math.nan
    if values[margin] == values[margin]:
        lowest, highest = work[REACHED : REACHED + n], work[REACHED + n :]
        joint = record.joint_names[int(np.minimum(lowest - lower, upper - highest).argmin())]
    return RunNumbers(
        desired, skipped, judged, values[: len(NUMBERS)], TaskNumbers(*values[len(NUMBERS) :]), joint
    )


def check_fit(record: Record, limits: Limits) -> None:
    """Raise a `ShapeError` if limits have not as many joints and inputs as a record."""
    n, m = record.q.shape[1], record.command.shape[1]
    if len(limits.lower) != n:
        raise ShapeError(f"limits: expected {n} as in the record's q, got {len(limits.lower)}")
    if len(limits.velocity) != m:
        raise ShapeError(f"limits: expected {m} speeds as the record has inputs, got {len(limits.velocity)}")
