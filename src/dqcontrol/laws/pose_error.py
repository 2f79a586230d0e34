"""The left-invariant pose error 1 − x*x_d and its Jacobian N, shared by the laws that use them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.algebra.kernels import conjugate_multiply, rotate
from dqcontrol.compile import NOT_FINITE, OK, inlined
from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.laws.gains import Schedule, gain_matrix_rows
from dqcontrol.laws.inverses import FILTERED, HEAD, FilteredInverse, Inverse, solve, solve_regular, work_size
from dqcontrol.laws.law import Law
from dqcontrol.robots.serial_arm import SerialArm

if TYPE_CHECKING:
    from dqcontrol.references import Reference

HYSTERESIS = HEAD
GAIN = HEAD + 1  # parameters: inverse (3), hysteresis, gains (8)


class LeftErrorLaw(Law, frozen=True, kw_only=True):
    """A law that feeds back the left-invariant error 1 − x*x_d through N⁺."""

    gain: Annotated[float | list[float] | Schedule, Meta(description="K in 1/s: k, its diagonal (8), or k over time")]
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[
        float, Meta(ge=0, lt=1, description="how far Re(x_e) must pass 0 before the sign of x_d flips")
    ] = 0.2

    def parameter_rows(self, robot: SerialArm, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis and gain diagonal at each time."""
        delta = float(as_array("hysteresis", self.hysteresis, ()))
        if not 0 <= delta < 1:
            raise ValueRangeError(f"hysteresis: must be in [0, 1), got {delta:g}")
        gains = gain_matrix_rows("gain", self.gain, 8, times)
        head = np.array([*self.inverse.parameters(), delta])
        return np.hstack([np.tile(head, (len(gains), 1)), gains])

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the gain schedule, s."""
        return self.gain.end if isinstance(self.gain, Schedule) else 0.0

    def work_size(self, robot: SerialArm) -> int:
        """Return room for error, target, scratch, N and the solver's own."""
        return 32 + 8 * robot.input_size + work_size()


@inlined
def short_sign(real_part, hysteresis, state):
    """Return the sign that takes the short way round, with hysteresis; state[0] remembers it, 0 at the start."""
    if state[0] == 0.0:
        state[0] = 1.0 if real_part >= 0.0 else -1.0
    elif state[0] * real_part < -hysteresis:
        state[0] = -state[0]
    return state[0]


@inlined
def left_error(pose, desired, hysteresis, state, error):
    """Write e = 1 − short(x*x_d) and return the sign given to x_d. [P16 2.23]"""
    conjugate_multiply(pose, desired, error)
    sign = short_sign(error[0], hysteresis, state)
    for i in range(8):
        error[i] = -sign * error[i]
    error[0] += 1.0
    return sign


@inlined
def error_jacobian(pose_jacobian, desired, sign, out):
    """Write N = H⁻(x_d) C8 J (8 × n), so that ė = −N q̇ for a constant x_d. [P16 3.7, S17 4.46]"""
    n = pose_jacobian.shape[1]
    w, x, y, z = sign * desired[0], sign * desired[1], sign * desired[2], sign * desired[3]
    dw, dx, dy, dz = sign * desired[4], sign * desired[5], sign * desired[6], sign * desired[7]
    for i in range(n):
        a, b, c, d = pose_jacobian[0, i], -pose_jacobian[1, i], -pose_jacobian[2, i], -pose_jacobian[3, i]
        e, f, g, h = pose_jacobian[4, i], -pose_jacobian[5, i], -pose_jacobian[6, i], -pose_jacobian[7, i]
        out[0, i] = a * w - b * x - c * y - d * z
        out[1, i] = a * x + b * w + c * z - d * y
        out[2, i] = a * y - b * z + c * w + d * x
        out[3, i] = a * z + b * y - c * x + d * w
        out[4, i] = a * dw - b * dx - c * dy - d * dz + e * w - f * x - g * y - h * z
        out[5, i] = a * dx + b * dw + c * dz - d * dy + e * x + f * w + g * z - h * y
        out[6, i] = a * dy - b * dz + c * dw + d * dx + e * y - f * z + g * w + h * x
        out[7, i] = a * dz + b * dy - c * dx + d * dw + e * z + f * y - g * x + h * w


@inlined
def _regular_hand_twist(target, error, pose, out):
    """Write the hand twist [ω ; ṗ] that solves N u = target in the least squares sense; return |D|² of x_e.

    N u = −½ξ_b x_e with x_e = P + εD and ξ_b the body twist. With a = −2 t_P P*, b = −2 t_D P*, d = D P* this is
    ω_b ≈ Im a, ω_b·d ≈ −Re b, v_b = Im b − ω_b × d: one rank-one correction.
    """
    pw, px, py, pz = 1.0 - error[0], error[1], error[2], error[3]  # P*
    tw, tx, ty, tz = -2.0 * target[0], -2.0 * target[1], -2.0 * target[2], -2.0 * target[3]
    ax = tw * px + tx * pw + ty * pz - tz * py
    ay = tw * py - tx * pz + ty * pw + tz * px
    az = tw * pz + tx * py - ty * px + tz * pw
    tw, tx, ty, tz = -2.0 * target[4], -2.0 * target[5], -2.0 * target[6], -2.0 * target[7]
    bw = tw * pw - tx * px - ty * py - tz * pz
    bx = tw * px + tx * pw + ty * pz - tz * py
    by = tw * py - tx * pz + ty * pw + tz * px
    bz = tw * pz + tx * py - ty * px + tz * pw
    tw, tx, ty, tz = -error[4], -error[5], -error[6], -error[7]
    dx = tw * px + tx * pw + ty * pz - tz * py
    dy = tw * py - tx * pz + ty * pw + tz * px
    dz = tw * pz + tx * py - ty * px + tz * pw
    square = dx * dx + dy * dy + dz * dz
    correction = (ax * dx + ay * dy + az * dz + bw) / (1.0 + square)
    ax, ay, az = ax - correction * dx, ay - correction * dy, az - correction * dz
    bx -= ay * dz - az * dy
    by -= az * dx - ax * dz
    bz -= ax * dy - ay * dx
    rotate(pose, (ax, ay, az), out[0:3])
    rotate(pose, (bx, by, bz), out[3:6])
    return square


@inlined
def solve_left_error(target, error, pose, pose_jacobian, twist_jacobian, desired, sign, inverse, work, out):
    """Write out = N⁺ target."""
    n = pose_jacobian.shape[1]
    rest = work[32:]
    if inverse[0] == FILTERED:
        hand_twist = work[16:22]
        square = _regular_hand_twist(target, error, pose, hand_twist)
        # σmin(N) ≥ ½ s σmin(J_h), s the smaller singular value of [[1, 0], [|D|, 1]]
        smallest = 0.25 * (math.sqrt(square + 4.0) - math.sqrt(square))
        if solve_regular(pose, twist_jacobian, hand_twist, inverse[1] / smallest, out):
            return _finite(out)
    matrix = rest[0 : 8 * n].reshape(8, n)
    error_jacobian(pose_jacobian, desired, sign, matrix)
    status = solve(matrix, 8, n, target, inverse, rest[8 * n :], out)
    return _finite(out) if status == OK else status


@inlined
def _finite(command):
    """Return the status of a command, which may have overflowed."""
    check = 0.0
    for i in range(command.shape[0]):
        check += 0.0 * command[i]
    return OK if check == 0.0 else NOT_FINITE
