"""Numbers that judge one run: error, effort, smoothness, convergence, distance from joint limits.

Most come from one compiled pass over the samples, `measure_kernel`, which searches use as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.files.long_array import row_by_row
from dqcontrol.files.output_file import finite_or_none
from dqcontrol.laws import Law
from dqcontrol.loop.record import Record, error_norms, pose_errors, row_norms
from dqcontrol.loop.signals import ACTUATORS, TASK
from dqcontrol.measures.run_numbers import (
    NUMBERS,
    SETTLED_FRACTION,
    STEP_SHARE,
    RunNumbers,
    check_fit,
    run_numbers,
)
from dqcontrol.measures.task_range import outside_range
from dqcontrol.measures.task_result import TaskResult, task_result
from dqcontrol.plants.mujoco.world_model import FORCE
from dqcontrol.robots import Robot
from dqcontrol.robots.limits import Limits

if TYPE_CHECKING:
    from dqcontrol.tables.tables import Table


_NYQUIST_SHARE = 0.9  # a cut-off above it leaves what there is
_MOST = 10  # times as many points as samples between which gaps are joined


def low_passed(time: Array, values: Array, cutoff: float) -> Array:
    """Return values without what is faster than a cut-off: Butterworth of order two, forwards and backwards.

    The samples are joined linearly onto equal steps of their median period, filtered, and read at their own times.

    Parameters
    ----------
    time
        Shape (N,), s, increasing.
    values
        Shape (N, columns).
    cutoff
        Where two passes leave half of an amplitude, Hz.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol.measures.metrics import low_passed
    >>> time = np.arange(0, 2, 0.005)
    >>> slow, fast = np.sin(2 * np.pi * time)[:, None], 0.1 * np.sin(2 * np.pi * 80 * time)[:, None]
    >>> bool(np.abs(low_passed(time, slow + fast, 10.0) - slow)[50:-50].max() < 0.003)
    True
    """
    from scipy.signal import (  # takes as long to load as all of ours: only where it is used
        butter,
        sosfiltfilt,
    )

    if len(time) < 4:
        return values
    period = max(float(np.median(np.diff(time))), float(time[-1] - time[0]) / (_MOST * len(time)))
    if cutoff >= _NYQUIST_SHARE * 0.5 / period:
        return values
    even = np.arange(time[0], time[-1] + period / 2, period)
    sections = butter(2, cutoff, fs=1 / period, output="sos")
    joined = np.column_stack([np.interp(even, time, column) for column in values.T])
    reach = min(len(even) - 1, int(np.ceil(1 / (cutoff * period))))
    smooth = np.asarray(sosfiltfilt(sections, joined, axis=0, padlen=reach))
    return np.column_stack([np.interp(time, even, column) for column in smooth.T])


RECOVERED = 2e-3  # m


def contact_force(record: Record) -> NDArray[np.float64] | None:
    """Return the largest force on any body at each sample, N; None where links touch nothing."""
    return record.readings[FORCE].values.max(axis=1) if FORCE in record.readings else None


def peak_contact(record: Record) -> float:
    """Return the largest force on a body, N; NaN where links touch nothing."""
    force = contact_force(record)
    return math.nan if force is None else float(force.max())


def recovery_time(record: Record) -> float:
    """Return how long after the last contact the end effector is back, s.

    It is back once its distance |p_d − p| stays, to the end of the run, within 2 mm of what it was at the last sample
    before the first contact. NaN without contact, or if it never is.
    """
    force = contact_force(record)
    touched = np.flatnonzero(force > 0) if force is not None else np.zeros(0, dtype=np.intp)
    if not len(touched):
        return math.nan
    first, last = int(touched[0]), int(touched[-1])
    error = record.position_error
    outside = np.flatnonzero(~(error <= error[max(first - 1, 0)] + RECOVERED))  # NaN is outside
    back = max(last, int(outside[-1]) if len(outside) else 0) + 1
    return float(record.time[back] - record.time[last]) if back < len(record) else math.nan


AT_LIMIT = 1e-3  # rad or m: a joint so near its limit is at it
UNSEEN = 1e-6  # rad or m beyond a limit: no encoder tells it, and stops in physics give way by less


def joint_margins(record: Record, limits: Limits) -> NDArray[np.float64]:
    """Return each configuration variable's distance from its nearest limit over time, shape (n, N), rad or m.

    It is negative beyond the limit and infinite where there is none.

    Raises
    ------
    ShapeError
        If the limits do not fit the record.
    """
    check_fit(record, limits)
    q = np.ascontiguousarray(record.q.T)  # NumPy is slow along a long axis of short rows
    return np.minimum(q - limits.lower[:, None], limits.upper[:, None] - q)


_RESTING = 1e-6  # m or rad; an initial error below it has no direction to overshoot in
_MOTION = slice(NUMBERS.index("joint_step.integral"), NUMBERS.index("joint_path_length") + 1)
"""Of the numbers those that noise of encoders is most of: joint step and path, speed and acceleration."""


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


def _places(kind: type[SignalNorms | Deviation], *names: str) -> dict[str, tuple[Any, slice]]:
    """Return where `NUMBERS` has signals of a kind, by their names."""
    size = len(fields(kind))
    firsts = {name: NUMBERS.index(f"{name}.{fields(kind)[0].name}") for name in names}
    return {name: (kind, slice(first, first + size)) for name, first in firsts.items()}


_SIGNALS = {
    **_places(Deviation, "position", "orientation"),
    **_places(
        SignalNorms, "error", "settled_error", "control", "joint_step", "hand_speed", "hand_acceleration"
    ),
}


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
        |ṗ|, m/s; "L.Vel" [P16 5.1]. Its integral is the length of the end effector's path in m.
    hand_acceleration
        |p̈|, m/s²; "L.Acc" [P16 5.1].
    position
        |p_d − p|, mm.
    orientation
        Angle between end effector and desired orientation, degrees.
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
        How far the end effector passes its target along the direction of the first error, as a fraction of that
        error; NaN if the run starts on its target.
    orientation_overshoot
        The same for the rotation vector of the error in the end effector's frame.
    limit_margin
        Least distance of any joint from its nearest limit, rad or m; negative if crossed; NaN without limits.
    limit_joint
        The joint that comes so near; empty without limits.
    peak_contact
        Largest force on a body of the world, N; NaN where links touch nothing.
    recovery_time
        From the end of the last contact until the end effector is back where it was, s; see ``contact.recovery_time``.
    peak_velocity_share
        Largest command over the velocity limit of its input, 1 at the limit; NaN without limits or commands, and where
        commands count from the measured joints.
    saturation
        Share of the samples at which a command is at its velocity limit or beyond, 0 … 1; NaN as before.
    outside_range
        How much of the twist that leads to the goal the robot cannot give its end effector, ∫ outside dt / ∫ asked dt,
        0 … 1; see `task_range`. NaN without differential drives.
    tasks
        Of each further task by its name; empty without any.
    verdict
        Whether the run did what was asked and kept what it was to keep, and if not, why, in one line; of `evaluate` no
        more than whether the end effector did what was asked, as ``"reached"`` or ``"not reached: rests 281 mm, 12°
        off"``; see ``task_result``.
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
        """Return one level with dotted names, as ``"error.integral"``; None for NaN and infinity."""
        flat: dict[str, float | int | str | None] = {}
        for key, value in vars(self).items():
            if isinstance(value, SignalNorms | Deviation):
                _add(flat, f"{key}.", value)
            elif key == "tasks":
                for name, task in value.items():
                    _add(flat, f"tasks.{name}.position.", task.position)
                    _add(flat, f"tasks.{name}.orientation.", task.orientation)
            else:
                flat[key] = None if isinstance(value, float) and value - value != 0.0 else value
        return flat

    def judged(self, verdict: str, failure: str) -> Metrics:
        """Return the same with another verdict."""
        return Metrics(**{**vars(self), "verdict": verdict, "failure": failure})


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
        What drove the end effector: of one that controls a part of the pose only that part's task is judged.
    robot
        That of the run, to tell whether a singularity is in the way of its task; see ``task_result``.
    low_pass
        Cut-off of the filter (``low_passed``) behind joint steps and path, speed and acceleration of the end effector,
        Hz: the noise of encoders is most of the differences of what was measured. Default: none.

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
    >>> from dqcontrol.loop.record import Record
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
    numbers = run_numbers(record, limits, skip_initial)
    task = task_result(record, law=law, skip_initial=skip_initial, robot=robot, numbers=numbers)
    return metrics_of(
        record, task, limits, skip_initial, tolerance=tolerance, low_pass=low_pass, numbers=numbers
    )


def metrics_of(
    record: Record,
    task: TaskResult,
    limits: Limits | None,
    skip_initial: float,
    *,
    tolerance: float | None = None,
    low_pass: float | None = None,
    numbers: RunNumbers | None = None,
) -> Metrics:
    """Measure a run whose task has been judged, and whose numbers may be known; the rest as for `evaluate`."""
    band = 0.0 if tolerance is None else as_positive("tolerance", tolerance)
    if numbers is None or band:
        numbers = run_numbers(record, limits, skip_initial, band)
    values = list(numbers.values)
    if low_pass is not None:
        smooth = run_numbers(_smoothed(record, as_positive("low_pass", low_pass)), limits, skip_initial, band)
        values[_MOTION] = smooth.values[_MOTION]
    found = dict(zip(NUMBERS, values, strict=True))
    with np.errstate(invalid="ignore", over="ignore"):  # a diverged run
        effort = found["effort"]
        if ACTUATORS in record.readings:
            actuators = record.readings[ACTUATORS].values[:-1]
            effort = math.sqrt(np.sum(row_by_row(row_norms, actuators) ** 2 * np.diff(record.time)))
        return Metrics(
            **{name: kind(*values[place]) for name, (kind, place) in _SIGNALS.items()},
            duration=record.duration,
            samples=len(record),
            final_error=found["final_error"],
            joint_path_length=found["joint_path_length"],
            effort=effort,
            settling_time=found["settling_time"],
            settling_band=_settling_band(record, numbers.task.first_error, found["error.peak"], tolerance),
            position_overshoot=_overshoot(
                1e-3 * numbers.task.first_distance,
                1e-3 * found["position.peak"],
                lambda: record.desired_position - record.position,
            ),
            orientation_overshoot=_overshoot(
                math.radians(numbers.task.first_turn),
                math.radians(found["orientation.peak"]),
                lambda: record.rotation_error,
            ),
            limit_margin=found["limit_margin"],
            limit_joint=numbers.limit_joint,
            peak_contact=peak_contact(record),
            recovery_time=recovery_time(record),
            peak_velocity_share=found["peak_velocity_share"],
            saturation=found["saturation"],
            outside_range=outside_range(record),
            tasks=_task_deviations(record, numbers.skipped),
            verdict=task.words,
            failure="" if task.succeeded else "ended" if task.outcome == "failed" else "task",
        )


def _smoothed(record: Record, cutoff: float) -> Record:
    """Return a record whose joints and positions have passed a low-pass filter."""
    pose = np.array(record.pose)
    place = low_passed(record.time, record.position, cutoff)
    pose[:] = algebra.pose(pose[:, :4], place)
    return replace(record, q=low_passed(record.time, record.q, cutoff), pose=pose)


def _task_deviations(record: Record, start: int) -> dict[str, TaskDeviation]:
    """Return the deviations of further tasks, settled from a sample on, by their names."""
    signals = {name: signal for name, signal in record.readings.items() if name.startswith(TASK)}
    return {
        name.removeprefix(TASK): TaskDeviation(
            _deviation(record.time, 1e3 * signal.values[:, 0], start),
            _deviation(record.time, np.degrees(signal.values[:, 1]), start),
        )
        for name, signal in signals.items()
    }


def _continuous(time: Array, value: Array) -> SignalNorms:
    """Summarise samples joined linearly."""
    duration, intervals = float(time[-1] - time[0]), np.diff(time)
    if duration == 0:
        return SignalNorms(0.0, math.nan, math.nan, float(value.max()))
    a, b = value[:-1], value[1:]
    integral = float((intervals * (b + a) / 2).sum())
    # exact for the straight lines between samples
    square = float((intervals * (a * a + a * b + b * b)).sum() / 3)
    return SignalNorms(integral, integral / duration, math.sqrt(square / duration), float(value.max()))


def _deviation(time: Array, value: Array, start: int) -> Deviation:
    whole, settled = _continuous(time, value), _continuous(time[start:], value[start:])
    of_settled = settled.mean, settled.rms, settled.peak
    return Deviation(whole.mean, whole.rms, whole.peak, float(value[-1]), *of_settled)


def _settling_band(record: Record, first: float, largest: float, tolerance: float | None) -> float:
    """Return the band of the error; NaN if it is a share of the first error and the run starts on its target."""
    if tolerance is not None:
        return tolerance
    if first < STEP_SHARE * largest:
        return math.nan
    error = np.empty((1, 8))  # as `Record.error` has it, to the last bit
    pose_errors(record.pose[:1], record.desired[:1], error)
    return SETTLED_FRACTION * float(error_norms(error)[0])


def _overshoot(first: float, largest: float, errors: Callable[[], Array]) -> float:
    """Return the largest component against the first error vector over the latter's length."""
    if not first > _RESTING or first < STEP_SHARE * largest:
        return math.nan
    error = errors()
    return float(np.maximum(-(error @ error[0]) / float(np.linalg.norm(error[0])) ** 2, 0.0).max())


def _add(flat: dict[str, float | int | str | None], prefix: str, part: SignalNorms | Deviation) -> None:
    """Add the numbers of a signal, all floats; of one less itself NaN and infinity leave NaN."""
    for name, value in vars(part).items():
        flat[prefix + name] = value if value - value == 0.0 else None
