"""Numbers that judge one run: error, effort, smoothness, convergence, distance from joint limits.

All integrals belong to one piecewise model of the run, so that those of its parts add up: errors are joined
linearly, commands are held from one sample to the next, and differences of samples (joint step, speed,
acceleration) are held over the interval they were taken from. They are sums without BLAS, whose last bits depend on the
number of its threads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.files.long_array import row_by_row
from dqcontrol.files.plain_data import finite_or_none
from dqcontrol.laws import Law
from dqcontrol.loop.record import Record, row_norms
from dqcontrol.loop.signals import ACTUATORS, TASK
from dqcontrol.measures.contact import peak_contact, recovery_time
from dqcontrol.measures.low_pass import low_passed
from dqcontrol.measures.margins import least_margin
from dqcontrol.measures.task_range import outside_range
from dqcontrol.measures.task_result import task_result
from dqcontrol.robots import Robot
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from dqcontrol.tables.tables import Table


SETTLED_FRACTION = 0.02
_ROUNDING = 1e-9  # as a share of a velocity limit
_RESTING = 1e-6  # m or rad; an initial error below it has no direction to overshoot in
_STEP_SHARE = 0.1  # of the largest error: a run whose first error is smaller starts on its target


@dataclass(frozen=True)
class SignalNorms:
    """A non-negative quantity f over time, in its own unit U.

    Attributes
    ----------
    integral
        ∫f dt, "integral norm", U s [P16 5.3].
    mean
        Integral over duration, U.
    rms
        √(∫f² dt / duration), U.
    peak
        Largest value, U.
    """

    integral: float
    mean: float
    rms: float
    peak: float


@dataclass(frozen=True)
class Deviation:
    """A tracking error in mm or degrees.

    Attributes
    ----------
    mean, rms, peak
        Over the whole run, as for `SignalNorms`.
    final
        At the last sample.
    settled_mean, settled_rms, settled_peak
        The same without the start: only samples from ``skip_initial`` on.
    """

    mean: float
    rms: float
    peak: float
    final: float
    settled_mean: float
    settled_rms: float
    settled_peak: float


@dataclass(frozen=True)
class TaskDeviation:
    """How far a further task was from its pose: position in mm, orientation in degrees."""

    position: Deviation
    orientation: Deviation


@dataclass(frozen=True)
class Metrics:
    """What `evaluate` measures; NaN where a number does not exist (one sample only, a diverged run).

    Attributes
    ----------
    duration
        s.
    samples
        Count.
    error
        |vec8(1 − x* x_d)|, no unit; "Err" [P16 5.1]. Half the distance in m, about half the angle in rad.
    settled_error
        The same without the start: only samples from ``skip_initial`` on, its integral over them only [P16 Table 5.6].
    final_error
        |vec8(1 − x* x_d)| at the last sample.
    control
        |u|₂ of the commanded inputs, rad/s (and m/s for prismatic joints and bases) [P16 5.1].
    joint_step
        |q(k+1) − q(k)|₂ per sample, rad; "Eff" [P16 5.2]. It is proportional to the sample time T, and its
        integral is T times the joint path length: compare it only between runs of the same T.
    hand_speed
        |ṗ|, m/s; "L.Vel" [P16 5.1]. Its integral is the length of the hand's path in m.
    hand_acceleration
        |p̈|, m/s²; "L.Acc" [P16 5.1].
    position
        |p_d − p|, mm.
    orientation
        Angle between hand and desired orientation, degrees.
    joint_path_length
        Σ|q(k+1) − q(k)|₂, rad; independent of T.
    effort
        √∫|u|² dt, rad/√s (and m/√s for prismatic joints and holonomic bases); of differential drives u holds the speeds
        of the wheels in place of v and ω. [S17 Table 5.1]
    settling_time
        Time from the start after which the error stays in its band, s; NaN if it ends outside, or without a band.
    settling_band
        The band of |1 − x* x_d|, no unit; NaN if it is a share of the first error and the run starts on its target:
        the first error is less than a tenth of the largest.
    position_overshoot
        How far the hand passes its target along the direction of the first error, as a fraction of that
        error; NaN if the run starts on its target.
    orientation_overshoot
        The same for the rotation vector of the error in the hand's frame.
    limit_margin
        Least distance of any joint from its nearest limit, rad or m; negative if crossed; NaN without limits.
    limit_joint
        The joint that comes so near; empty without limits.
    peak_contact
        Largest force on a body of the world, N; NaN where links touch nothing.
    recovery_time
        From the end of the last contact until the hand is back where it was, s; see ``contact.recovery_time``.
    peak_velocity_share
        Largest command over the velocity limit of its input, 1 at the limit; NaN without limits or commands, and where
        commands count from the measured joints.
    saturation
        Share of the samples at which a command is at its velocity limit or beyond, 0 … 1; NaN as before.
    outside_range
        How much of the twist that leads to the goal the robot cannot give its hand, ∫ outside dt / ∫ asked dt, 0 … 1;
        see `task_range`. NaN without differential drives.
    tasks
        Of each further task by its name; empty without any.
    verdict
        Whether the run did what was asked and kept what it was to keep, and if not, why, in one line; of `evaluate` no
        more than whether the hand did what was asked, as ``"reached"`` or ``"not reached: rests 281 mm, 12° off"``; see
        ``task_result``.
    failure
        In what way it failed: ``"ended"`` early, ``"crossed"``, ``"contact"``, ``"limits"``, ``"grip"`` or ``"task"``;
        empty if it did not.
    """

    duration: float
    samples: int
    error: SignalNorms
    settled_error: SignalNorms
    final_error: float
    control: SignalNorms
    joint_step: SignalNorms
    hand_speed: SignalNorms
    hand_acceleration: SignalNorms
    position: Deviation
    orientation: Deviation
    joint_path_length: float
    effort: float
    settling_time: float
    settling_band: float
    position_overshoot: float
    orientation_overshoot: float
    limit_margin: float
    limit_joint: str
    peak_contact: float
    recovery_time: float
    peak_velocity_share: float
    saturation: float
    outside_range: float
    tasks: dict[str, TaskDeviation] = field(default_factory=dict)
    verdict: str = ""
    failure: str = ""

    def __repr__(self) -> str:
        """Return the errors that matter most, in a line."""
        place, turn = self.position, self.orientation
        return (
            f"Metrics({self.duration:g} s: position RMS {place.rms:.3g} mm, peak {place.peak:.3g} mm; "
            f"orientation RMS {turn.rms:.3g}°; effort {self.effort:.3g})"
        )

    def __str__(self) -> str:
        """Return all numbers as a table."""
        return str(self._table())

    def _repr_markdown_(self) -> str:
        """Return what notebooks show: all numbers as a table."""
        return self._table().markdown()

    def _table(self) -> Table:
        from dqcontrol.measures.metric_tables import summary_table

        return summary_table(self)

    def to_dict(self) -> dict[str, Any]:
        """Return nested dictionaries fit for JSON: ``None`` for NaN and infinity."""
        plain = finite_or_none(vars(self))
        if not self.tasks:
            del plain["tasks"]
        return plain

    def flat(self) -> dict[str, float | int | str | None]:
        """Return one level with dotted names, as ``"error.integral"``."""
        return _flatten(vars(self))


def evaluate(
    record: Record,
    limits: Limits | None = None,
    *,
    skip_initial: float = 0.0,
    tolerance: float | None = None,
    law: Law | None = None,
    robot: Robot | None = None,
    low_pass: float | None = None,
) -> Metrics:
    """Measure a run.

    Parameters
    ----------
    record
        The run; true configurations and poses are judged, not measured ones.
    limits
        Of the configuration variables, for the margin, and of the inputs' speeds.
    skip_initial
        Length of the start that the settled error and deviations leave out, s.
    tolerance
        Band of |1 − x* x_d| for the settling time; 2 % of the first error if omitted.
    law
        What drove the hand: of one that controls a part of the pose only that part's task is judged.
    robot
        That of the run, to tell whether a singularity is in the way of its task; see ``task_result``.
    low_pass
        Cut-off of the filter (``low_passed``) behind joint steps and path, speed and acceleration of the hand, Hz: the
        noise of encoders is most of the differences of what was measured. Default: none.

    Raises
    ------
    ValueRangeError
        If ``skip_initial`` is negative or longer than the run, or ``tolerance`` is not positive.
    ShapeError
        If the limits do not fit the record.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.metrics import evaluate
    >>> from dqcontrol.loop.record import Record, row_norms
    >>> time, q = np.linspace(0, 2, 5), np.zeros((5, 1))
    >>> pose = np.tile([1.0, 0, 0, 0, 0, 0, 0, 0], (5, 1))
    >>> record = Record(time, q, q, q + 3, pose, np.hstack([pose, np.zeros((5, 13))]), ("a",))
    >>> evaluate(record).control.integral
    6.0
    """
    as_positive("skip_initial", skip_initial, zero_allowed=True)
    if skip_initial > record.duration:
        raise ValueRangeError(
            f"skip_initial: must be ≤ the run's {record.duration:g} s, got {skip_initial:g}"
        )
    start = min(
        int(np.searchsorted(record.time, record.time[0] + skip_initial * (1 - 1e-12))), len(record) - 1
    )
    if tolerance is not None:
        as_positive("tolerance", tolerance)
    time, intervals = record.time, np.diff(record.time)
    times = _Times(time, intervals)
    between = (intervals[1:] + intervals[:-1]) / 2
    moved, position = record.q, record.position
    if low_pass is not None:
        cutoff = as_positive("low_pass", low_pass)
        moved, position = low_passed(time, moved, cutoff), low_passed(time, position, cutoff)
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        effect = row_by_row(lambda q: row_norms(np.diff(q, axis=0)), moved, ahead=1)
        speed = row_by_row(lambda p, t: row_norms(_velocity(p, t)), position, time, ahead=1)
        acceleration = row_by_row(_acceleration, position, time, ahead=2)
        control = row_by_row(row_norms, record.command[:-1])
        actuators = record.readings[ACTUATORS].values if ACTUATORS in record.readings else record.command
        effort = math.sqrt(np.sum(row_by_row(row_norms, actuators[:-1]) ** 2 * intervals))
        settling_time, band = _settling(time, record.error, tolerance)
        margin, joint = least_margin(record, limits)
        peak_share, saturation = _saturation(record.command[:-1], limits)
        task = task_result(record, law=law, skip_initial=skip_initial, robot=robot)
        return Metrics(
            duration=record.duration,
            samples=len(record),
            error=_continuous(times, record.error),
            settled_error=_continuous(times.since(start), record.error[start:]),
            final_error=float(record.error[-1]),
            control=_held(control, intervals),
            joint_step=_held(effect, intervals),
            hand_speed=_held(speed, intervals),
            hand_acceleration=_held(acceleration, between),
            position=_deviation(times, 1e3 * record.position_error, start),
            orientation=_deviation(times, np.degrees(record.orientation_error), start),
            joint_path_length=float(effect.sum()),
            effort=effort,
            settling_time=settling_time,
            settling_band=band,
            position_overshoot=_overshoot(row_by_row(np.subtract, record.desired_position, record.position)),
            orientation_overshoot=_overshoot(record.rotation_error),
            limit_margin=margin,
            limit_joint=joint,
            peak_contact=peak_contact(record),
            recovery_time=recovery_time(record),
            peak_velocity_share=peak_share,
            saturation=saturation,
            outside_range=outside_range(record),
            tasks={
                name.removeprefix(TASK): TaskDeviation(
                    _deviation(times, 1e3 * signal.values[:, 0], start),
                    _deviation(times, np.degrees(signal.values[:, 1]), start),
                )
                for name, signal in record.readings.items()
                if name.startswith(TASK)
            },
            verdict=task.words,
            failure="" if task.succeeded else "ended" if task.outcome == "failed" else "task",
        )


def _velocity(position: Array, time: Array) -> Array:
    return np.diff(position, axis=0) / np.diff(time)[:, None]


def _acceleration(position: Array, time: Array) -> Array:
    """Return the size of the acceleration from one interval to the next."""
    intervals = np.diff(time)
    between = (intervals[1:] + intervals[:-1]) / 2
    return row_norms(np.diff(_velocity(position, time), axis=0) / between[:, None])


class _Times(NamedTuple):
    """Times of samples, shape (N,), and the intervals between them, shape (N − 1,), s."""

    samples: Array
    intervals: Array

    def since(self, first: int) -> _Times:
        """Return those from one sample on."""
        return _Times(self.samples[first:], self.intervals[first:])


def _continuous(times: _Times, value: Array) -> SignalNorms:
    """Summarise samples joined linearly."""
    duration, intervals = float(times.samples[-1] - times.samples[0]), times.intervals
    if duration == 0:
        return SignalNorms(0.0, math.nan, math.nan, float(value.max()))
    a, b = value[:-1], value[1:]
    integral = float((intervals * (b + a) / 2).sum())
    square = float(
        (intervals * (a * a + a * b + b * b)).sum() / 3
    )  # exact for the straight lines between samples
    return SignalNorms(integral, integral / duration, math.sqrt(square / duration), float(value.max()))


def _held(value: Array, intervals: Array) -> SignalNorms:
    """Summarise values held over intervals."""
    if not len(value):
        return SignalNorms(0.0, math.nan, math.nan, math.nan)
    duration = float(intervals.sum())
    integral = float(np.sum(value * intervals))
    rms = math.sqrt(np.sum(value**2 * intervals) / duration)
    return SignalNorms(integral, integral / duration, rms, float(value.max()))


def _deviation(times: _Times, value: Array, start: int) -> Deviation:
    whole, settled = _continuous(times, value), _continuous(times.since(start), value[start:])
    return Deviation(
        whole.mean, whole.rms, whole.peak, float(value[-1]), settled.mean, settled.rms, settled.peak
    )


def _settling(time: Array, error: Array, tolerance: float | None) -> tuple[float, float]:
    """Return the settling time and the band."""
    if tolerance is None and float(error[0]) < _STEP_SHARE * float(error.max()):
        return math.nan, math.nan
    band = SETTLED_FRACTION * float(error[0]) if tolerance is None else tolerance
    outside = np.flatnonzero(~(error <= band))  # NaN is outside
    if not len(outside):
        return 0.0, band
    last = int(outside[-1])
    return (float(time[last + 1] - time[0]) if last + 1 < len(time) else math.nan), band


def _saturation(command: Array, limits: Limits | None) -> tuple[float, float]:
    """Return the largest command over its limit, and the share of samples with one there or beyond."""
    if limits is None or not len(command) or not np.isfinite(limits.velocity).any():
        return math.nan, math.nan
    velocity = limits.velocity
    shares = row_by_row(lambda rows: np.ascontiguousarray((np.abs(rows) / velocity).T).max(axis=0), command)
    if not np.isfinite(shares).all():
        return math.nan, math.nan
    return float(shares.max()), float(np.mean(shares >= 1 - _ROUNDING))


def _overshoot(error: Array) -> float:
    """Return the largest component against the first error vector over the latter's length."""
    size = float(np.linalg.norm(error[0]))
    if not size > _RESTING or size < _STEP_SHARE * float(row_norms(error).max()):
        return math.nan
    return float(np.maximum(-(error @ error[0]) / size**2, 0.0).max())


def _flatten(nested: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in nested.items():
        if isinstance(value, float):
            flat[prefix + key] = value if math.isfinite(value) else None
        elif isinstance(value, SignalNorms | Deviation | TaskDeviation):
            flat |= _flatten(vars(value), f"{prefix}{key}.")
        else:
            flat |= _flatten(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value}
    return flat
