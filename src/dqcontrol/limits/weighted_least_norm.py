"""Weighted least norm: joints near their limits cost more. [Chan and Dubey 1995]"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.compiled.compile import kernel
from dqcontrol.compiled.law_signature import call_law
from dqcontrol.limits.gradient import repulsion
from dqcontrol.limits.position_limit import (
    POSITION_LIMIT,
    PositionLimit,
    position_limits,
)

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


@kernel(POSITION_LIMIT)
def weighted_least_norm(
    law,
    q,
    pose,
    pose_jacobian,
    twist_jacobian,
    sample,
    law_parameters,
    state,
    law_work,
    parameters,
    work,
    out,
):
    """Ask the law with J W^(−1/2) and W^(1/2) z, and write W^(−1/2) times its answer."""
    n = out.shape[0]
    lower, upper, moved = parameters[0:n], parameters[n : 2 * n], parameters[2 * n : 3 * n]
    scale = work[0:n]
    law_size = state.shape[0] - n
    last = state[law_size:]
    for i in range(n):
        angle = q[int(moved[i])]
        offset = abs(2.0 * angle - lower[i] - upper[i])  # grows with |∂H|, and on beyond the limits
        if offset < last[i]:
            scale[i] = 1.0
        else:
            scale[i] = 1.0 / math.sqrt(1.0 + abs(repulsion(angle, lower[i], upper[i])))
        last[i] = offset
        for k in range(6):
            twist_jacobian[k, i] *= scale[i]
        law_work[i] /= scale[i]
    status = call_law(
        law, q, pose, pose_jacobian, twist_jacobian, sample, law_parameters, state[0:law_size], law_work, out
    )
    for i in range(n):
        out[i] *= scale[i]
    return status


class WeightedLeastNorm(PositionLimit, frozen=True, kw_only=True, tag="weighted-least-norm"):
    """Make joints dear that move towards their limits: q̇ = W⁻¹Jᵀ(J W⁻¹Jᵀ)⁻¹ y. [Chan and Dubey 1995]

    wᵢ = 1 + |∂H/∂qᵢ| if |∂H/∂qᵢ| did not decrease since the last sample, else 1, with H = Σ R²/(4 (qmax − q)(q − qmin))
    and R = qmax − qmin; nearer to a limit than 10⁻⁵ R, and beyond it, w is what it is there. The law's inverse acts on
    J W^(−1/2), its thresholds too.

    Where the arm has joints to spare, motion is shared among those that are far from their limits. In samples nothing
    is guaranteed: a joint that alone can do the task is slowed only by the inverse's damping, and one that has just
    turned back is free for one sample, in which it may cross its limit. Joints without both limits are passed over.
    """

    kernel = weighted_least_norm

    def parameters(self, robot: Robot, dt: float) -> np.ndarray:
        """Return the limits."""
        return position_limits("limits.position", robot)

    def memory(self, robot: Robot) -> int:
        """Return one number an input: how far its joint it was from the middle of its range."""
        return robot.input_size
