"""The stability proof of feedback linearisation, applied to the record of one run. [S17 4.28–4.45]"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.laws import FeedbackLinearization, FilteredInverse, Law
from dqcontrol.loop.record import Record
from dqcontrol.loop.signals import Signal
from dqcontrol.measures.task_range import task_range
from dqcontrol.plants import Plant
from dqcontrol.references.sample import TWIST, TWIST_RATE
from dqcontrol.robots import Robot, WholeBody

LYAPUNOV = "lyapunov"  # among the readings of a record: V, then these parts
_PARTS = (
    "predicted_rate",
    "matrosov",
    "velocity_part",
    "pose_part",
    "outside_range",
    "smallest_singular_value",
)
_UNITS = ("1/s²", "1/s³", "1/s", "1/s²", "1/s²", "", "")


@dataclass(frozen=True, eq=False)
class Certificate:
    """The Lyapunov function V = |ξ̃|² + k̄ |log x̃|² of a run and what belongs to it, at each sample.

    ξ̃ = ξ_b − Ad(x̃*) ξ_d,b, where ξ_b is the body twist that the last command gave the end effector, 0 before the
    first.

    Attributes
    ----------
    time
        Shape (N,), s.
    velocity_part, pose_part
        |ξ̃|² and k̄ |log x̃|², shape (N,), 1/s².
    predicted_rate
        −2 k_v |ξ̃|², what V̇ is in continuous time where J⁺ is exact, shape (N,), 1/s³.
    matrosov
        W₂ = ⟨ξ̃, log x̃⟩, whose rate is −k_p |log x̃|² where ξ̃ = 0, shape (N,), 1/s. [S17 4.41–4.43]
    outside_range
        How much of the twist ξ_b + T U lies outside the range of J in V's measure |[ω ; ṗ]|, shape (N,), m/s and rad/s;
        see `task_range`.
    smallest_singular_value
        Of the Jacobian of the end effector's [ω ; ṗ], shape (N,).
    """

    time: Array
    velocity_part: Array
    pose_part: Array
    predicted_rate: Array
    matrosov: Array
    outside_range: Array
    smallest_singular_value: Array

    @property
    def value(self) -> Array:
        """V, shape (N,), 1/s²."""
        return self.velocity_part + self.pose_part

    @property
    def rate(self) -> Array:
        """Difference quotient of V from each sample to the next, shape (N − 1,), 1/s³."""
        return np.diff(self.value) / np.diff(self.time)

    @classmethod
    def recorded(cls, record: Record) -> Certificate | None:
        """Return what ``with_certificate`` wrote into a record; None if it wrote nothing."""
        if LYAPUNOV not in record.readings:
            return None
        values = record.readings[LYAPUNOV].values[:, 1:].T
        return cls(record.time, **dict(zip(_PARTS, values, strict=True)))

    @property
    def largest_rise(self) -> float:
        """Largest increase of V from one sample to the next as a share of its first value; 0 if it never rises."""
        return float(max(np.diff(self.value).max(initial=0.0), 0.0) / self.value[0])


# singular values of the end effector's Jacobian below it count as none, as in the law's own inverse
_THRESHOLD = 0.02


def certificate(robot: Robot, record: Record, law: FeedbackLinearization) -> Certificate:
    """Return V, its parts and rates, and what of the twist asked for the robot cannot do.

    Parameters
    ----------
    robot
        That of the run.
    record
        Of a run on ideal joints: the commands are taken for the motion.
    law
        Whose k̄ and k_v are meant. Any law's run may be judged by them; only this law's is certain to let V fall.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol.measures.lyapunov import certificate
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    >>> goal = dqc.references.SetPoint(robot.fkm(q + np.array([0.3, 0.2, 0.3, 0, 0, 0, 0, 0])))
    >>> law = dqc.laws.FeedbackLinearization(stiffness=1.0, damping=1.0)
    >>> record = dqc.simulate(robot, goal, law, dqc.plants.Integrator(), q, period=0.05, duration=20.0)
    >>> certificate(robot, record, law).largest_rise < 1e-4
    True
    """
    moved, inputs = _what_moved(robot, record)
    opposite = algebra.conjugate(record.pose)
    jacobian = moved.twist_jacobian(record.q)
    error = algebra.short(algebra.multiply(algebra.conjugate(record.desired_pose), record.pose))
    log = algebra.log_body(error)
    given = algebra.adjoint_twist(opposite, np.einsum("kij,kj->ki", jacobian, inputs))
    twist = np.vstack([np.zeros(6), given[:-1]])
    desired = algebra.adjoint_twist(opposite, record.desired[:, TWIST])
    desired_rate = algebra.adjoint_twist(opposite, record.desired[:, TWIST_RATE])
    error_twist = twist - desired
    wanted = -0.5 * law.stiffness * log - law.damping * error_twist + desired_rate
    acceleration = wanted + algebra.cross_twist(desired, error_twist)
    period = np.diff(record.time, append=2 * record.time[-1] - record.time[-2])[:, None]
    own = FilteredInverse(threshold=_THRESHOLD, characteristic_length=1.0)
    asked = task_range(moved, record, twist + period * acceleration, own)
    kinetic = (error_twist**2).sum(axis=1)
    return Certificate(
        time=record.time,
        velocity_part=kinetic,
        pose_part=law.stiffness * (log**2).sum(axis=1),
        predicted_rate=-2 * law.damping * kinetic,
        matrosov=(error_twist * log).sum(axis=1),
        outside_range=asked.outside,
        smallest_singular_value=asked.smallest_singular_value,
    )


def _what_moved(robot: Robot, record: Record) -> tuple[Robot, Array]:
    """Return the robot in the form whose inputs are what it did, and those inputs."""
    if isinstance(robot, WholeBody) and robot.form == "unconstrained":
        return robot.in_form("constrained"), robot.feasible_inputs(record.q, record.command)
    return robot, record.command


def with_certificate(robot: Robot, record: Record, law: Law, plant: Plant) -> Record:
    """Return a record that also holds its certificate, as the reading `LYAPUNOV`.

    Only a run of this law on ideal joints that did not diverge has one; other records are returned as they are.

    Parameters
    ----------
    robot, record, law, plant
        The run.
    """
    if not isinstance(law, FeedbackLinearization) or not plant.is_ideal:
        return record
    if len(record) < 2 or not np.isfinite(record.q).all():
        return record
    found = certificate(robot, record, law)
    values = np.column_stack([found.value, *(getattr(found, name) for name in _PARTS)])
    signal = Signal(LYAPUNOV, ("value", *_PARTS), _UNITS, values)
    return replace(record, readings={**record.readings, LYAPUNOV: signal})
