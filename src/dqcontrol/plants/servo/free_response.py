"""Free response of second order to a displacement and a speed."""

from __future__ import annotations

import math

from dqcontrol.compiled.compile import inline


@inline
def free_response(h, bandwidth, damping):
    """Return φ₁ and φ₂ of y(h) = φ₁ y + φ₂ y' for y'' + 2ζω y' + ω² y = 0; y'(h) = −ω² φ₂ y + (φ₁ − 2ζω φ₂) y'."""
    if damping < 1.0:
        rate = bandwidth * math.sqrt(1.0 - damping * damping)
        decay = math.exp(-damping * bandwidth * h)
        along = math.sin(rate * h) / rate if rate * h > 1e-9 else h
        second = decay * along
        first = decay * math.cos(rate * h) + damping * bandwidth * second
        return first, second
    rate = bandwidth * math.sqrt(damping * damping - 1.0)
    if rate * h < 1e-6:
        second = math.exp(-damping * bandwidth * h) * h
        return math.exp(-damping * bandwidth * h) + damping * bandwidth * second, second
    slow = math.exp(-(damping * bandwidth - rate) * h)
    fast = math.exp(-(damping * bandwidth + rate) * h)
    second = (slow - fast) / (2.0 * rate)
    return 0.5 * (slow + fast) + damping * bandwidth * second, second
