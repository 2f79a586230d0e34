"""The gradient by which joint limits repel: of H = Σ R²/(4 (qmax − q)(q − qmin)), R = qmax − qmin."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline

# The gradient grows without bound towards a limit; nearer than this share of R, and beyond, it is what it is there.
NEAREST = 1e-5


@inline
def repulsion(q, lower, upper):
    """Return ∂H/∂qᵢ = R² (2q − qmax − qmin)/(4 (qmax − q)² (q − qmin)²), 1/rad; 0 without both limits."""
    span = upper - lower
    if span == math.inf:
        return 0.0
    above, below = max(upper - q, NEAREST * span), max(q - lower, NEAREST * span)
    return span * span * (below - above) / (4.0 * above * above * below * below)
