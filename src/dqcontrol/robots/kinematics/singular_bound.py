"""Bound on how near a Jacobian is to singular. Written by tools/generate_singular_bound.py."""

from __future__ import annotations

from dqcontrol.compiled.compile import inline

_ROUNDING = 1e-12  # share of tr J Jᵀ that elimination may err by, and more


@inline
def exceeds(jacobian, least):
    """Return True only if all singular values of a J of six rows are greater than ``least``; False near it too.

    They are if J Jᵀ − s² is positive definite: if all pivots of its elimination are positive. Each row is multiplied by
    the pivot where others divide by it, which changes no sign; six divisions one after the other take as long as all.
    """
    g00, g10, g11, g20, g21, g22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(jacobian.shape[1]):
        a0 = jacobian[0, c]
        a1 = jacobian[1, c]
        a2 = jacobian[2, c]
        g00 += a0 * a0
        g10 += a1 * a0
        g11 += a1 * a1
        g20 += a2 * a0
        g21 += a2 * a1
        g22 += a2 * a2
    g30, g31, g32, g40, g41, g42, g50, g51, g52 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(jacobian.shape[1]):
        a0 = jacobian[0, c]
        a1 = jacobian[1, c]
        a2 = jacobian[2, c]
        a3 = jacobian[3, c]
        a4 = jacobian[4, c]
        a5 = jacobian[5, c]
        g30 += a3 * a0
        g31 += a3 * a1
        g32 += a3 * a2
        g40 += a4 * a0
        g41 += a4 * a1
        g42 += a4 * a2
        g50 += a5 * a0
        g51 += a5 * a1
        g52 += a5 * a2
    g33, g43, g44, g53, g54, g55 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(jacobian.shape[1]):
        a3 = jacobian[3, c]
        a4 = jacobian[4, c]
        a5 = jacobian[5, c]
        g33 += a3 * a3
        g43 += a4 * a3
        g44 += a4 * a4
        g53 += a5 * a3
        g54 += a5 * a4
        g55 += a5 * a5
    shift = max(least * least, _ROUNDING * (g00 + g11 + g22 + g33 + g44 + g55))
    g00 -= shift
    g11 -= shift
    g22 -= shift
    g33 -= shift
    g44 -= shift
    g55 -= shift
    if not g00 > 0.0:
        return False
    g11 = g00 * g11 - g10 * g10
    g21 = g00 * g21 - g20 * g10
    g22 = g00 * g22 - g20 * g20
    g31 = g00 * g31 - g30 * g10
    g32 = g00 * g32 - g30 * g20
    g33 = g00 * g33 - g30 * g30
    g41 = g00 * g41 - g40 * g10
    g42 = g00 * g42 - g40 * g20
    g43 = g00 * g43 - g40 * g30
    g44 = g00 * g44 - g40 * g40
    g51 = g00 * g51 - g50 * g10
    g52 = g00 * g52 - g50 * g20
    g53 = g00 * g53 - g50 * g30
    g54 = g00 * g54 - g50 * g40
    g55 = g00 * g55 - g50 * g50
    if not g11 > 0.0:
        return False
    g22 = g11 * g22 - g21 * g21
    g32 = g11 * g32 - g31 * g21
    g33 = g11 * g33 - g31 * g31
    g42 = g11 * g42 - g41 * g21
    g43 = g11 * g43 - g41 * g31
    g44 = g11 * g44 - g41 * g41
    g52 = g11 * g52 - g51 * g21
    g53 = g11 * g53 - g51 * g31
    g54 = g11 * g54 - g51 * g41
    g55 = g11 * g55 - g51 * g51
    if not g22 > 0.0:
        return False
    g33 = g22 * g33 - g32 * g32
    g43 = g22 * g43 - g42 * g32
    g44 = g22 * g44 - g42 * g42
    g53 = g22 * g53 - g52 * g32
    g54 = g22 * g54 - g52 * g42
    g55 = g22 * g55 - g52 * g52
    if not g33 > 0.0:
        return False
    g44 = g33 * g44 - g43 * g43
    g54 = g33 * g54 - g53 * g43
    g55 = g33 * g55 - g53 * g53
    if not g44 > 0.0:
        return False
    g55 = g44 * g55 - g54 * g54
    return g55 > 0.0
