"""The smallest inputs that give the end effector a twist. Written by tools/generate_least_norm.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline
from dqcontrol.laws.growth import curvature, square_bound


@inline
def least_norm(
    twist_jacobian,
    px,
    py,
    pz,
    y,
    z,
    error,
    growth,
    square_length,
    linear_limit,
    vanishing,
    linear_damping,
    out,
):
    """Write u = z + J_hᵀ G⁻¹ (y − J_h z), G = J_h J_hᵀ + W, and return True; return False where tr L G⁻¹ > 1.

    J_h is the Jacobian of [ω ; ṗ]: the twist Jacobian moved from the inertial origin to the end effector's position p.
    W and L are diagonal, one number for ṗ, and for ω that by ℓ². The trace bounds from above what L⁻¹ᐟ² J_h has as
    1/σ²min; G = F D Fᵀ, with 1/D in place of D. With L, G is factored once more where the curvature of the error asks
    for damping, also where tr L G⁻¹ > 1 if that is more than the damping of vanishing singular values.
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
    added = 0.0
    while True:
        angular_added = added / square_length
        pivot = g00 + angular_added
        if not pivot > 1e-14:
            return False
        f00 = 1.0 / pivot
        f10 = g10
        f20 = g20
        f30 = g30
        f40 = g40
        f50 = g50
        c0 = f10
        f10 = c0 * f00
        pivot = g11 + angular_added - c0 * f10
        if not pivot > 1e-14:
            return False
        f11 = 1.0 / pivot
        f21 = g21 - f20 * f10
        f31 = g31 - f30 * f10
        f41 = g41 - f40 * f10
        f51 = g51 - f50 * f10
        c0 = f20
        c1 = f21
        f20 = c0 * f00
        f21 = c1 * f11
        pivot = g22 + angular_added - c0 * f20 - c1 * f21
        if not pivot > 1e-14:
            return False
        f22 = 1.0 / pivot
        f32 = g32 - f30 * f20 - f31 * f21
        f42 = g42 - f40 * f20 - f41 * f21
        f52 = g52 - f50 * f20 - f51 * f21
        c0 = f30
        c1 = f31
        c2 = f32
        f30 = c0 * f00
        f31 = c1 * f11
        f32 = c2 * f22
        pivot = g33 + added - c0 * f30 - c1 * f31 - c2 * f32
        if not pivot > 1e-14:
            return False
        f33 = 1.0 / pivot
        f43 = g43 - f40 * f30 - f41 * f31 - f42 * f32
        f53 = g53 - f50 * f30 - f51 * f31 - f52 * f32
        c0 = f40
        c1 = f41
        c2 = f42
        c3 = f43
        f40 = c0 * f00
        f41 = c1 * f11
        f42 = c2 * f22
        f43 = c3 * f33
        pivot = g44 + added - c0 * f40 - c1 * f41 - c2 * f42 - c3 * f43
        if not pivot > 1e-14:
            return False
        f44 = 1.0 / pivot
        f54 = g54 - f50 * f40 - f51 * f41 - f52 * f42 - f53 * f43
        c0 = f50
        c1 = f51
        c2 = f52
        c3 = f53
        c4 = f54
        f50 = c0 * f00
        f51 = c1 * f11
        f52 = c2 * f22
        f53 = c3 * f33
        f54 = c4 * f44
        pivot = g55 + added - c0 * f50 - c1 * f51 - c2 * f52 - c3 * f53 - c4 * f54
        if not pivot > 1e-14:
            return False
        f55 = 1.0 / pivot
        if added > 0.0 or linear_limit == 0.0:
            break
        angular = f00 + f11 + f22
        linear = f33 + f44 + f55
        h10 = -f10
        h20 = -f20 - f21 * h10
        h30 = -f30 - f31 * h10 - f32 * h20
        h40 = -f40 - f41 * h10 - f42 * h20 - f43 * h30
        h50 = -f50 - f51 * h10 - f52 * h20 - f53 * h30 - f54 * h40
        angular += h10 * h10 * f11 + h20 * h20 * f22 + h30 * h30 * f33 + h40 * h40 * f44 + h50 * h50 * f55
        h21 = -f21
        h31 = -f31 - f32 * h21
        h41 = -f41 - f42 * h21 - f43 * h31
        h51 = -f51 - f52 * h21 - f53 * h31 - f54 * h41
        angular += h21 * h21 * f22 + h31 * h31 * f33 + h41 * h41 * f44 + h51 * h51 * f55
        h32 = -f32
        h42 = -f42 - f43 * h32
        h52 = -f52 - f53 * h32 - f54 * h42
        angular += h32 * h32 * f33 + h42 * h42 * f44 + h52 * h52 * f55
        h43 = -f43
        h53 = -f53 - f54 * h43
        linear += h43 * h43 * f44 + h53 * h53 * f55
        h54 = -f54
        linear += h54 * h54 * f55
        regular = angular * angular_limit + linear * linear_limit <= 1.0
        trace = growth * (angular / square_length + linear)
        turning = g00 + g11 + g22
        columns = square_length * turning + g33 + g44 + g55
        if square_bound(error, square_length, turning, columns) * trace * trace > 1.0:
            added = growth * (curvature(twist_jacobian, px, py, pz, error, square_length) - 1.0 / trace)
        if not regular and not added >= vanishing:
            return False
        if not added > 0.0:
            break
    y1 = y1 - f10 * y0
    y2 = y2 - f20 * y0 - f21 * y1
    y3 = y3 - f30 * y0 - f31 * y1 - f32 * y2
    y4 = y4 - f40 * y0 - f41 * y1 - f42 * y2 - f43 * y3
    y5 = y5 - f50 * y0 - f51 * y1 - f52 * y2 - f53 * y3 - f54 * y4
    y5 = y5 * f55
    y4 = y4 * f44 - f54 * y5
    y3 = y3 * f33 - f43 * y4 - f53 * y5
    y2 = y2 * f22 - f32 * y3 - f42 * y4 - f52 * y5
    y1 = y1 * f11 - f21 * y2 - f31 * y3 - f41 * y4 - f51 * y5
    y0 = y0 * f00 - f10 * y1 - f20 * y2 - f30 * y3 - f40 * y4 - f50 * y5
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
    return True
