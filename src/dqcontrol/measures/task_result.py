"""Success of a run: it reached its reference at rest, or followed it in motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from dqcontrol import algebra
from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.contact import Admittance
from dqcontrol.controller import PreparedTasks
from dqcontrol.laws import Law, PartialProportional
from dqcontrol.loop.record import Record, has_failed, part_of, row_norms
from dqcontrol.measures.run_numbers import LAST, RunNumbers, run_numbers
from dqcontrol.measures.task_range import inverse_of, lost_share
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot
from dqcontrol.supervisor.interventions import INTERVENTIONS, SOFT_STOP
from dqcontrol.tables.number_texts import angle_text, length_text

Outcome = Literal["reached", "not reached", "followed", "not followed", "kept", "not kept", "failed"]

POSITION, ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is there, for inverse kinematics too
SETTLED = 0.02  # of what was asked: the settling criterion
FOLLOWED = 0.1  # of what was asked: a sensitivity of −20 dB
_MISSED: dict[Outcome, Outcome] = {"reached": "not reached", "followed": "not followed", "kept": "not kept"}
_LOST = 0.5  # of what is left of an error at rest: from there on it is a singularity that is in the way


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
    def at_rest(self) -> bool:
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
            (self.position, self.position_tolerance, length_text(self.position)),
            (self.orientation, self.orientation_tolerance, angle_text(self.orientation)),
        ):
            if np.isfinite(error) and (self.succeeded or error > tolerance):
                parts.append(text)
        if not parts:
            return ""
        if self.at_rest:
            where = " in a singularity" * self.is_singular
            return f"{'still moves,' if self.is_moving else 'rests'} {', '.join(parts)} off{where}"
        return f"errs by {', '.join(parts)} RMS"


class _Asked(NamedTuple):
    """What is asked of a task.

    Attributes
    ----------
    outcome
        Of one that is done.
    first
        The first sample at which it is judged.
    distance, angle
        How far it is asked to go and to turn, m and rad, of which the errors may be a share.
    """

    outcome: Outcome
    first: int
    distance: float
    angle: float

    def left_of(self, error: Array) -> float:
        """Return what errors (N,) come to: at rest the largest, on the way their RMS."""
        judged = error[self.first :]
        return float(judged.max()) if self.outcome == "reached" else float(np.sqrt(np.mean(judged**2)))


def _asked(record: Record, numbers: RunNumbers) -> _Asked:
    """Return what the desired motion of a record asks for."""
    motion = numbers.desired.numbers
    if numbers.desired.rest is None:
        return _Asked("followed", numbers.judged, motion.distance, motion.angle)
    # from the end effector's start, or from the farthest that was desired
    way = math.dist(position(record.pose[0]), position(record.desired[-1]))
    turn = 2 * math.acos(min(abs(record.pose[0, :4] @ record.desired[-1, :4]), 1.0))
    return _Asked("reached", numbers.judged, max(motion.farthest, way), max(motion.widest, turn))


def task_result(
    record: Record,
    *,
    law: Law | None = None,
    skip_initial: float = 0.0,
    robot: Robot | None = None,
    numbers: RunNumbers | None = None,
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
    numbers
        Of the run, if they are known.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.task_result import task_result
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> goal, law = dqc.references.SetPoint(arm.fkm(q + 0.2)), dqc.laws.Proportional(gain=2.0)
    >>> for duration in (1.0, 4.0):
    ...     found = task_result(dqc.simulate(arm, goal, law, dqc.plants.Integrator(), q, 0.01, duration))
    ...     print(found.words)
    not reached: still moves, 24.5 mm, 6.3° off
    reached
    """
    judged = _before_braking(record)
    if numbers is None or judged is not record:
        numbers = run_numbers(judged, skip_initial=skip_initial)
    record, asked = judged, _asked(judged, numbers)
    part, at_rest = law.part if isinstance(law, PartialProportional) else "pose", asked.outcome == "reached"
    distance = 1e-3 * (numbers.task.farthest if at_rest else numbers.task.distance)
    orientation = math.radians(numbers.task.widest if at_rest else numbers.task.turn)
    if part not in ("pose", "position"):
        distance = math.nan
    if part == "position":
        orientation = math.nan
    elif isinstance(law, PartialProportional) and part == "axis":
        orientation = asked.left_of(_axis_error(record, law))
    if law is not None and law.contact is not None:  # where it gives way it is not where the reference is
        rigid = law.contact.rigid
        distance = asked.left_of(_rigid_distance(record, law.contact)) if rigid[3:].any() else math.nan
        orientation = orientation if rigid[:3].all() else math.nan
    found = _judged(record, asked, distance, orientation, numbers.task.speed)
    if record.stopped == "settled" and not found.succeeded:  # what `stop` asked for is reached
        return replace(found, outcome="reached" if found.at_rest else "followed")
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
        if gain == 0.0:
            continue
        numbers = run_numbers(record, skip_initial=skip_initial)
        if task is None:
            first = len(record) - max(1, int(LAST * len(record)))
            asked = _Asked("reached", first, away[0], turned[0])
        elif len(samples) == 1:
            asked = _Asked("kept", 0, 0.0, 0.0)
        else:
            desired = samples[np.minimum(np.arange(len(record)), len(samples) - 1)]
            shown = replace(record, pose=tasks.robot.pose_of(task, record.q), desired=desired)
            numbers = run_numbers(shown, skip_initial=skip_initial)
            asked = _asked(shown, numbers)
        left = asked.left_of(away), asked.left_of(turned)
        found[label] = _judged(record, asked, *left, numbers.task.speed)
    return found


def _before_braking(record: Record) -> Record:
    """Return a record without its last samples in which the supervisor brakes softly: the run is over by then."""
    if INTERVENTIONS not in record.readings:
        return record
    brakes = record.readings[INTERVENTIONS].values[:, 0].astype(np.int64) & SOFT_STOP != 0
    count = len(record) if brakes.all() or not brakes[-1] else len(record) - int(brakes[::-1].argmin())
    return record if count == len(record) else part_of(record, 0, count)


def _judged(record: Record, asked: _Asked, distance: float, orientation: float, speed: float) -> TaskResult:
    """Return what errors of position and orientation, m and rad, come to; NaN of what does not count."""
    share = SETTLED if asked.outcome == "reached" else FOLLOWED
    allowed = max(POSITION, share * asked.distance), max(ORIENTATION, share * asked.angle)
    # what does not count is NaN, and that is not beyond
    good = not (distance > allowed[0] or orientation > allowed[1])
    outcome: Outcome = asked.outcome if good else _MISSED[asked.outcome]
    if has_failed(record.stopped) or not np.isfinite(record.q[-1]).all():
        outcome = "failed"
    return TaskResult(outcome, distance, orientation, *allowed, speed)


def _axis_error(record: Record, law: PartialProportional) -> Array:
    """Return the angle between the axis of a law and where it is to be, shape (N,), rad."""
    poses = record.pose, record.desired[:, POSE]
    is_, wanted = (algebra.matrix_from_pose(each)[..., :3, :3] @ np.array(law.axis) for each in poses)
    return np.arctan2(row_norms(np.cross(is_, wanted)), np.einsum("ij,ij->i", is_, wanted))


def _rigid_distance(record: Record, contact: Admittance) -> Array:
    """Return the error of position along axes that do not give way, shape (N,), m."""
    left = contact.turned_to_axes(
        record.desired_position - record.position, record.pose, record.desired[:, POSE]
    )
    return row_norms(np.ascontiguousarray(left[:, contact.rigid[3:]]))
