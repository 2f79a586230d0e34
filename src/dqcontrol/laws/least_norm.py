"""The smallest inputs that give the hand a twist. Written by tools/generate_least_norm.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import curvature, square_bound


@inline
def least_norm(
    twist_jacobian, px, py, pz, y, z, error, growth, square_length, linear_limit, linear_damping, out
):
    """Write u = z + J_hᵀ G⁻¹ (y − J_h z), G = J_h J_hᵀ + W, and return 0; −1 where tr L G⁻¹ > 1: then u is not written.

    Where the error's curvature asks for damping, that is returned, and u is not written either.

    J_h is the Jacobian of [ω ; ṗ]: the twist Jacobian moved from the inertial origin to the hand's position p. W and L
    are diagonal, one number for ṗ, and for ω that by ℓ². The trace bounds from above what L⁻¹ᐟ² J_h has as 1/σ²min;
    G = L D Lᵀ, with 1/D in place of D.
    """
    n = twist_jacobian.shape[1]
    angular_limit, angular_damping = linear_limit / square_length, linear_damping / square_length
    g00 = angular_damping
    g10 = 0.0
    g11 = angular_damping
    g20 = 0.0
    g21 = 0.0
    g22 = angular_damping
    g30 = 0.0
    g31 = 0.0
    g32 = 0.0
    g33 = linear_damping
    g40 = 0.0
    g41 = 0.0
    g42 = 0.0
    g43 = 0.0
    g44 = linear_damping
    g50 = 0.0
    g51 = 0.0
    g52 = 0.0
    g53 = 0.0
    g54 = 0.0
    g55 = linear_damping
    y0, y1, y2, y3, y4, y5 = y[0], y[1], y[2], y[3], y[4], y[5]
    for c in range(n):
        a0, a1, a2 = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        a3 = twist_jacobian[3, c] - py * a2 + pz * a1
        a4 = twist_jacobian[4, c] - pz * a0 + px * a2
        a5 = twist_jacobian[5, c] - px * a1 + py * a0
        y0 -= z[c] * a0
        g00 += a0 * a0
        y1 -= z[c] * a1
        g10 += a1 * a0
        g11 += a1 * a1
        y2 -= z[c] * a2
        g20 += a2 * a0
        g21 += a2 * a1
        g22 += a2 * a2
        y3 -= z[c] * a3
        g30 += a3 * a0
        g31 += a3 * a1
        g32 += a3 * a2
        g33 += a3 * a3
        y4 -= z[c] * a4
        g40 += a4 * a0
        g41 += a4 * a1
        g42 += a4 * a2
        g43 += a4 * a3
        g44 += a4 * a4
        y5 -= z[c] * a5
        g50 += a5 * a0
        g51 += a5 * a1
        g52 += a5 * a2
        g53 += a5 * a3
        g54 += a5 * a4
        g55 += a5 * a5
    turning = g00 + g11 + g22
    moving = g33 + g44 + g55
    pivot = g00
    if not pivot > 1e-14:
        return -1.0
    g00 = 1.0 / pivot
    c0 = g10
    g10 = c0 * g00
    pivot = g11 - c0 * g10
    if not pivot > 1e-14:
        return -1.0
    g11 = 1.0 / pivot
    g21 = g21 - g20 * g10
    g31 = g31 - g30 * g10
    g41 = g41 - g40 * g10
    g51 = g51 - g50 * g10
    c0 = g20
    c1 = g21
    g20 = c0 * g00
    g21 = c1 * g11
    pivot = g22 - c0 * g20 - c1 * g21
    if not pivot > 1e-14:
        return -1.0
    g22 = 1.0 / pivot
    g32 = g32 - g30 * g20 - g31 * g21
    g42 = g42 - g40 * g20 - g41 * g21
    g52 = g52 - g50 * g20 - g51 * g21
    c0 = g30
    c1 = g31
    c2 = g32
    g30 = c0 * g00
    g31 = c1 * g11
    g32 = c2 * g22
    pivot = g33 - c0 * g30 - c1 * g31 - c2 * g32
    if not pivot > 1e-14:
        return -1.0
    g33 = 1.0 / pivot
    g43 = g43 - g40 * g30 - g41 * g31 - g42 * g32
    g53 = g53 - g50 * g30 - g51 * g31 - g52 * g32
    c0 = g40
    c1 = g41
    c2 = g42
    c3 = g43
    g40 = c0 * g00
    g41 = c1 * g11
    g42 = c2 * g22
    g43 = c3 * g33
    pivot = g44 - c0 * g40 - c1 * g41 - c2 * g42 - c3 * g43
    if not pivot > 1e-14:
        return -1.0
    g44 = 1.0 / pivot
    g54 = g54 - g50 * g40 - g51 * g41 - g52 * g42 - g53 * g43
    c0 = g50
    c1 = g51
    c2 = g52
    c3 = g53
    c4 = g54
    g50 = c0 * g00
    g51 = c1 * g11
    g52 = c2 * g22
    g53 = c3 * g33
    g54 = c4 * g44
    pivot = g55 - c0 * g50 - c1 * g51 - c2 * g52 - c3 * g53 - c4 * g54
    if not pivot > 1e-14:
        return -1.0
    g55 = 1.0 / pivot
    if linear_limit > 0.0:
        angular = g00 + g11 + g22
        linear = g33 + g44 + g55
        h10 = -g10
        h20 = -g20 - g21 * h10
        h30 = -g30 - g31 * h10 - g32 * h20
        h40 = -g40 - g41 * h10 - g42 * h20 - g43 * h30
        h50 = -g50 - g51 * h10 - g52 * h20 - g53 * h30 - g54 * h40
        angular += h10 * h10 * g11 + h20 * h20 * g22 + h30 * h30 * g33 + h40 * h40 * g44 + h50 * h50 * g55
        h21 = -g21
        h31 = -g31 - g32 * h21
        h41 = -g41 - g42 * h21 - g43 * h31
        h51 = -g51 - g52 * h21 - g53 * h31 - g54 * h41
        angular += h21 * h21 * g22 + h31 * h31 * g33 + h41 * h41 * g44 + h51 * h51 * g55
        h32 = -g32
        h42 = -g42 - g43 * h32
        h52 = -g52 - g53 * h32 - g54 * h42
        angular += h32 * h32 * g33 + h42 * h42 * g44 + h52 * h52 * g55
        h43 = -g43
        h53 = -g53 - g54 * h43
        linear += h43 * h43 * g44 + h53 * h53 * g55
        h54 = -g54
        linear += h54 * h54 * g55
        if not angular * angular_limit + linear * linear_limit <= 1.0:
            return -1.0
        trace = growth * (angular / square_length + linear)
        if square_bound(error, square_length, turning, moving) * trace * trace > 1.0:
            missing = growth * (curvature(twist_jacobian, px, py, pz, error, square_length) - 1.0 / trace)
            if missing > 0.0:
                return missing
    y1 = y1 - g10 * y0
    y2 = y2 - g20 * y0 - g21 * y1
    y3 = y3 - g30 * y0 - g31 * y1 - g32 * y2
    y4 = y4 - g40 * y0 - g41 * y1 - g42 * y2 - g43 * y3
    y5 = y5 - g50 * y0 - g51 * y1 - g52 * y2 - g53 * y3 - g54 * y4
    y5 = y5 * g55
    y4 = y4 * g44 - g54 * y5
    y3 = y3 * g33 - g43 * y4 - g53 * y5
    y2 = y2 * g22 - g32 * y3 - g42 * y4 - g52 * y5
    y1 = y1 * g11 - g21 * y2 - g31 * y3 - g41 * y4 - g51 * y5
    y0 = y0 * g00 - g10 * y1 - g20 * y2 - g30 * y3 - g40 * y4 - g50 * y5
    y0 += py * y5 - pz * y4
    y1 += pz * y3 - px * y5
    y2 += px * y4 - py * y3
    for c in range(n):
        out[c] = (
            z[c]
            + twist_jacobian[0, c] * y0
            + twist_jacobian[1, c] * y1
            + twist_jacobian[2, c] * y2
            + twist_jacobian[3, c] * y3
            + twist_jacobian[4, c] * y4
            + twist_jacobian[5, c] * y5
        )
    return 0.0
