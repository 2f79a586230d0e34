"""Weighted least norm: joints near their limits cost more. [Chan and Dubey 1995]"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, kernel
from dqcontrol.compiled.law_signature import call_law
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.limits.gradient import repulsion
from dqcontrol.limits.position_limit import (
    POSITION_LIMIT,
    PositionLimit,
    input_ranges,
    position_limits,
)

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

_LEAST_WEIGHT = 1.0 + 1e-12  # of a joint that is weighed; its scale is below 1


class WeightingWork(NamedTuple):
    """Scratch: the weights as scales of inputs, and the law's state before it was asked."""

    scale: Annotated[Array, "m"]
    state_before: Annotated[Array, "state"]


weighting_work: MemoryLayout[WeightingWork] = MemoryLayout(WeightingWork, "m", "state")


@kernel(POSITION_LIMIT)
def weighted_least_norm(
    law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, parameters, work, out
):
    """Ask the law with J W^(−1/2) and W^(−1/2) z, w = 1 + |∂H| of joints that it drives towards a limit, else 1."""
    n = out.shape[0]
    given, own = input_ranges(parameters, n), weighting_work(work, n, state.shape[0])
    lower, upper, coordinate = given.lower, given.upper, given.coordinate
    scale, state_before = own.scale, own.state_before
    for i in range(n):
        scale[i] = 1.0
    for i in range(state.shape[0]):
        state_before[i] = state[i]
    again = True
    while again:  # weighs a joint more each time
        status = call_law(
            law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, out
        )
        if status != OK:
            return status
        again = False
        for i in range(n):
            out[i] *= scale[i]
            slope = repulsion(q[int(coordinate[i])], lower[i], upper[i])
            weight = 1.0 + abs(slope)
            # A joint in the middle of its range, up to rounding, weighs 1: weighed once more it would be so for ever.
            if scale[i] == 1.0 and weight > _LEAST_WEIGHT and slope * out[i] > 0.0:
                scale[i] = 1.0 / math.sqrt(weight)
                for k in range(6):
                    twist_jacobian[k, i] *= scale[i]
                law_work[i] *= scale[i]
                again = True
        if again:
            for i in range(state.shape[0]):
                state[i] = state_before[i]
    for i in range(n):
        for k in range(6):
            twist_jacobian[k, i] /= scale[i]
    return OK


class WeightedLeastNorm(PositionLimit, frozen=True, kw_only=True, tag="weighted-least-norm"):
    """Penalise joints moving towards their limits: the least Σ wᵢ uᵢ²/2 − zᵢ uᵢ that does the task.

    [Chan and Dubey 1995] wᵢ = 1 + |∂H/∂qᵢ| if the command moves joint i towards its nearer limit, else 1, with
    H = Σ R²/(4 (qmax − q)(q − qmin)) and R = qmax − qmin; nearer to a limit than 10⁻⁵ R, and beyond it, w is what it is
    there. Without a null space motion z that is q̇ = W⁻¹Jᵀ(J W⁻¹Jᵀ)⁻¹ y. The law's inverse acts on J W^(−1/2), its
    thresholds too.

    The print weighs a joint if |∂H/∂qᵢ| did not decrease since the last sample, and it leaves z out; weighed as (uᵢ −
    zᵢ)² a joint near its limit would follow z across it, and chatter where z and the task disagree. Here a weight
    changes how far a joint moves but not which way: uᵢ = c/(wᵢ + d), with c and d that do not depend on wᵢ.

    Where the arm has joints to spare, motion is shared among those that are far from their limits. In samples nothing
    is guaranteed: a joint that alone can do the task is slowed only by the inverse's damping. Joints without both
    limits are passed over.
    """

    kernel = weighted_least_norm

    def parameters(self, robot: Robot, period: float, command_mode: str, velocity: np.ndarray) -> np.ndarray:
        """Return the limits."""
        return input_ranges.pack(**position_limits("limits.position", robot)._asdict())
