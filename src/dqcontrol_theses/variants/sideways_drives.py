"""Differential drives taken as if they could move sideways, and what they do instead. [S17 4.4–4.5, 4.21–4.26]

A constrained Jacobian has the columns v and ω of each drive. Here a column is added behind the last for each of them:
sideways speed s. (v, s) are (ẋ, ẏ) in axes that turn with the base, so least squares solutions are those of S17's
holonomic Jacobian. What a drive does of them is v and ω + s/d: its displaced point, d ahead of the axle, moves as
asked.
"""

from __future__ import annotations

import math

from dqcontrol.compiled import inline


@inline
def twist_jacobian_with_sideways(drives, twist_jacobian, out):
    """Write the twist Jacobian, 6 × (m + k): each sideways column is [0 ; axis of turning × heading]."""
    m = twist_jacobian.shape[1]
    for row in range(6):
        for i in range(m):
            out[row, i] = twist_jacobian[row, i]
    for k in range(drives.shape[0]):
        j = int(drives[k, 0])
        hx, hy, hz = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
        ax, ay, az = twist_jacobian[0, j + 1], twist_jacobian[1, j + 1], twist_jacobian[2, j + 1]
        out[0, m + k], out[1, m + k], out[2, m + k] = 0.0, 0.0, 0.0
        out[3, m + k] = ay * hz - az * hy
        out[4, m + k] = az * hx - ax * hz
        out[5, m + k] = ax * hy - ay * hx


@inline
def feasible_inputs(drives, rates, out):
    """Write the m inputs that follow m + k rates as far as the drives can."""
    m = out.shape[0]
    for i in range(m):
        out[i] = rates[i]
    for k in range(drives.shape[0]):
        out[int(drives[k, 0]) + 1] += rates[m + k] / drives[k, 1]


@inline
def turn_rates(drives, inputs, period, rates):
    """Turn (v, s) of each drive into the axes that it has a period later, so that ẋ and ẏ stay what they were."""
    m = inputs.shape[0]
    for k in range(drives.shape[0]):
        j = int(drives[k, 0])
        angle = period * inputs[j + 1]
        c, s = math.cos(angle), math.sin(angle)
        rates[j], rates[m + k] = c * rates[j] + s * rates[m + k], c * rates[m + k] - s * rates[j]
