"""The classic law for mobile manipulators, which takes their bases as if they could move sideways."""

from __future__ import annotations

import numpy as np

from dqcontrol.compiled.compile import kernel
from dqcontrol.compiled.intrinsics import as_matrix
from dqcontrol.laws.inverses import work_size
from dqcontrol.laws.law import LAW, SCRATCH
from dqcontrol.laws.pose_error import left_error, solve_left_error
from dqcontrol.laws.pose_law import GAIN, HYSTERESIS, PoseLaw
from dqcontrol.laws.unconstrained_drive import drive_table, feasible_inputs, twist_jacobian_with_sideways
from dqcontrol.robots import Robot

_DRIVES = GAIN + 8


@kernel(LAW)
def classic_whole_body(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write F N⁺ K vec8(e), N with a sideways column for each drive."""
    m = out.shape[0]
    scratch, rest = work[m : m + SCRATCH], work[m + SCRATCH :]
    drives = as_matrix(parameters[_DRIVES:], (parameters.shape[0] - _DRIVES) // 2, 2)
    n = m + drives.shape[0]
    twist_columns = as_matrix(rest[0 : 6 * n], 6, n)
    rates, inner = rest[6 * n : 7 * n], rest[7 * n :]
    twist_jacobian_with_sideways(drives, twist_jacobian, twist_columns)
    for i in range(n):
        inner[i] = work[i] if i < m else 0.0

    error, target = scratch[0:8], scratch[8:16]
    left_error(pose, sample, parameters[HYSTERESIS], state, error)
    for i in range(8):
        target[i] = parameters[GAIN + i] * error[i]
    status = solve_left_error(target, error, pose, twist_columns, parameters, inner, rates)
    feasible_inputs(drives, rates, out)
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
        How J is inverted; the default is exact away from singularities.
    hysteresis
        How far Re(x*x_d) must pass 0 before the sign of x_d changes.
    null_space
        Motion preferred where the task leaves freedom; sideways motion is not preferred.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(q + [0.1, 0.05, 0, 0, 0, 0, 0, 0]))
    >>> law = dqc.laws.ClassicWholeBody(gain=0.5)
    >>> dict(zip(robot.input_names, law.command(robot, q, target, dt=0.05).round(3).tolist()))["v"] > 0
    True
    """

    kernel = classic_whole_body

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis, gain diagonal and the table of drives at each time."""
        rows = super().parameter_rows(robot, times)
        return np.hstack([rows, np.tile(drive_table(robot).ravel(), (len(rows), 1))])

    def work_size(self, robot: Robot) -> int:
        """Return room for a Jacobian with sideways columns, rates, and what `Proportional` needs for them."""
        m, n = robot.input_size, robot.input_size + len(drive_table(robot))
        return m + SCRATCH + 7 * n + SCRATCH + 7 * n + 6 + work_size()
