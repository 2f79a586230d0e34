"""The range condition: how much of the twist asked for the robot cannot give. [S17 4.20, left open there]"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.files import long_array
from dqcontrol.laws import FilteredInverse, Law
from dqcontrol.laws.inverses import Inverse
from dqcontrol.loop.record import Record, part_of, row_norms
from dqcontrol.loop.signals import Signal
from dqcontrol.references.sample import TWIST
from dqcontrol.robots import Robot

Part = Literal["pose", "position", "rotation", "axis"]

RANGE = "range_condition"  # among the readings of a record

_DEFAULT = FilteredInverse()
_AT_LIMIT = 1e-6  # rad or m
_FARTHEST = 1e6  # m; farther away a run has diverged
_HERE = np.array([1.0, 0, 0, 0, 0, 0, 0, 0])


@dataclass(frozen=True, eq=False)
class TaskRange:
    """Distance of twists from the range of the end effector's Jacobian, at each sample of a run.

    Attributes
    ----------
    time
        Shape (N,), s.
    asked
        |[ℓω ; ṗ]| of the end effector's twist that is asked for, shape (N,), m/s.
    outside
        Norm of its part outside the range: along directions with singular values below the threshold, shape (N,).
    smallest_singular_value
        Of the Jacobian of [ℓω ; ṗ] without the joints that rest at their limits, shape (N,); 0 where it has fewer than
        six columns.
    """

    time: Array
    asked: Array
    outside: Array
    smallest_singular_value: Array

    @property
    def share(self) -> Array:
        """Outside over asked, 0 … 1, shape (N,); 0 where nothing is asked for."""
        return np.divide(self.outside, self.asked, out=np.zeros_like(self.asked), where=self.asked > 0)

    @classmethod
    def recorded(cls, record: Record) -> TaskRange:
        """Return what ``with_range`` wrote into a record."""
        return cls(record.time, *record.readings[RANGE].values.T)


def task_range(
    robot: Robot, record: Record, body_twist: Array | None = None, inverse: Inverse = _DEFAULT
) -> TaskRange:
    """Return how far the twists asked for are from what the robot can do.

    Parameters
    ----------
    robot
        That of the run. Drives count with what they can do, v and ω, in the unconstrained form too.
    record
        Of the run; a sample that is not finite, or a million metres away, gives NaN.
    body_twist
        What was asked for, body twists (N, 6), rad/s and m/s. If omitted, what any law has to ask for sooner or later:
        the twist that leads straight to the desired pose in a second, 2 log(x*x_d) of the body logarithm, and that of
        the desired pose, Ad(x*) ξ_d. A run that ends where all of it lies outside is stuck.
    inverse
        That of the law. Its ℓ is the measure in which the law misses what it cannot do; directions count as lost where
        singular values are below ε, of inverses without ε below λ, where less than half of what is asked is done.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures import task_range
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    >>> beside = dqc.references.SetPoint(robot.fkm(q + np.array([-0.5, 0.5, 0, 0, 0, 0, 0, 0])))
    >>> law, plant = dqc.laws.Proportional(gain=0.5), dqc.plants.Integrator()
    >>> record = dqc.simulate(robot, beside, law, plant, q, period=0.05, duration=60.0)
    >>> found = task_range(robot, record)
    >>> round(float(found.share[0]), 1), round(float(found.share[-1]), 1), bool(record.error[-1] > 0.01)
    (0.3, 1.0, True)
    """
    moved = robot.in_form("constrained")
    usable = np.isfinite(record.q).all(axis=1) & (np.abs(record.pose).max(axis=1) < _FARTHEST)
    q, pose = np.where(usable[:, None], record.q, 0.0), np.where(usable[:, None], record.pose, _HERE)
    if body_twist is None:
        opposite = algebra.conjugate(pose)
        error = algebra.short(algebra.multiply(opposite, record.desired_pose))
        body_twist = 2 * algebra.log_body(error) + algebra.adjoint_twist(opposite, record.desired[:, TWIST])
    jacobian = np.where(_resting_at_limits(moved, q)[:, None, :], 0.0, moved.hand_jacobian(q))
    weight = _weight(inverse)
    left, values, _ = np.linalg.svd(weight[:, None] * jacobian)
    rotation = np.hstack([pose[:, :4], np.zeros((len(record), 4))])
    components = np.einsum("kij,ki->kj", left, weight * algebra.adjoint_twist(rotation, body_twist))
    count = values.shape[1]  # fewer than six inputs leave directions without any singular value
    lost = np.hstack([values < _lost_below(inverse), np.ones((len(values), 6 - count), dtype=bool)])
    return TaskRange(
        time=record.time,
        asked=np.where(usable, row_norms(components), np.nan),
        outside=np.where(usable, row_norms(np.where(lost, components, 0.0)), np.nan),
        smallest_singular_value=np.where(usable, 0.0 if count < 6 else values[:, -1], np.nan),
    )


def lost_share(
    robot: Robot, q: Array, desired: Array, part: Part = "pose", inverse: Inverse = _DEFAULT
) -> float:
    """Return how much of the error lies where a singularity lets no joint move the end effector, 0 … 1.

    At 1 every law that only follows its error stands still. A base with wheels, which never moves sideways, and an arm
    of fewer joints than a pose has directions are not meant: 0.

    Parameters
    ----------
    robot
        Any robot.
    q
        Where it is, shape (n,), rad or m.
    desired
        Pose, shape (8,), inertial frame.
    part
        Of the pose that counts: that which a law controls. Of an axis all of its rotation is taken.
    inverse
        That of the law, whose ℓ is the measure and which says which singular values count as none, as for `task_range`.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.task_range import lost_share
    >>> arm, upright = dqc.load_robot("iiwa7"), np.zeros(7)
    >>> down = dqc.algebra.multiply(dqc.algebra.pose([1, 0, 0, 0], [0, 0, -0.1]), arm.fkm(upright))
    >>> lost_share(arm, upright, down), lost_share(arm, np.array([0, 0.6, 0, 0.7, 0, 0.7, 0]), down)
    (1.0, 0.0)
    """
    if len(robot.drives) or robot.input_size < 6 or not np.isfinite(q).all():
        return 0.0
    pose = robot.fkm(q)
    body_twist = 2 * algebra.log_body(algebra.short(algebra.multiply(algebra.conjugate(pose), desired)))
    rows = {"pose": slice(0, 6), "position": slice(3, 6)}.get(part, slice(0, 3))
    rotation = np.concatenate([pose[:4], np.zeros(4)])
    weight = _weight(inverse)[rows]
    left, values, _ = np.linalg.svd(weight[:, None] * robot.hand_jacobian(q)[rows])
    components = left.T @ (weight * algebra.adjoint_twist(rotation, body_twist)[rows])
    asked = float(np.linalg.norm(components))
    return float(np.linalg.norm(components[values < _lost_below(inverse)])) / asked if asked > 0 else 0.0


def _weight(inverse: Inverse) -> Array:
    """Return what the rows of [ω ; ṗ] are multiplied by in the measure of an inverse."""
    return np.array([inverse.characteristic_length] * 3 + [1.0] * 3)


def _lost_below(inverse: Inverse) -> float:
    """Return the singular value below which an inverse does less than about half of what is asked."""
    return inverse.threshold if isinstance(inverse, FilteredInverse) else inverse.damping


def inverse_of(law: Law | None) -> Inverse:
    """Return the inverse of a law; the default of laws that have none."""
    found = getattr(law, "inverse", None)
    return found if isinstance(found, Inverse) else _DEFAULT


def with_range(robot: Robot, record: Record, law: Law | None = None) -> Record:
    """Return a record that also holds its range condition, as the reading `RANGE`, if the robot has drives.

    Parameters
    ----------
    robot
        That of the run.
    record
        The run.
    law
        What drove the end effector; its inverse says in which measure.
    """
    if not len(robot.drives):
        return record
    values, block = long_array.long_array(len(record), 3), long_array.BLOCK
    inverse = inverse_of(law)
    for first in range(0, len(record), block):
        # Whether a joint rests is seen from the next sample, of the last from that before.
        begin = max(first - 1, 0)
        found = task_range(robot, part_of(record, begin, first + block + 1), inverse=inverse)
        columns = np.column_stack([found.asked, found.outside, found.smallest_singular_value])
        values[first : first + block] = columns[first - begin :][:block]
    signal = Signal(RANGE, ("asked", "outside", "smallest_singular_value"), ("", "", ""), values)
    return replace(record, readings={**record.readings, RANGE: signal})


def outside_range(record: Record) -> float:
    """Return ∫ outside dt / ∫ asked dt over a run, 0 … 1; NaN without the reading `RANGE`."""
    if RANGE not in record.readings:
        return math.nan
    found = TaskRange.recorded(record)
    asked = float(np.trapezoid(found.asked, found.time))
    return float(np.trapezoid(found.outside, found.time)) / asked if asked else math.nan


def _resting_at_limits(robot: Robot, q: Array) -> NDArray[np.bool_]:
    """Return which inputs move a joint that is at a limit and does not leave it with the next sample, (N, m)."""
    limits = robot.limits
    at_limit = (q >= limits.upper - _AT_LIMIT) | (q <= limits.lower + _AT_LIMIT)
    stays = np.vstack([q[1:] == q[:-1], q[-1:] == q[-2:-1]]) if len(q) > 1 else np.zeros_like(at_limit)
    return (at_limit & stays)[:, robot.input_coordinates]
