"""The numbers of a run, found in one compiled pass over its samples.

All integrals belong to one piecewise model of the run, so that those of its parts add up: errors are joined
linearly, commands are held from one sample to the next, and differences of samples (joint step, speed,
acceleration) are held over the interval they were taken from.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import types

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.robots.kinematics.end_poses import LANES, WORK, all_turn, end_poses, task_poses

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
def _given_poses(poses, first, work):
    """Write `LANES` rows of poses as `end_poses` does."""
    last = poses.shape[0] - 1
    for lane in range(LANES):
        pose = poses[min(first + lane, last)]
        for part in range(4):
            work[part * LANES + lane] = pose[part]
        x, y, z = position(pose)
        work[4 * LANES + lane], work[5 * LANES + lane], work[6 * LANES + lane] = x, y, z


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
    last = samples.shape[0] - 1
    for lane in range(LANES):
        desired = samples[min(first + lane, last)]
        for part in range(4):
            work[_DESIRED + part * LANES + lane] = desired[part]
        x, y, z = position(desired)
        work[_DESIRED + 4 * LANES + lane] = x
        work[_DESIRED + 5 * LANES + lane] = y
        work[_DESIRED + 6 * LANES + lane] = z
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
                _given_poses(table, k, work)
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
