"""The numbers of a run that can be found in one compiled pass over its samples, for searches that need them at once.

They are those of `dqcontrol.measures.metrics`, of the same piecewise model of the run, and the command's jerk.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE, inline, kernel
from dqcontrol.compiled.intrinsics import ADDRESS
from dqcontrol.measures.metric_tables import METRIC_COLUMNS
from dqcontrol.measures.metrics import SETTLED_FRACTION
from dqcontrol.references.sample import TIME
from dqcontrol.robots.chain_robot import ChainRobot
from dqcontrol.robots.kinematics.end_poses import LANES, WORK, all_turn, end_poses, task_poses
from dqcontrol.robots.limits import Limits
from dqcontrol.robots.robot import Robot
from dqcontrol.tables.table_cells import Column

_STEP_SHARE = 0.1  # as in `metrics`: a run whose first error is less of the largest starts on its target
_ROUNDING = 1e-9

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
"""Names of the numbers, in the order that `measure_run` writes them; as in `Metrics.flat`, but ``command_jerk``."""

_JERK = Column("Command jerk RMS", "rad/s³ or m/s³")
NUMBER_COLUMNS: dict[str, Column] = {name: METRIC_COLUMNS.get(name, _JERK) for name in NUMBERS}
"""Heading, unit and format of each."""

_LARGEST = [i for i, name in enumerate(NUMBERS) if "peak" in name]
_LEAST = NUMBERS.index("limit_margin")


def of_all_runs(rows: Array) -> Array:
    """Return what several runs come to: of peaks the largest, of `limit_margin` the least, of all others the mean.

    Parameters
    ----------
    rows
        `NUMBERS` of each run, shape (runs, 46).

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.run_numbers import NUMBERS, of_all_runs
    >>> both = of_all_runs(np.array([[1.0] * len(NUMBERS), [2.0] * len(NUMBERS)]))
    >>> [float(both[NUMBERS.index(name)]) for name in ("position.rms", "position.peak", "limit_margin")]
    [1.5, 2.0, 1.0]
    """
    numbers = rows.mean(axis=0)
    numbers[_LARGEST] = rows[:, _LARGEST].max(axis=0)
    numbers[_LEAST] = rows[:, _LEAST].min()
    return numbers


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
    out[0] = sums.total
    out[1] = sums.total / duration
    out[2] = math.sqrt(sums.square / duration)
    out[3] = sums.peak


# forward kinematics (0: of a chain), samples, joints, commands, its table, joints' lower and upper ends, one over
# inputs' speeds, samples left out, scratch, numbers
MEASURE = STATUS(ADDRESS, READ2, READ2, READ2, READ2, READ, READ, READ, types.intp, WRITE, WRITE)


_DESIRED = WORK  # scratch behind that of `end_poses`: the desired poses, and what the errors are
_DISTANCE, _TURN, _ERROR = WORK + 7 * LANES, WORK + 8 * LANES, WORK + 9 * LANES
_REACHED = WORK + 10 * LANES
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
def measure_kernel(forward, samples, q, command, table, lower, upper, per_speed, skipped, work, out):
    """Write all `NUMBERS` of a run; NaN where one does not exist."""
    count, n, m = q.shape[0], q.shape[1], command.shape[1]
    turning = forward == 0 and all_turn(table)
    zero = Sums(0.0, 0.0, 0.0)
    distance, turn, error = zero, zero, zero
    settled_distance, settled_turn, settled_error = zero, zero, zero
    control, step, speed, acceleration = zero, zero, zero, zero
    last_distance, last_turn, last_error, first_error = 0.0, 0.0, 0.0, 0.0
    x0, y0, z0 = 0.0, 0.0, 0.0
    vx0, vy0, vz0, last_interval, last_rate = 0.0, 0.0, 0.0, 0.0, 0.0
    share, saturated, jerk, path = 0.0, 0.0, 0.0, 0.0
    last_outside, is_bounded = -1, False
    for i in range(m):
        is_bounded = is_bounded or per_speed[i] > 0.0
    for k in range(count):
        lane = k % LANES
        if lane == 0:
            status = (
                end_poses(table, turning, q, k, work)
                if forward == 0
                else task_poses(forward, table, q, k, work)
            )
            if status != OK:
                return status
            _write_errors(samples, k, work)
        x, y, z = work[4 * LANES + lane], work[5 * LANES + lane], work[6 * LANES + lane]
        now_distance, now_turn = work[_DISTANCE + lane], work[_TURN + lane]
        now_error = work[_ERROR + lane]
        if k == 0:
            first_error = now_error
            distance = Sums(0.0, 0.0, now_distance)
            turn = Sums(0.0, 0.0, now_turn)
            error = Sums(0.0, 0.0, now_error)
        if k == skipped:
            settled_distance = Sums(0.0, 0.0, now_distance)
            settled_turn = Sums(0.0, 0.0, now_turn)
            settled_error = Sums(0.0, 0.0, now_error)
        if not now_error <= SETTLED_FRACTION * first_error:
            last_outside = k
        if k > 0:
            interval = samples[k, TIME] - samples[k - 1, TIME]
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
        x0, y0, z0 = x, y, z
        last_distance, last_turn, last_error = now_distance, now_turn, now_error
    margin = _limit_margin(q, lower, upper, work[_REACHED : _REACHED + 2 * n])
    duration = samples[count - 1, TIME] - samples[0, TIME]
    skip_time = samples[count - 1, TIME] - samples[min(skipped, count - 1), TIME]
    place = 0
    for part in range(2):
        whole = distance if part == 0 else turn
        settled = settled_distance if part == 0 else settled_turn
        out[place] = whole.total / duration
        out[place + 1] = math.sqrt(whole.square / duration)
        out[place + 2] = whole.peak
        out[place + 3] = last_distance if part == 0 else last_turn
        out[place + 4] = settled.total / skip_time
        out[place + 5] = math.sqrt(settled.square / skip_time)
        out[place + 6] = settled.peak
        place += 7
    _write_norms(error, duration, out[14:18])
    _write_norms(settled_error, skip_time, out[18:22])
    out[22] = last_error
    _write_norms(control, duration, out[23:27])
    _write_norms(step, duration, out[27:31])
    _write_norms(speed, duration, out[31:35])
    _write_norms(
        acceleration, duration - 0.5 * last_interval - 0.5 * (samples[1, TIME] - samples[0, TIME]), out[35:39]
    )
    out[39] = path
    out[40] = math.sqrt(control.square)
    starts_on_target = first_error < _STEP_SHARE * error.peak
    if starts_on_target or last_outside == count - 1:
        out[41] = math.nan
    else:
        out[41] = samples[last_outside + 1, TIME] - samples[0, TIME]
    out[42] = margin if margin < math.inf else math.nan
    out[43] = share if is_bounded else math.nan
    out[44] = saturated / (count - 1) if is_bounded else math.nan
    out[45] = math.sqrt(jerk / duration)
    return OK


class RunMeasure:
    """What `measure_run` needs to know of a robot and its runs, made ready once.

    Parameters
    ----------
    robot
        Any; of trees what their task is.
    limits
        Of its joints and inputs; commands that count from the measured joints have no limits of speed.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.run_numbers import RunMeasure, NUMBERS
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> target = dqc.references.SetPoint(arm.fkm(q))
    >>> record = dqc.simulate(arm, target, dqc.laws.Proportional(gain=2.0), dqc.plants.Integrator(), q, 0.01, 1.0)
    >>> numbers = RunMeasure(arm, arm.limits)(record.desired, record.q, record.command, skipped=0)
    >>> round(float(numbers[NUMBERS.index("effort")]), 9) == round(dqc.measures.evaluate(record).effort, 9)
    True
    """

    def __init__(self, robot: Robot, limits: Limits) -> None:
        is_chain = robot.kernels is ChainRobot.kernels
        self._forward = 0 if is_chain else robot.kernels.forward.pointer
        self._table = robot.table
        self._lower, self._upper = (np.ascontiguousarray(each) for each in (limits.lower, limits.upper))
        self._per_speed = 1.0 / np.asarray(limits.velocity, dtype=np.float64)
        self._work = np.zeros(_REACHED + 2 * robot.configuration_size)

    def __call__(self, samples: Array, q: Array, command: Array, skipped: int) -> Array:
        """Return all `NUMBERS` of a run of two samples or more; NaN where one does not exist.

        Parameters
        ----------
        samples
            Desired motion, shape (N, 21).
        q, command
            Configurations, (N, n), rad or m, and inputs, (N, m), rad/s or m/s.
        skipped
            How many samples the settled numbers leave out.
        """
        out = np.full(len(NUMBERS), math.nan)
        status = measure_kernel(
            self._forward,
            samples,
            q,
            command,
            self._table,
            self._lower,
            self._upper,
            self._per_speed,
            min(skipped, len(q) - 1),
            self._work,
            out,
        )
        if status != OK:
            out[:] = math.nan
        return out
