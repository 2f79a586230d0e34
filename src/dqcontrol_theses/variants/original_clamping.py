"""Jacobian clamping as S17 found it: joints outside their limits are taken out of the Jacobian, and stay out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dqcontrol.compiled import call_law, kernel
from dqcontrol.limits import POSITION_LIMIT, PositionLimit, input_ranges, position_limits

if TYPE_CHECKING:
    from dqcontrol.robots import Robot


@kernel(POSITION_LIMIT)
def original_clamping(
    law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, parameters, work, out
):
    """Ask the law without the joints that are outside their limits."""
    n = out.shape[0]
    given = input_ranges(parameters, n)
    lower, upper, input_coordinates = given.lower, given.upper, given.coordinate
    for i in range(n):
        if not lower[i] <= q[int(input_coordinates[i])] <= upper[i]:
            for k in range(6):
                twist_jacobian[k, i] = 0.0
            law_work[i] = 0.0  # nor is it to move where nothing is asked of the hand
    status = call_law(
        law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, out
    )
    for i in range(n):
        if not lower[i] <= q[int(input_coordinates[i])] <= upper[i]:
            out[i] = 0.0
    return status


class OriginalClamping(PositionLimit, frozen=True, kw_only=True, tag="original-clamping"):
    """Block joints outside their limits: q̇ = H (J H)⁺ y, hᵢ = 0 where qᵢ is outside. [Colomé and Torras 2015, S17 2.3]

    For comparison: a joint crosses its limit by up to one step, T q̇ᵢ, and is then locked for ever, whatever the task
    asks for later. Prefer `dqcontrol.limits.ModifiedClamping`. Joints without limits are passed over.
    """

    kernel = original_clamping

    def parameters(self, robot: Robot, period: float, command_mode: str, velocity: np.ndarray) -> np.ndarray:
        """Return the limits."""
        return input_ranges.pack(**position_limits("limits.position", robot)._asdict())
