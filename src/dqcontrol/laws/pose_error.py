"""Pose errors of laws: the sign, the left one and the twist that N⁺ makes of it, the right one's lever."""

from __future__ import annotations

import math

from dqcontrol.algebra.dual_quaternion_kernels import conjugate_multiply, position, rotated
from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import pose_error
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_at_end_effector
from dqcontrol.laws.inverses import inverse_parameters


@inline
def nearest_twist(rate, x):
    """Return ω and v of the twist ξ = ω + εv that minimises |vec8(½ξx − rate)|, and d = D P* of x = P + εD.

    With a = 2 rate_P P*, b = 2 rate_D P* (right products with P* keep norms): ω ≈ Im a, −ω·d ≈ Re b,
    v = Im b − ω × d, which is one rank-one correction of ω.
    """
    pw, px, py, pz = x[0], -x[1], -x[2], -x[3]
    tw, tx, ty, tz = 2.0 * rate[0], 2.0 * rate[1], 2.0 * rate[2], 2.0 * rate[3]
    ax = tw * px + tx * pw + ty * pz - tz * py
    ay = tw * py - tx * pz + ty * pw + tz * px
    az = tw * pz + tx * py - ty * px + tz * pw
    tw, tx, ty, tz = 2.0 * rate[4], 2.0 * rate[5], 2.0 * rate[6], 2.0 * rate[7]
    bw = tw * pw - tx * px - ty * py - tz * pz
    bx = tw * px + tx * pw + ty * pz - tz * py
    by = tw * py - tx * pz + ty * pw + tz * px
    bz = tw * pz + tx * py - ty * px + tz * pw
    tw, tx, ty, tz = x[4], x[5], x[6], x[7]
    dx = tw * px + tx * pw + ty * pz - tz * py
    dy = tw * py - tx * pz + ty * pw + tz * px
    dz = tw * pz + tx * py - ty * px + tz * pw
    square = dx * dx + dy * dy + dz * dz
    correction = (ax * dx + ay * dy + az * dz + bw) / (1.0 + square)
    ax, ay, az = ax - correction * dx, ay - correction * dy, az - correction * dz
    bx, by, bz = bx - (ay * dz - az * dy), by - (az * dx - ax * dz), bz - (ax * dy - ay * dx)
    return (ax, ay, az), (bx, by, bz), (dx, dy, dz)


@inline
def hand_twist_of_rate(rate, pose):
    """Return the end effector's twist [ω ; ṗ] that moves its pose nearest to a wanted rate."""
    (ax, ay, az), (bx, by, bz), (dx, dy, dz) = nearest_twist(rate, pose)
    px, py, pz = 2.0 * dx, 2.0 * dy, 2.0 * dz
    return ax, ay, az, bx + ay * pz - az * py, by + az * px - ax * pz, bz + ax * py - ay * px  # ṗ = v + ω × p


LEVER_CURVES = 2.0  # of right errors: the turning lever changes with q as much again as C says
# ℓ: so long only half a metre away and turned by far; `python benchmarks/out_of_reach.py`
_LONGEST_LEVER = 3.0

_LEFT_LEVER = 0.33  # ℓ, of left errors, whose x and y a base would drive after: longer, whole bodies circle


@inline
def short_sign(real_part, hysteresis, sign):
    """Return the sign that takes the short way round, with hysteresis; ``sign`` (1) keeps it, 0 at the start."""
    if sign[0] == 0.0:
        sign[0] = 1.0 if real_part >= 0.0 else -1.0
    elif sign[0] * real_part < -hysteresis:
        sign[0] = -sign[0]
    return sign[0]


@inline
def shorten_lever(error, pose, desired, inverse_numbers):
    """Bound the lever arm in a right error y = [θ ; p_e], p_e + θ × p − (p − p_d) ≈ θ × (p_d − p), if damping grows.

    Where neither vanishes, the end effector would circle for ever at the speed that its joints have, whatever the
    damping.
    """
    inverse = inverse_parameters(inverse_numbers)
    if inverse.growth == 0.0:
        return
    px, py, pz = position(pose)
    dx, dy, dz = position(desired)
    _, _, _, x, y, z = twist_at_end_effector(error, pose)
    x, y, z = x - px + dx, y - py + dy, z - pz + dz
    lever, longest = math.sqrt(x * x + y * y + z * z), _LONGEST_LEVER * inverse.length
    if lever > longest:
        beyond = 1.0 - longest / lever
        error[3] -= beyond * x
        error[4] -= beyond * y
        error[5] -= beyond * z


@inline
def left_error(pose, desired, hysteresis, sign, error):
    """Write e = 1 − short(x*x_d) and return the sign given to x_d. [P16 2.23]"""
    conjugate_multiply(pose, desired, error)
    given = short_sign(error[0], hysteresis, sign)
    for i in range(8):
        error[i] = -given * error[i]
    error[0] += 1.0
    return given


@inline
def _with_short_lever(angular, linear, away, length):
    """Return the velocity b − ω × d with ω × d no larger than that of ℓ at the rate |b|/|d|."""
    a, b, c = angular
    u, v, w = linear
    x, y, z = away
    i, j, k = b * z - c * y, c * x - a * z, a * y - b * x
    lever = (i * i + j * j + k * k) * (x * x + y * y + z * z)
    asked = length * length * ((u + i) * (u + i) + (v + j) * (v + j) + (w + k) * (w + k))
    if lever > asked:
        beyond = 1.0 - math.sqrt(asked / lever)
        u, v, w = u + beyond * i, v + beyond * j, w + beyond * k
    return u, v, w


@inline
def left_error_twist(target, error, pose, inverse_numbers):
    """Return the [ω ; ṗ] that comes nearest to N u = target, N u = −½ξ_b x_e, x_e = 1 − e; inertial axes.

    Its velocity is k d − ω × d, d = p_d − p, ω ≈ ½kθ: if damping grows, the lever ω × d is bounded as in right errors.
    """
    e = error
    relative = 1.0 - e[0], -e[1], -e[2], -e[3], -e[4], -e[5], -e[6], -e[7]
    angular, linear, away = nearest_twist(target, relative)
    inverse = inverse_parameters(inverse_numbers)
    if inverse.growth != 0.0:
        linear = _with_short_lever(angular, linear, away, _LEFT_LEVER * inverse.length)
    ax, ay, az = rotated(pose, angular)
    bx, by, bz = rotated(pose, linear)
    return -ax, -ay, -az, -bx, -by, -bz


@inline
def solve_left_error(target, error, pose, twist_jacobian, sample, preferred, inverse, work, out):
    """Write out = z + N⁺ (target − N z) with the preferred motion z."""
    twist = left_error_twist(target, error, pose, inverse)
    missing = pose_error(pose, sample)
    return solve_hand_twist(pose, twist_jacobian, twist, missing, preferred, inverse, work, out)
