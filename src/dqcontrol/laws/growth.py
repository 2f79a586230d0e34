"""Damping that grows with the curvature that a Jacobian leaves out: it keeps laws calm where a target is out of reach.

A law that asks for k e, e = [ℓθ ; p_d − p], descends ½|e|². Its Hessian is JᵀJ + C with C = −Σ eᵢ ∂²xᵢ; J⁺ reckons
with JᵀJ alone. Where the target is within reach, C vanishes with e. At the pose nearest to a target out of reach e
stays and σ → 0: the gain of the loop is then k C/(σ² + λ²), as large as 1600 k on an arm, and the joints turn back in
every period. With λ² ≥ c‖C‖ it is k/c at most. In chain order, with ω and a the columns of angular and end effector
velocity,

C_ij = e_p · (ω_i × a_j) + ½ℓ² θ · (ω_i × ω_j) = ω_i · b_j, i ≤ j, b_j = a_j × e_p + ½ℓ² ω_j × θ.

On a base that drives, height alone is out of reach: what else is missing is driven away, so that distant targets would
slow the robot for nothing. Turns, x and y then count by the share ½k (T + delay + lag)/c, which leaves out what c has
in excess for rests 10 m away. No less: a base that cannot move sideways may come to rest metres beside its target.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import apart, inline

if TYPE_CHECKING:
    from dqcontrol.laws.law import LoopRates
    from dqcontrol.robots.robot import Robot

NO_ERROR = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # of what is moved without feedback

LEAST = 0.1  # c: `python benchmarks/out_of_reach.py`: smaller, some arms swing at a rest 10 m away
_RATE_UNKNOWN = 0.2  # c where a law does not know its loop rate: enough up to k T = 0.4


@inline
def pose_error(pose, desired):
    """Return [θ ; p_d − p], inertial axes: θ ≈ 2 Im r_d r*, the short way round."""
    w, x, y, z = pose[0], pose[1], pose[2], pose[3]
    a, b, c, d = desired[0], desired[1], desired[2], desired[3]
    twice = 2.0 if a * w + b * x + c * y + d * z >= 0.0 else -2.0
    px, py, pz = position(pose)
    dx, dy, dz = position(desired)
    return (
        twice * (b * w - a * x - c * z + d * y),
        twice * (c * w - a * y - d * x + b * z),
        twice * (d * w - a * z - b * y + c * x),
        dx - px,
        dy - py,
        dz - pz,
    )


@inline
def counted(error, share):
    """Return what of [θ ; p_d − p] damping grows with: all, but of turns, x and y a share."""
    a, b, c, x, y, z = error
    return share * a, share * b, share * c, share * x, share * y, z


@inline
def square_bound(error, square_length, turning, columns):
    """Return a bound of ‖C‖² from the traces Σ|ω|² and Σ|[ℓω ; a]|², of what the error has of turns and moves.

    |b_j| ≤ |e| |[ℓω_j ; a_j]|, and each product of an ω and a b counts twice at most.
    """
    size = square_length * (error[0] * error[0] + error[1] * error[1] + error[2] * error[2])
    size += error[3] * error[3] + error[4] * error[4] + error[5] * error[5]
    return 2.0 * size * turning * columns


@apart
def curvature(twist_jacobian, px, py, pz, error, square_length):
    """Return ‖C‖_F = √Σⱼ bⱼᵀ (2 Σ_{i<j} ωᵢωᵢᵀ + ωⱼωⱼᵀ) bⱼ."""
    tx, ty, tz, ex, ey, ez = error
    half = 0.5 * square_length
    tx, ty, tz = half * tx, half * ty, half * tz
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    total = 0.0
    for j in range(twist_jacobian.shape[1]):
        x, y, z = twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j]
        ax = twist_jacobian[3, j] - py * z + pz * y
        ay = twist_jacobian[4, j] - pz * x + px * z
        az = twist_jacobian[5, j] - px * y + py * x
        bx = ay * ez - az * ey + y * tz - z * ty
        by = az * ex - ax * ez + z * tx - x * tz
        bz = ax * ey - ay * ex + x * ty - y * tx
        along = x * bx + y * by + z * bz
        total += bx * (xx * bx + xy * by + xz * bz)
        total += by * (xy * bx + yy * by + yz * bz)
        total += bz * (xz * bx + yz * by + zz * bz) + 0.5 * along * along
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    return math.sqrt(max(2.0 * total, 0.0))


@inline
def added_damping(missing, growth, columns, least):
    """Return (c‖C‖ − σ²)₊ with a lower bound of σ²min; C is formed only where the bound of it does not say 0.

    What is missing is (twist Jacobian, p, error, ℓ²); Σ|[ℓω ; a]|² is the trace of the Gram matrix.
    """
    twist_jacobian, (px, py, pz), error, square_length = missing
    if growth == 0.0:
        return 0.0
    turning = 0.0
    for j in range(twist_jacobian.shape[1]):
        for i in range(3):
            turning += twist_jacobian[i, j] * twist_jacobian[i, j]
    if growth * growth * square_bound(error, square_length, turning, columns) <= least * least:
        return 0.0
    return max(growth * curvature(twist_jacobian, px, py, pz, error, square_length) - least, 0.0)


def drives_anywhere(robot: Robot) -> bool:
    """Return whether a base takes the end effector to every x, y and heading.

    Such a base turns about z in all configurations.
    """
    for first, _ in robot.bases:
        turn = np.searchsorted(robot.input_coordinates, first + 2)
        axes = [
            robot.twist_jacobian(np.full(robot.configuration_size, each))[:3, turn] for each in (0.0, 1.0)
        ]
        if np.isinf(robot.limits.upper[first : first + 2]).all() and np.allclose(axes, [0.0, 0.0, 1.0]):
            return True
    return False


class Growth(NamedTuple):
    """How damping grows: c of `FilteredInverse`, and what of an error counts, see `counted`; each of shape (K,)."""

    growth: Array
    share: Array


def growth_for(robot: Robot, rates: LoopRates | None, late: float, period: float) -> Growth:
    """Return c at each row of a law's parameters, k (T + delay + lag)/2 and not less than 0.1, and what counts.

    Parameters
    ----------
    robot
        Where a base drives, not all of an error counts.
    rates
        Of the law; None if they are not known.
    late
        Delay and time constant of the joints together, s.
    period
        s.

    Returns
    -------
    Growth
        So that c‖C‖ of damping keeps the gain of the loop, k/c, within what period and lag bear.
    """
    one = np.ones(1)
    parts = [] if rates is None else [np.abs(x) for x in (rates.position, rates.orientation) if x is not None]
    if rates is None or not parts:
        return Growth((_RATE_UNKNOWN if rates is None else LEAST) * one, one)
    gain = parts[0] if len(parts) == 1 else np.maximum(*parts)
    needed = 0.5 * gain * (period + late)
    growth = np.maximum(LEAST, needed + (0.5 * gain / rates.lag if rates.lag else 0.0))
    return Growth(growth, needed / growth if drives_anywhere(robot) else one)
