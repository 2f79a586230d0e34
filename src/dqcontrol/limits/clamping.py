"""Jacobian clamping: joints at their limits are taken out of the Jacobian. [Colomé and Torras 2015, S17 4.47]"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.compiled.compile import OK, inlined, kernel
from dqcontrol.compiled.law_signature import call_law
from dqcontrol.errors import as_positive
from dqcontrol.limits.position_limit import (
    POSITION_LIMIT,
    PositionLimit,
    position_limits,
)

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

# Rounding of q + T u may not carry a joint over its limit: each of the five operations errs by 2⁻⁵³ at most.
_JUST_SHORT = 1.0 - 8 * 2.0**-53


@inlined
def _block(i, twist_jacobian, preferred):
    """Take joint i out of the Jacobian and of the preferred motion."""
    for k in range(6):
        twist_jacobian[k, i] = 0.0
    preferred[i] = 0.0


@kernel(POSITION_LIMIT)
def modified_clamping(
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
    """Ask the law again without the joints that it would drive out of their limits, then clip what is left."""
    n = out.shape[0]
    period, tolerance = parameters[0], parameters[1]
    lower, upper = parameters[2 : 2 + n], parameters[2 + n : 2 + 2 * n]
    moved = parameters[2 + 2 * n : 2 + 3 * n]
    is_blocked, state_before = work[0:n], work[n:]
    for i in range(n):
        is_blocked[i] = 0.0
    for i in range(state.shape[0]):
        state_before[i] = state[i]
    again = True
    while again:  # blocks a joint more each time
        status = call_law(
            law, q, pose, pose_jacobian, twist_jacobian, sample, law_parameters, state, law_work, out
        )
        if status != OK:
            return status
        again = False
        for i in range(n):
            angle = q[int(moved[i])]
            if is_blocked[i] != 0.0:
                out[i] = 0.0
            elif (out[i] > 0.0 and angle >= upper[i] - tolerance) or (
                out[i] < 0.0 and angle <= lower[i] + tolerance
            ):
                is_blocked[i] = 1.0
                _block(i, twist_jacobian, law_work)
                again = True
        if again:
            for i in range(state.shape[0]):
                state[i] = state_before[i]
    for i in range(n):
        angle = q[int(moved[i])]
        least = min((lower[i] - angle) / period * _JUST_SHORT, 0.0)
        most = max((upper[i] - angle) / period * _JUST_SHORT, 0.0)
        out[i] = min(max(out[i], least), most)
    return OK


class ModifiedClamping(PositionLimit, frozen=True, kw_only=True, tag="modified-clamping"):
    """Block joints at a limit only while the law drives them outwards: q̇ = H (J H)⁺ y, H = diag(hᵢ). [S17 4.47]

    hᵢ = 0 if joint i is at a limit and the command without blocking drives it outwards; the law is then asked again
    without its column of J, and so on while that drives further joints outwards from their limits. So the joints left
    do what they can for the task (least squares), and a blocked joint is free as soon as the command without blocking
    points inwards. What is left is clipped to (qmin − q)/T … (qmax − q)/T: with ideal joints a limit is reached up to
    rounding and never crossed. (The print asks for q = qmax, which never holds in samples.) A joint that starts outside
    its limits is never driven further out, and comes in when the law wants it in. Scaling to velocity limits afterwards
    keeps all this. Joints without limits are passed over.

    Parameters
    ----------
    tolerance
        How near counts as at the limit, rad or m. Where joints stop short of a limit (sag, encoder noise), take as much
        as that.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> beyond = np.array([0, 0.6, 0, 2.3, 0, 0.6, 0])  # joint 4 ends at 2.094
    >>> target, law = dqc.references.SetPoint(arm.fkm(beyond)), dqc.laws.Proportional(gain=5.0)
    >>> limits = dqc.limits.CommandLimits(position=dqc.limits.ModifiedClamping())
    >>> plant = dqc.plants.Integrator()
    >>> record = dqc.simulate(arm, target, law, plant, q, period=0.01, duration=3.0, limits=limits)
    >>> bool((record.q <= arm.limits.upper).all())
    True
    """

    kernel = modified_clamping
    tolerance: Annotated[float, Meta(ge=0, description="rad or m")] = 1e-6

    def parameters(self, robot: Robot, dt: float) -> np.ndarray:
        """Return period, tolerance and limits."""
        tolerance = as_positive("limits.position.tolerance", self.tolerance, zero_allowed=True)
        return np.concatenate([[dt, tolerance], position_limits("limits.position", robot)])


@kernel(POSITION_LIMIT)
def original_clamping(
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
    """Ask the law without the joints that are outside their limits."""
    n = out.shape[0]
    lower, upper, moved = parameters[0:n], parameters[n : 2 * n], parameters[2 * n : 3 * n]
    for i in range(n):
        if not lower[i] <= q[int(moved[i])] <= upper[i]:
            _block(i, twist_jacobian, law_work)
    status = call_law(
        law, q, pose, pose_jacobian, twist_jacobian, sample, law_parameters, state, law_work, out
    )
    for i in range(n):
        if not lower[i] <= q[int(moved[i])] <= upper[i]:
            out[i] = 0.0
    return status


class OriginalClamping(PositionLimit, frozen=True, kw_only=True, tag="original-clamping"):
    """Block joints outside their limits: q̇ = H (J H)⁺ y, hᵢ = 0 where qᵢ is outside. [Colomé and Torras 2015, S17 2.3]

    For comparison: a joint crosses its limit by up to one step, T q̇ᵢ, and is then locked for ever, whatever the task
    asks for later. Prefer `ModifiedClamping`. Joints without limits are passed over.
    """

    kernel = original_clamping

    def parameters(self, robot: Robot, dt: float) -> np.ndarray:
        """Return the limits."""
        return position_limits("limits.position", robot)
