"""Parsimonious control: few inputs move at a time, chosen by a linear program. [Gonçalves et al. 2016]"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.optimize import linprog

from dqcontrol.arrays import Array
from dqcontrol.errors import InterpretedWarning, ValueRangeError, as_positive
from dqcontrol.laws import OwnLaw
from dqcontrol.robots import Robot


def parsimonious_law(
    robot: Robot, gain: float, weight: float = 0.99, limits_period: float | None = None
) -> OwnLaw:
    """Return the law u = argmin β |J u + η vec8(x − x_d)|₁ + (1 − β) |u|₁, subject to W u ≤ w.

    J is the robot's own pose Jacobian, of v and ω for a drive. A linear program has its least value at a vertex, where
    no more inputs move than the task needs. Its value is proportional to the error: with a small β the robot rests
    however large the error, and the larger β, the less of a task is left undone where it costs much motion.

    S17 cites it of a cascade for a drive [Quiroz-Omaña and Adorno 2016]. The papers are not at hand: the program is
    the form that the group's later papers give of it, with β assumed. Each sample is solved by itself by SciPy's HiGHS,
    in 1.6 ms; so this is a user's law, interpreted, and not one of `dqcontrol.laws`.

    Parameters
    ----------
    robot
        Whom it drives.
    gain
        η, 1/s.
    weight
        β in (0, 1).
    limits_period
        T, s: W u ≤ w are then the velocity limits of inputs and wheels, and the position limits reached in one period.
        With None there are no limits.

    Raises
    ------
    ValueRangeError
        If a number does not fit.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0.2, 0.6, 0.1, 1.6, 0.1, 0.6, 0])
    >>> law = parsimonious_law(arm, gain=0.5)
    >>> u = law.command(arm, q, dqc.Sample(arm.fkm(q + 0.1)), period=0.05)
    >>> int((np.abs(u) > 1e-9).sum()) < 7
    True
    """
    as_positive("gain", gain)
    if not 0 < weight < 1:
        raise ValueRangeError(f"weight: must be in (0, 1), got {weight:g}")
    m = robot.input_size
    cost = np.r_[np.full(2 * m, 1 - weight), np.full(16, weight)]
    wheels = _wheel_rows(robot)

    def parsimonious(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
        sign = 1.0 if pose[:4] @ sample[:4] >= 0 else -1.0
        rows = np.hstack([pose_jacobian, -pose_jacobian, -np.eye(8), np.eye(8)])
        right = gain * (sign * sample[:8] - pose)
        bounds, rims = (0, None), {}
        if limits_period is not None:
            bounds = _bounds(robot, q, limits_period)
            rims = {
                "A_ub": np.hstack([wheels[0], wheels[0], np.zeros((len(wheels[0]), 16))]),
                "b_ub": wheels[1],
            }
        found = linprog(cost, A_eq=rows, b_eq=right, bounds=bounds, method="highs-ds", **rims)
        out[:] = found.x[:m] - found.x[m : 2 * m]

    law = OwnLaw(function=parsimonious)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InterpretedWarning)  # it is meant to be
        _ = law.kernel
    return law


def _wheel_rows(robot: Robot) -> tuple[Array, Array]:
    """Return (W, w) with W (|v|, |ω|, …) ≤ w for the rim of each drive's faster wheel."""
    rows, most = np.zeros((len(robot.drives), robot.input_size)), np.zeros(len(robot.drives))
    for k, (first, *drive) in enumerate(robot.drives):
        j = int(first) - k
        rows[k, j], rows[k, j + 1] = 1.0, drive[2]
        most[k] = robot.limits.velocity[j]
    return rows, most


def _bounds(robot: Robot, q: Array, period: float) -> Array:
    """Return bounds of p, n ≥ 0, u = p − n, and of the sixteen residuals, shape (2 m + 16, 2)."""
    lost = len(q) - robot.input_size  # a drive's x and y are one input, and have no limits
    upper, lower = robot.limits.velocity.copy(), -robot.limits.velocity
    own = np.arange(3 * lost, len(q))
    to_upper, to_lower = (robot.limits.upper - q) / period, (robot.limits.lower - q) / period
    upper[own - lost] = np.minimum(upper[own - lost], to_upper[own])
    lower[own - lost] = np.maximum(lower[own - lost], to_lower[own])
    most = np.maximum(np.r_[upper, -lower, np.full(16, np.inf)], 0.0)
    return np.column_stack([np.zeros_like(most), most])
