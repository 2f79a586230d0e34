"""The classic law for mobile manipulators, which takes their bases as if they could move sideways."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled import LAW, MemoryLayout, inline, kernel
from dqcontrol.laws import DampedPoseInverse, FilteredInverse, Inverse, PoseLaw, parts
from dqcontrol.robots import Robot
from dqcontrol_theses.variants.sideways_drives import feasible_inputs, twist_jacobian_with_sideways


class WholeBodyParameters(NamedTuple):
    """What compiled code knows of the law."""

    inverse: Annotated[Array, parts.inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]
    drives: Annotated[Array, "drives", 2]


class WholeBodyWork(NamedTuple):
    """Its scratch; columns are those of m inputs, and one for each drive that cannot move sideways."""

    preferred: Annotated[Array, "m"]
    error: Annotated[Array, 8]
    target: Annotated[Array, 8]
    jacobian: Annotated[Array, 6, "columns"]
    rates: Annotated[Array, "columns"]
    preferred_rates: Annotated[Array, "columns"]
    solver: Annotated[Array, parts.twist_work.sized("columns")]


whole_body_parameters: MemoryLayout[WholeBodyParameters] = MemoryLayout(WholeBodyParameters, "drives")
whole_body_work: MemoryLayout[WholeBodyWork] = MemoryLayout(WholeBodyWork, "m", "columns")


@inline
def from_goal(pose, sample):
    """Return p − p_d, inertial axes."""
    (x, y, z), (a, b, c) = position(pose), position(sample)
    return x - a, y - b, z - c


@kernel(LAW)
def classic_whole_body(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write F N⁺ K vec8(e), N with a sideways column for each drive."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given, own = whole_body_parameters(parameters, k), whole_body_work(work, m, m + k)
    twist_jacobian_with_sideways(given.drives, twist_jacobian, own.jacobian)
    for i in range(m + k):
        own.preferred_rates[i] = own.preferred[i] if i < m else 0.0

    parts.left_error(pose, sample, given.hysteresis, state, own.error)
    for i in range(8):
        own.target[i] = given.gain[i] * own.error[i]
    if parts.inverse_parameters(given.inverse).kind == parts.DAMPED_POSE:
        twist = parts.left_error_twist(own.target, own.error, pose, given.inverse)
        lever = from_goal(pose, sample)
        status = parts.solve_pose_rows(
            pose, lever, own.jacobian, twist, own.preferred_rates, given.inverse, own.solver, own.rates
        )
    else:
        status = parts.solve_left_error(
            own.target,
            own.error,
            pose,
            own.jacobian,
            sample,
            own.preferred_rates,
            given.inverse,
            own.solver,
            own.rates,
        )
    feasible_inputs(given.drives, own.rates, out)
    return status


class ClassicWholeBody(PoseLaw, frozen=True, kw_only=True, tag="classic-whole-body"):
    """K for mobile manipulators as S17 compares with: u = F N⁺ K vec8(1 − x*x_d). [S17 4.46]

    N is that of a base that can move sideways. F is what a drive can do of it, v and ω: its displaced point moves as
    asked, and sideways motion becomes turning. The hand therefore does not move as N⁺ means it to, and no decay is
    guaranteed; it does where no sideways motion is asked for. For robots without differential drives, and in the
    unconstrained form, where the plant does what F does, it is `Proportional`; that law with the constrained Jacobian
    moves the hand as asked.

    Sampling limits and choice: those of `Proportional`. The first command is proportional to the error.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, eight diagonal entries, or a `Schedule` of k.
    inverse
        How N is inverted; the default is exact away from singularities. A `DampedPoseInverse` damps the eight rows of
        N, whose measure weighs turning by how far the hand is from the goal.
    hysteresis
        How far Re(x*x_d) must pass 0 before the sign of x_d changes.
    null_space
        Motion preferred where the task leaves freedom; sideways motion is not preferred.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import ClassicWholeBody
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(q + [0.1, 0.05, 0, 0, 0, 0, 0, 0]))
    >>> law = ClassicWholeBody(gain=0.5)
    >>> dict(zip(robot.input_names, law.command(robot, q, target, period=0.05).round(3).tolist()))["v"] > 0
    True
    """

    kernel = classic_whole_body
    inverse: Inverse | DampedPoseInverse = FilteredInverse()  # pyright: ignore[reportIncompatibleVariableOverride]

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis, gain diagonal and the table of drives at each time."""
        rows = parts.pose_parameters(super().parameter_rows(robot, times))
        return whole_body_parameters.pack(**rows._asdict(), drives=parts.drive_table(robot))

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and scratch, with a sideways speed for each drive."""
        return whole_body_work.size(robot.input_size, robot.input_size + len(parts.drive_table(robot)))
