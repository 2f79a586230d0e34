"""The numbers of a run, found in one compiled pass: those that are its metrics, and those by which its task is judged.

All integrals belong to one piecewise model of the run, so that those of its parts add up: errors are joined
linearly, commands are held from one sample to the next, and differences of samples (joint step, speed,
acceleration) are held over the interval they were taken from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.errors import ShapeError
from dqcontrol.files.long_array import row_by_row
from dqcontrol.loop.record import Record, row_norms
from dqcontrol.references.sample import POSE, TIME
from dqcontrol.robots.kinematics.end_poses import LANES, WORK, all_turn, end_poses, task_poses
from dqcontrol.robots.limits import Limits

SETTLED_FRACTION = 0.02  # of the first error: the usual criterion of settling
STEP_SHARE = 0.1  # of the largest error: a run whose first error is smaller starts on its target
GIVEN = -1  # in place of an address of forward kinematics: the poses are given
_ROUNDING = 1e-9  # as a share of a velocity limit

_NORMS = ("integral", "mean", "rms", "peak")
_DEVIATION = ("mean", "rms", "peak", "final", "settled_mean", "settled_rms", "settled_peak")
NUMBERS: tuple[str, ...] = (
    *(f"{signal}.{part}" for signal in ("position", "orientation") for part in _DEVIATION),
    *(f"{signal}.{part}" for signal in ("error", "settled_error") for part in _NORMS),
    "final_error",
    *(
        f"{signal}.{part}"
        for signal in ("control", "joint_step", "hand_speed", "hand_acceleration")
        for part in _NORMS
    ),
    "joint_path_length",
    "effort",
    "settling_time",
    "limit_margin",
    "peak_velocity_share",
    "saturation",
    "command_jerk",
)
"""Names of the numbers, in the order that `measure_kernel` writes them; as in `Metrics.flat`, but ``command_jerk``."""


class TaskNumbers(NamedTuple):
    """What it writes behind `NUMBERS`: what the errors come to at the samples by which a task is judged.

    Attributes
    ----------
    distance, farthest
        RMS and largest |p_d − p|, mm.
    turn, widest
        RMS and largest angle between end effector and desired orientation, degrees.
    speed
        Mean of the end effector over the last twentieth of the run, m/s.
    first_distance, first_turn, first_error
        At the first sample, mm, degrees and |1 − x* x_d|.
    """

    distance: float
    farthest: float
    turn: float
    widest: float
    speed: float
    first_distance: float
    first_turn: float
    first_error: float


class Sums(NamedTuple):
    """∫f dt, ∫f² dt and the largest f."""

    total: float
    square: float
    peak: float


@inline
def _joined(sums, before, now, interval):
    """Add an interval over which a value goes from one number to the next on a straight line."""
    return Sums(
        sums.total + 0.5 * (before + now) * interval,
        sums.square + (before * before + before * now + now * now) * interval / 3.0,
        max(sums.peak, now),
    )


@inline
def _held(sums, value, interval):
    """Add an interval over which a value is held."""
    return Sums(sums.total + value * interval, sums.square + value * value * interval, max(sums.peak, value))


@inline
def _write_norms(sums, duration, out):
    """Write integral, mean, RMS and peak; of a moment the peak alone, and no peak where a value is NaN."""
    out[0] = sums.total
    out[1] = sums.total / duration if duration > 0.0 else math.nan
    out[2] = math.sqrt(sums.square / duration) if duration > 0.0 else math.nan
    out[3] = sums.peak if sums.total == sums.total else math.nan


@inline
def _write_held(sums, duration, out):
    """Write the norms of what is held over intervals: of a moment there is nothing."""
    _write_norms(sums, duration, out)
    out[3] = out[3] if duration > 0.0 else math.nan


@inline
def _write_poses(poses, first, begin, work):
    """Write `LANES` rows of poses into scratch from a place on, as `end_poses` does."""
    last = poses.shape[0] - 1
    for lane in range(LANES):
        pose = poses[min(first + lane, last)]
        for part in range(4):
            work[begin + part * LANES + lane] = pose[part]
        x, y, z = position(pose)
        work[begin + 4 * LANES + lane] = x
        work[begin + 5 * LANES + lane] = y
        work[begin + 6 * LANES + lane] = z


# forward kinematics (0: of a chain, GIVEN: none), time, samples, joints, commands, its table or the poses, joints'
# lower and upper ends, one over inputs' speeds, samples left out, the first by which the task is judged, band of the
# error (0: of the first), scratch, numbers
MEASURE = STATUS(
    ADDRESS, READ, READ2, READ2, READ2, READ2, READ, READ, READ, types.intp, types.intp, types.float64, WRITE, WRITE
)  # fmt: skip


_DESIRED = WORK  # scratch behind that of `end_poses`: the desired poses, and what the errors are
_DISTANCE, _TURN, _ERROR = WORK + 7 * LANES, WORK + 8 * LANES, WORK + 9 * LANES
REACHED = WORK + 10 * LANES
_DEGREES = 16.0 * 180.0 / math.pi


@inline
def _write_errors(samples, first, work):
    """Write distances (mm), turns (degrees) and norms of 1 − x* x_d of the poses that `end_poses` wrote."""
    _write_poses(samples, first, _DESIRED, work)
    for lane in range(LANES):
        w, x, y, z = work[lane], work[LANES + lane], work[2 * LANES + lane], work[3 * LANES + lane]
        dw, dx = work[_DESIRED + lane], work[_DESIRED + LANES + lane]
        dy, dz = work[_DESIRED + 2 * LANES + lane], work[_DESIRED + 3 * LANES + lane]
        real = abs(w * dw + x * dx + y * dy + z * dz)
        ix = w * dx - x * dw - y * dz + z * dy
        iy = w * dy - y * dw - z * dx + x * dz
        iz = w * dz - z * dw - x * dy + y * dx
        imaginary = ix * ix + iy * iy + iz * iz
        away = (
            (work[_DESIRED + 4 * LANES + lane] - work[4 * LANES + lane]) ** 2
            + (work[_DESIRED + 5 * LANES + lane] - work[5 * LANES + lane]) ** 2
            + (work[_DESIRED + 6 * LANES + lane] - work[6 * LANES + lane]) ** 2
        )
        work[_DISTANCE + lane] = 1e3 * math.sqrt(away)
        work[_ERROR + lane] = math.sqrt((1.0 - real) ** 2 + imaginary + 0.25 * away)
        # The turn is 16 atan t, after three halvings of the angle t ≤ 0.2: so far its series is short.
        t = math.sqrt(imaginary) / (1.0 + real)
        t = t / (1.0 + math.sqrt(1.0 + t * t))
        t = t / (1.0 + math.sqrt(1.0 + t * t))
        u = t * t
        series = 1.0 / 17.0 - u / 19.0
        series = 1.0 / 15.0 - u * series
        series = 1.0 / 13.0 - u * series
        series = 1.0 / 11.0 - u * series
        series = 1.0 / 9.0 - u * series
        series = 1.0 / 7.0 - u * series
        series = 1.0 / 5.0 - u * series
        series = 1.0 / 3.0 - u * series
        work[_TURN + lane] = _DEGREES * t * (1.0 - u * series)


@inline
def _limit_margin(q, lower, upper, reached):
    """Return how near a joint came to an end of its range; ``reached`` is scratch.

    Each joint's extremes first: one minimum over all would wait for itself on every joint of every sample.
    """
    n = q.shape[1]
    lowest, highest = reached[0:n], reached[n : 2 * n]
    for i in range(n):
        lowest[i], highest[i] = math.inf, -math.inf
    for k in range(q.shape[0]):
        for i in range(n):
            lowest[i] = min(lowest[i], q[k, i])
            highest[i] = max(highest[i], q[k, i])
    margin = math.inf
    for i in range(n):
        margin = min(margin, lowest[i] - lower[i], upper[i] - highest[i])
    return margin


@kernel(MEASURE)
def measure_kernel(
    forward, time, samples, q, command, table, lower, upper, per_speed, skipped, judged, band, work, out
):
    """Write all `NUMBERS` of a run and `TaskNumbers`; NaN where one does not exist.

    ``work`` then ends with the lowest and highest of each joint.
    """
    count, n, m = q.shape[0], q.shape[1], command.shape[1]
    turning = forward == 0 and all_turn(table)
    zero = Sums(0.0, 0.0, 0.0)
    distance, turn, error = zero, zero, zero
    settled_distance, settled_turn, settled_error = zero, zero, zero
    judged_distance, farthest, judged_turn, widest, way_before = 0.0, 0.0, 0.0, 0.0, 0.0
    slow = max(0, count - 1 - max(1, count // 20))
    control, step, speed, acceleration = zero, zero, zero, zero
    last_distance, last_turn, last_error = 0.0, 0.0, 0.0
    first_distance, first_turn, first_error = 0.0, 0.0, 0.0
    x0, y0, z0 = 0.0, 0.0, 0.0
    vx0, vy0, vz0, last_interval, last_rate = 0.0, 0.0, 0.0, 0.0, 0.0
    share, saturated, jerk, path = 0.0, 0.0, 0.0, 0.0
    last_outside, is_bounded = -1, False
    for i in range(m):
        is_bounded = is_bounded or per_speed[i] > 0.0
    for k in range(count):
        lane = k % LANES
        if lane == 0:
            status = OK
            if forward == GIVEN:
                _write_poses(table, k, 0, work)
            elif forward == 0:
                status = end_poses(table, turning, q, k, work)
            else:
                status = task_poses(forward, table, q, k, work)
            if status != OK:
                return status
            _write_errors(samples, k, work)
        x, y, z = work[4 * LANES + lane], work[5 * LANES + lane], work[6 * LANES + lane]
        now_distance, now_turn = work[_DISTANCE + lane], work[_TURN + lane]
        now_error = work[_ERROR + lane]
        if k == 0:
            first_error, first_distance, first_turn = now_error, now_distance, now_turn
            distance = Sums(0.0, 0.0, now_distance)
            turn = Sums(0.0, 0.0, now_turn)
            error = Sums(0.0, 0.0, now_error)
        if k == skipped:
            settled_distance = Sums(0.0, 0.0, now_distance)
            settled_turn = Sums(0.0, 0.0, now_turn)
            settled_error = Sums(0.0, 0.0, now_error)
        if k >= judged:
            judged_distance += now_distance * now_distance
            judged_turn += now_turn * now_turn
            farthest, widest = max(farthest, now_distance), max(widest, now_turn)
        if not now_error <= (band if band > 0.0 else SETTLED_FRACTION * first_error):
            last_outside = k
        if k > 0:
            interval = time[k] - time[k - 1]
            rate = 1.0 / interval
            distance = _joined(distance, last_distance, now_distance, interval)
            turn = _joined(turn, last_turn, now_turn, interval)
            error = _joined(error, last_error, now_error, interval)
            if k > skipped:
                settled_distance = _joined(settled_distance, last_distance, now_distance, interval)
                settled_turn = _joined(settled_turn, last_turn, now_turn, interval)
                settled_error = _joined(settled_error, last_error, now_error, interval)
            moved, asked, largest = 0.0, 0.0, 0.0
            for i in range(n):
                moved += (q[k, i] - q[k - 1, i]) ** 2
            for i in range(m):
                asked += command[k - 1, i] ** 2
                largest = max(largest, abs(command[k - 1, i]) * per_speed[i])
            share = max(share, largest)
            saturated += 1.0 if largest >= 1.0 - _ROUNDING else 0.0
            moved = math.sqrt(moved)
            path += moved
            step = _held(step, moved, interval)
            control = _held(control, math.sqrt(asked), interval)
            vx, vy, vz = (x - x0) * rate, (y - y0) * rate, (z - z0) * rate
            speed = _held(speed, math.sqrt(vx * vx + vy * vy + vz * vz), interval)
            if k > 1:
                between = 0.5 * (interval + last_interval)
                faster = math.sqrt((vx - vx0) ** 2 + (vy - vy0) ** 2 + (vz - vz0) ** 2) / between
                acceleration = _held(acceleration, faster, between)
            if 1 < k < count - 1:  # the last command moves nothing
                bent = 0.0
                for i in range(m):
                    ahead = (command[k, i] - command[k - 1, i]) * rate
                    behind = (command[k - 1, i] - command[k - 2, i]) * last_rate
                    bent += (ahead - behind) ** 2
                jerk += bent * rate
            vx0, vy0, vz0, last_interval, last_rate = vx, vy, vz, interval, rate
        if k == slow:
            way_before = speed.total
        x0, y0, z0 = x, y, z
        last_distance, last_turn, last_error = now_distance, now_turn, now_error
    margin = _limit_margin(q, lower, upper, work[REACHED : REACHED + 2 * n])
    duration, skip_time = time[count - 1] - time[0], time[count - 1] - time[min(skipped, count - 1)]
    norms = work[0:4]
    for part in range(2):
        place = 7 * part
        _write_norms(distance if part == 0 else turn, duration, norms)
        out[place], out[place + 1], out[place + 2] = norms[1], norms[2], norms[3]
        out[place + 3] = last_distance if part == 0 else last_turn
        _write_norms(settled_distance if part == 0 else settled_turn, skip_time, norms)
        out[place + 4], out[place + 5], out[place + 6] = norms[1], norms[2], norms[3]
    _write_norms(error, duration, out[14:18])
    _write_norms(settled_error, skip_time, out[18:22])
    out[22] = last_error
    _write_held(control, duration, out[23:27])
    _write_held(step, duration, out[27:31])
    _write_held(speed, duration, out[31:35])
    first_interval = time[min(1, count - 1)] - time[0]
    _write_held(acceleration, duration - 0.5 * (first_interval + last_interval), out[35:39])
    out[39] = path
    out[40] = math.sqrt(control.square)
    starts_on_target = band <= 0.0 and first_error < STEP_SHARE * error.peak
    if starts_on_target or last_outside == count - 1:
        out[41] = math.nan
    else:
        out[41] = time[last_outside + 1] - time[0]
    out[42] = margin if margin < math.inf else math.nan
    is_known = is_bounded and count > 1 and control.square < math.inf
    out[43] = share if is_known else math.nan
    out[44] = saturated / (count - 1) if is_known else math.nan
    out[45] = math.sqrt(jerk / duration) if duration > 0.0 else math.nan
    out[46], out[48] = (
        math.sqrt(judged_distance / (count - judged)),
        math.sqrt(judged_turn / (count - judged)),
    )
    out[47] = farthest if judged_distance == judged_distance else math.nan
    out[49] = widest if judged_turn == judged_turn else math.nan
    out[51], out[52], out[53] = first_distance, first_turn, first_error
    lasted = time[count - 1] - time[slow]
    out[50] = (speed.total - way_before) / lasted if lasted > 0.0 else 0.0
    return OK


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
        row, before, real, along, square = desired[i], desired[max(i - 1, 0)], 0.0, 0.0, 0.0
        for k in range(4):
            real += row[k] * desired[0, k]
            along += row[k] * before[k]
        sign = 1.0 if real > 0.0 else (-1.0 if real < 0.0 else 0.0)
        for k in range(4):
            mean[k] += sign * row[k]
        x, y, z = position(row)
        mean[4] += x
        mean[5] += y
        mean[6] += z
        if i > 0:
            same = 1.0 if along >= 0.0 else -1.0  # a pose and its negative are one
            for k in range(8):
                square += (row[k] - same * before[k]) ** 2
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
        at_rest = numbers.last_step <= _SLOW * numbers.largest_step + _SAME
        return cls(times, poses, numbers, _first_of_rest(poses) if at_rest else None)

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
    def away(rows: Array) -> Array:
        signs = np.copysign(1.0, rows[:, :4] @ poses[-1, :4])  # a pose and its negative are one
        return np.abs(signs[:, None] * rows - poses[-1]).max(axis=1)

    there = row_by_row(away, poses) <= _SAME
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
