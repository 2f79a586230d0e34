"""The twist that moves a unit dual quaternion nearest to a wanted rate: closed form of a least squares problem."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline


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
