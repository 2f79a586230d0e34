"""How singular a Jacobian may be at most. Written by tools/generate_singular_bound.py."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

_DEFINITE = 1e-14


@inline
def singular_bound(jacobian):
    """Return 1/√tr (J Jᵀ)⁻¹ of a J of six rows, a lower bound of its smallest singular value; 0 without full rank.

    J Jᵀ = L D Lᵀ, with 1/D in place of D; the trace is that of L⁻ᵀ D⁻¹ L⁻¹.
    """
    g00 = 0.0
    g10, g11 = 0.0, 0.0
    g20, g21, g22 = 0.0, 0.0, 0.0
    g30, g31, g32, g33 = 0.0, 0.0, 0.0, 0.0
    g40, g41, g42, g43, g44 = 0.0, 0.0, 0.0, 0.0, 0.0
    g50, g51, g52, g53, g54, g55 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(jacobian.shape[1]):
        a0 = jacobian[0, c]
        a1 = jacobian[1, c]
        a2 = jacobian[2, c]
        a3 = jacobian[3, c]
        a4 = jacobian[4, c]
        a5 = jacobian[5, c]
        g00 += a0 * a0
        g10 += a1 * a0
        g11 += a1 * a1
        g20 += a2 * a0
        g21 += a2 * a1
        g22 += a2 * a2
        g30 += a3 * a0
        g31 += a3 * a1
        g32 += a3 * a2
        g33 += a3 * a3
        g40 += a4 * a0
        g41 += a4 * a1
        g42 += a4 * a2
        g43 += a4 * a3
        g44 += a4 * a4
        g50 += a5 * a0
        g51 += a5 * a1
        g52 += a5 * a2
        g53 += a5 * a3
        g54 += a5 * a4
        g55 += a5 * a5
    d0 = g00
    if not d0 > _DEFINITE:
        return 0.0
    d0 = 1.0 / d0
    m10 = g10
    l10 = m10 * d0
    m20 = g20
    l20 = m20 * d0
    m30 = g30
    l30 = m30 * d0
    m40 = g40
    l40 = m40 * d0
    m50 = g50
    l50 = m50 * d0
    d1 = g11 - l10 * m10
    if not d1 > _DEFINITE:
        return 0.0
    d1 = 1.0 / d1
    m21 = g21 - l20 * m10
    l21 = m21 * d1
    m31 = g31 - l30 * m10
    l31 = m31 * d1
    m41 = g41 - l40 * m10
    l41 = m41 * d1
    m51 = g51 - l50 * m10
    l51 = m51 * d1
    d2 = g22 - l20 * m20 - l21 * m21
    if not d2 > _DEFINITE:
        return 0.0
    d2 = 1.0 / d2
    m32 = g32 - l30 * m20 - l31 * m21
    l32 = m32 * d2
    m42 = g42 - l40 * m20 - l41 * m21
    l42 = m42 * d2
    m52 = g52 - l50 * m20 - l51 * m21
    l52 = m52 * d2
    d3 = g33 - l30 * m30 - l31 * m31 - l32 * m32
    if not d3 > _DEFINITE:
        return 0.0
    d3 = 1.0 / d3
    m43 = g43 - l40 * m30 - l41 * m31 - l42 * m32
    l43 = m43 * d3
    m53 = g53 - l50 * m30 - l51 * m31 - l52 * m32
    l53 = m53 * d3
    d4 = g44 - l40 * m40 - l41 * m41 - l42 * m42 - l43 * m43
    if not d4 > _DEFINITE:
        return 0.0
    d4 = 1.0 / d4
    m54 = g54 - l50 * m40 - l51 * m41 - l52 * m42 - l53 * m43
    l54 = m54 * d4
    d5 = g55 - l50 * m50 - l51 * m51 - l52 * m52 - l53 * m53 - l54 * m54
    if not d5 > _DEFINITE:
        return 0.0
    d5 = 1.0 / d5
    total = d0 + d1 + d2 + d3 + d4 + d5
    n10 = -l10
    total += n10 * n10 * d1
    n20 = -l20 - l21 * n10
    total += n20 * n20 * d2
    n30 = -l30 - l31 * n10 - l32 * n20
    total += n30 * n30 * d3
    n40 = -l40 - l41 * n10 - l42 * n20 - l43 * n30
    total += n40 * n40 * d4
    n50 = -l50 - l51 * n10 - l52 * n20 - l53 * n30 - l54 * n40
    total += n50 * n50 * d5
    n21 = -l21
    total += n21 * n21 * d2
    n31 = -l31 - l32 * n21
    total += n31 * n31 * d3
    n41 = -l41 - l42 * n21 - l43 * n31
    total += n41 * n41 * d4
    n51 = -l51 - l52 * n21 - l53 * n31 - l54 * n41
    total += n51 * n51 * d5
    n32 = -l32
    total += n32 * n32 * d3
    n42 = -l42 - l43 * n32
    total += n42 * n42 * d4
    n52 = -l52 - l53 * n32 - l54 * n42
    total += n52 * n52 * d5
    n43 = -l43
    total += n43 * n43 * d4
    n53 = -l53 - l54 * n43
    total += n53 * n53 * d5
    n54 = -l54
    total += n54 * n54 * d5
    return 1.0 / math.sqrt(total)
