"""Success of a run: it reached its reference at rest, or followed it in motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ2, STATUS, WRITE, inline, kernel
from dqcontrol.contact import Admittance
from dqcontrol.controller import PreparedTasks
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws import Law, PartialProportional
from dqcontrol.loop.record import Record, has_failed, part_of, row_norms
from dqcontrol.measures.task_range import inverse_of, lost_share
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot
from dqcontrol.supervisor.interventions import INTERVENTIONS, SOFT_STOP

Outcome = Literal["reached", "not reached", "followed", "not followed", "kept", "not kept", "failed"]

POSITION, ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is there, for inverse kinematics too
SETTLED = 0.02  # of what was asked: the settling criterion
FOLLOWED = 0.1  # of what was asked: a sensitivity of −20 dB
_MISSED: dict[Outcome, Outcome] = {
    "reached": "not reached",
    "followed": "not followed",
    "kept": "not kept",
}
_SAME = 1e-9  # as poses: that a reference rests
_SLOW = 0.1  # of its greatest speed
_LOST = 0.5  # of what is left of an error at rest: from there on it is a singularity that is in the way
_LAST = 0.1  # of the time in which the reference rests: an error that comes and goes is not reached


@dataclass(frozen=True)
class TaskResult:
    """What is left of a task at its end, or on its way.

    Attributes
    ----------
    outcome
        ``"reached"`` or ``"not reached"`` where the reference ends at rest, ``"followed"`` or ``"not followed"`` where
        it ends moving, ``"kept"`` or ``"not kept"`` of a further task that holds what it found at the start,
        ``"failed"`` of a run that diverged, faulted or was halted.
    position, orientation
        The error that decides, m and rad: the largest of the last tenth of the time in which the reference rests, or
        the RMS of the whole way. NaN where the law leaves that part free.
    position_tolerance, orientation_tolerance
        Up to which it is good, m and rad.
    speed
        Of the end effector at the end, m/s.
    is_singular
        Whether it rests where no joint can move the end effector towards its goal, and every law stands still.
    """

    outcome: Outcome
    position: float
    orientation: float
    position_tolerance: float
    orientation_tolerance: float
    speed: float
    is_singular: bool = False

    @property
    def succeeded(self) -> bool:
        """Whether it did what was asked."""
        return self.outcome in ("reached", "followed", "kept")

    @property
    def rests(self) -> bool:
        """Whether the reference ends at rest."""
        return self.outcome in ("reached", "not reached")

    @property
    def is_moving(self) -> bool:
        """Whether the end effector still moves at the end, by more than the tolerance in a second."""
        return self.speed > self.position_tolerance

    @property
    def words(self) -> str:
        """The outcome, with the errors that decide if they are too large: ``"not reached: rests 281 mm, 12° off"``."""
        return self.outcome if self.succeeded or not self.error else f"{self.outcome}: {self.error}"

    @property
    def error(self) -> str:
        """The errors that decide, as ``"rests 281 mm, 12° off"``; of a run that fell short those that are too large."""
        parts = []
        for error, tolerance, text in (
            (self.position, self.position_tolerance, f"{1e3 * self.position:.3g} mm"),
            (self.orientation, self.orientation_tolerance, f"{np.degrees(self.orientation):.2g}°"),
        ):
            if np.isfinite(error) and (self.succeeded or error > tolerance):
                parts.append(text)
        if not parts:
            return ""
        if self.rests:
            where = " in a singularity" * self.is_singular
            return f"{'still moves' if self.is_moving else 'rests'} {', '.join(parts)} off{where}"
        return f"errs by {', '.join(parts)} RMS"


class _Asked(NamedTuple):
    """What is asked of a task.

    Attributes
    ----------
    outcome
        Of one that is done.
    judged
        At which samples, shape (N,).
    distance, angle
        How far it is asked to go and to turn, m and rad, of which the errors may be a share.
    """

    outcome: Outcome
    judged: NDArray[np.bool_]
    distance: float
    angle: float


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

    @property
    def ends_at_rest(self) -> bool:
        """Whether it has all but stopped at its last step: samples beyond its end rest whatever it did."""
        return self.last_step <= _SLOW * self.largest_step + _SAME


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


def _asked(record: Record, skip_initial: float) -> _Asked:
    """Return what the desired motion of a record asks for."""
    numbers = np.empty(len(_Motion._fields))
    _measure_motion(record.desired, np.empty(7), numbers)
    motion = _Motion(*numbers.tolist())
    if motion.ends_at_rest:
        return _Asked("reached", _resting(record.desired[:, POSE]), *_to_the_end(record, motion))
    judged = record.time >= record.time[0] + skip_initial * (1 - 1e-12)
    return _Asked("followed", judged, motion.distance, motion.angle)


def task_result(
    record: Record, *, law: Law | None = None, skip_initial: float = 0.0, robot: Robot | None = None
) -> TaskResult:
    """Return whether a run did what was asked.

    How a supervisor brakes at the end is not judged.

    A run whose reference ends at rest has reached its goal if it stays within 2 % of the way that was asked for
    (position: from the end effector's start, or the farthest point of the reference, to the goal; orientation: the same
    angle), the usual criterion of settling. One whose reference ends moving has followed if the RMS error is at most a
    tenth (−20 dB) of the RMS distance of the desired motion from its own mean. Errors below 1 mm and 0.01 rad, which
    inverse kinematics calls reached, are always small.

    Parameters
    ----------
    record
        The run.
    law
        What drove the end effector: of one that controls a part of the pose only that part is judged.
    skip_initial
        Length of the start that does not count where the reference ends moving, s.
    robot
        That of the run: with it a run that rests short of its goal is told whether a singularity is in the way.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.task_result import task_result
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> goal, law = dqc.references.SetPoint(arm.fkm(q + 0.2)), dqc.laws.Proportional(gain=2.0)
    >>> for duration in (1.0, 4.0):
    ...     found = task_result(dqc.simulate(arm, goal, law, dqc.plants.Integrator(), q, 0.01, duration))
    ...     print(found.words)
    not reached: still moves 24.5 mm, 6.3° off
    reached
    """
    record = _before_braking(record)
    part = law.part if isinstance(law, PartialProportional) else "pose"
    distance = record.position_error if part in ("pose", "position") else None
    orientation = _orientation_error(record, law)
    if (
        law is not None and law.contact is not None
    ):  # where the end effector gives way it is not where the reference is
        distance, orientation = _along_rigid_axes(record, law.contact, orientation)
    found = _judged(record, _asked(record, skip_initial), distance, orientation)
    if record.stopped == "settled" and not found.succeeded:  # what `stop` asked for is reached
        return replace(found, outcome="reached" if found.rests else "followed")
    if robot is None or found.outcome != "not reached" or found.is_moving:
        return found
    lost = lost_share(robot, record.q[-1], record.desired[-1, POSE], part, inverse_of(law))
    return replace(found, is_singular=lost > _LOST)


def further_results(record: Record, tasks: PreparedTasks, skip_initial: float = 0.0) -> dict[str, TaskResult]:
    """Return whether a run did each of its further tasks, by their labels.

    One with a reference is judged as the law's task is. One without is kept if the RMS of how far it is from its start
    is at most 1 mm and 0.01 rad. A posture is reached as a pose at rest is. What corrects nothing (gain 0) is not
    judged.

    Parameters
    ----------
    record, skip_initial
        The run, as for `task_result`.
    tasks
        What it was to do beside the law's task.
    """
    record = _before_braking(record)
    found, errors = {}, tasks.errors(record.q)
    for label, task, samples, gain in zip(tasks.labels, tasks.tasks, tasks.samples, tasks.gains, strict=True):
        away, turned = errors[label].T
        always = np.ones(len(record), dtype=np.bool_)
        if gain == 0.0:
            continue
        if task is None:
            last = np.arange(len(record)) >= len(record) - max(1, int(_LAST * len(record)))
            found[label] = _judged(record, _Asked("reached", last, away[0], turned[0]), away, turned)
        elif len(samples) == 1:
            found[label] = _judged(record, _Asked("kept", always, 0.0, 0.0), away, turned)
        else:
            desired = samples[np.minimum(np.arange(len(record)), len(samples) - 1)]
            shown = replace(record, pose=tasks.robot.pose_of(task, record.q), desired=desired)
            found[label] = _judged(shown, _asked(shown, skip_initial), away, turned)
    return found


def _before_braking(record: Record) -> Record:
    """Return a record without its last samples in which the supervisor brakes softly: the run is over by then."""
    if INTERVENTIONS not in record.readings:
        return record
    brakes = record.readings[INTERVENTIONS].values[:, 0].astype(np.int64) & SOFT_STOP != 0
    count = len(record) if brakes.all() or not brakes[-1] else len(record) - int(brakes[::-1].argmin())
    return part_of(record, 0, count)


def _judged(record: Record, asked: _Asked, distance: Array | None, orientation: Array | None) -> TaskResult:
    """Return what the errors of position and orientation, m and rad, come to; None or NaN of what does not count."""
    rests = asked.outcome == "reached"
    errors, tolerances = [], []
    share = SETTLED if rests else FOLLOWED
    for error, size, least in (
        (distance, asked.distance, POSITION),
        (orientation, asked.angle, ORIENTATION),
    ):
        tolerances.append(float(np.fmax(least, share * size)))
        if error is None:
            errors.append(np.nan)
        elif rests:
            errors.append(float(error[asked.judged].max()))
        else:
            errors.append(float(np.sqrt(np.mean(error[asked.judged] ** 2))))
    good = all(
        error <= tolerance for error, tolerance in zip(errors, tolerances, strict=True) if error == error
    )
    outcome: Outcome = asked.outcome if good else _MISSED[asked.outcome]
    if has_failed(record.stopped) or not np.isfinite(record.q[-1]).all():
        outcome = "failed"
    return TaskResult(
        outcome,
        position=errors[0],
        orientation=errors[1],
        position_tolerance=tolerances[0],
        orientation_tolerance=tolerances[1],
        speed=_speed(record),
    )


def _to_the_end(record: Record, asked: _Motion) -> tuple[float, float]:
    """Return how far the end effector had to go and to turn, from its start or from the farthest that was desired."""
    way = np.linalg.norm(record.position[0] - record.desired_position[-1])
    turn = 2 * np.arccos(min(abs(record.pose[0, :4] @ record.desired[-1, :4]), 1.0))
    return float(np.maximum(way, asked.farthest)), float(np.maximum(turn, asked.widest))


def _resting(desired: Array) -> NDArray[np.bool_]:
    """Return which samples are in the last tenth of those at whose end the reference rests."""
    there = row_by_row(lambda rows: (np.abs(rows - desired[-1]) <= _SAME).all(axis=1), desired)
    first = len(there) - int(there[::-1].argmin()) if not there.all() else 0
    count = max(1, int(_LAST * (len(there) - first)))
    return np.arange(len(there)) >= len(there) - count


def _orientation_error(record: Record, law: Law | None) -> Array | None:
    if not isinstance(law, PartialProportional) or law.part == "rotation":
        return record.orientation_error
    if law.part == "position":
        return None
    direction = np.asarray(law.axis, dtype=np.float64)
    direction = direction / np.linalg.norm(direction)
    is_, wanted = (
        algebra.matrix_from_pose(x)[..., :3, :3] @ direction for x in (record.pose, record.desired[:, POSE])
    )
    return np.arctan2(row_norms(np.cross(is_, wanted)), np.einsum("ij,ij->i", is_, wanted))


def _along_rigid_axes(
    record: Record, contact: Admittance, orientation: Array | None
) -> tuple[Array | None, Array | None]:
    """Return the errors of position and orientation along axes that do not give way, None where all do."""
    rigid = contact.rigid
    left = contact.turned_to_axes(
        record.desired_position - record.position, record.pose, record.desired[:, POSE]
    )
    distance = row_norms(np.ascontiguousarray(left[:, rigid[3:]])) if rigid[3:].any() else None
    return distance, orientation if rigid[:3].all() else None


def _speed(record: Record) -> float:
    """Return the mean speed of the end effector over the last twentieth, m/s."""
    first = max(0, len(record) - 1 - max(1, len(record) // 20))
    passed = record.time[-1] - record.time[first]
    way = row_norms(np.diff(record.position[first:], axis=0)).sum()
    return float(way / passed) if passed else 0.0
