"""Whether a run did what was asked of it: reached where its reference rests, or followed it as it moved."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.files.long_array import row_by_row
from dqcontrol.laws import Law, PartialProportional
from dqcontrol.loop.record import Record, has_failed, row_norms
from dqcontrol.measures.task_range import inverse_of, lost_share
from dqcontrol.moved import renamed_parameters
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot

Outcome = Literal["reached", "not reached", "followed", "not followed", "failed"]

POSITION, ORIENTATION = 1e-3, 1e-2  # m, rad: nearer than that is there, for inverse kinematics too
SETTLED = 0.02  # of what was asked: the settling criterion
FOLLOWED = 0.1  # of what was asked: a sensitivity of −20 dB
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
        it ends moving, ``"failed"`` of a run that diverged, faulted or was halted.
    position, orientation
        The error that decides, m and rad: the largest of the last tenth of the time in which the reference rests, or
        the RMS of the whole way. NaN where the law leaves that part free.
    position_tolerance, orientation_tolerance
        Up to which it is good, m and rad.
    speed
        Of the hand at the end, m/s.
    is_singular
        Whether it rests where no joint can move the hand towards its goal, and every law stands still.
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
        return self.outcome in ("reached", "followed")

    @property
    def rests(self) -> bool:
        """Whether the reference ends at rest."""
        return self.outcome in ("reached", "not reached")

    @property
    def is_moving(self) -> bool:
        """Whether the hand still moves at the end, by more than the tolerance in a second."""
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


@renamed_parameters(settle="skip_initial")
def task_result(
    record: Record, *, law: Law | None = None, skip_initial: float = 0.0, robot: Robot | None = None
) -> TaskResult:
    """Return whether a run did what was asked.

    A run whose reference ends at rest has reached its goal if it stays within 2 % of the way that was asked for
    (position: from the hand's start, or the farthest point of the reference, to the goal; orientation: the same
    angle), the usual criterion of settling. One whose reference ends moving has followed if the RMS error is at most a
    tenth (−20 dB) of the RMS distance of the desired motion from its own mean. Errors below 1 mm and 0.01 rad, which
    inverse kinematics calls reached, are always small.

    Parameters
    ----------
    record
        The run.
    law
        What drove the hand: of one that controls a part of the pose only that part is judged.
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
    not reached: still moves 23.8 mm, 6.1° off
    reached
    """
    part = law.part if isinstance(law, PartialProportional) else "pose"
    desired = record.desired[:, POSE]
    ends_at_rest = _ends_at_rest(desired)
    judged = _resting(desired) if ends_at_rest else record.time >= record.time[0] + skip_initial * (1 - 1e-12)
    position = record.position_error if part in ("pose", "position") else None
    orientation = _orientation_error(record, law)
    errors, tolerances = [], []
    share = SETTLED if ends_at_rest else FOLLOWED
    for error, asked, least in (
        (position, _asked_position(record, ends_at_rest), POSITION),
        (orientation, _asked_orientation(record, ends_at_rest), ORIENTATION),
    ):
        tolerances.append(max(least, share * asked))
        if error is None:
            errors.append(np.nan)
        elif ends_at_rest:
            errors.append(float(error[judged].max()))
        else:
            errors.append(float(np.sqrt(np.mean(error[judged] ** 2))))
    good = all(
        error <= tolerance for error, tolerance in zip(errors, tolerances, strict=True) if error == error
    )
    outcome: Outcome = "reached" if ends_at_rest else "followed"
    if has_failed(record.stopped) or not np.isfinite(record.q[-1]).all():
        outcome = "failed"
    elif not good and record.stopped != "settled":  # what `stop` asked for is reached
        outcome = "not reached" if ends_at_rest else "not followed"
    found = TaskResult(
        outcome,
        position=errors[0],
        orientation=errors[1],
        position_tolerance=tolerances[0],
        orientation_tolerance=tolerances[1],
        speed=_speed(record),
    )
    if robot is None or outcome != "not reached" or found.is_moving:
        return found
    lost = lost_share(robot, record.q[-1], desired[-1], part, inverse_of(law))
    return replace(found, is_singular=lost > _LOST)


def _ends_at_rest(desired: Array) -> bool:
    """Return whether a motion has all but stopped at its last step: samples beyond its end rest whatever it did."""
    steps = row_by_row(lambda rows: row_norms(np.diff(rows, axis=0)), desired, ahead=1)
    return not len(steps) or bool(steps[-1] <= _SLOW * steps.max() + _SAME)


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


def _asked_position(record: Record, ends_at_rest: bool) -> float:
    points = record.desired_position
    if not ends_at_rest:
        middle = points.mean(axis=0)
        return float(np.sqrt(np.mean(row_by_row(lambda rows: row_norms(rows - middle), points) ** 2)))
    way = row_by_row(lambda rows: row_norms(rows - points[-1]), points)
    return float(np.maximum(way.max(), row_norms(record.position[:1] - points[-1])[0]))


def _asked_orientation(record: Record, ends_at_rest: bool) -> float:
    turns = record.desired[:, :4]
    if not ends_at_rest:
        middle = row_by_row(lambda rows: rows * np.sign(rows @ turns[0])[:, None], turns).sum(axis=0)
        return float(np.sqrt(np.mean(_angles(turns, middle / np.linalg.norm(middle)) ** 2)))
    return float(np.maximum(_angles(turns, turns[-1]).max(), _angles(record.pose[:1, :4], turns[-1])[0]))


def _angles(quaternions: Array, other: Array) -> Array:
    return row_by_row(lambda rows: 2 * np.arccos(np.minimum(np.abs(rows @ other), 1.0)), quaternions)


def _speed(record: Record) -> float:
    """Return the mean speed of the hand over the last twentieth, m/s."""
    first = max(0, len(record) - 1 - max(1, len(record) // 20))
    passed = record.time[-1] - record.time[first]
    way = row_norms(np.diff(record.position[first:], axis=0)).sum()
    return float(way / passed) if passed else 0.0
