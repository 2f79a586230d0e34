"""Jacobian clamping: joints at their limits are taken out of the Jacobian. [Colomé and Torras 2015, S17 4.47]"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, inline, kernel
from dqcontrol.compiled.law_signature import call_law
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.limits.position_limit import (
    FIXED,
    POSITION_LIMIT,
    PositionLimit,
    position_limits,
)

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

# Rounding of q + T u may not carry a joint over its limit: each of the five operations errs by 2⁻⁵³ at most.
_JUST_SHORT = 1.0 - 8 * 2.0**-53

# No joint is taken to be further behind its target than what it goes in this time, s: what lags more is held by
# something else. It changes nothing for servos that lag by less.
_MOST_LAG = 0.25


class ClampingParameters(NamedTuple):
    """What compiled code knows of `ModifiedClamping`.

    Attributes
    ----------
    memory
        Size of the `LagMemory`, where commands move a target that joints follow with a lag; else 0.
    lower, upper, coordinate
        As `position_limits` has them.
    longest
        Lag of each joint.
    velocity
        Velocity limits, as `speed_limits` has them; none if velocities are not limited.
    """

    period: float
    tolerance: float
    memory: float
    lower: Annotated[Array, "m"]
    upper: Annotated[Array, "m"]
    coordinate: Annotated[Array, "m"]
    longest: Annotated[Array, "m"]
    velocity: Annotated[Array, ...]


class LagMemory(NamedTuple):
    """What `ModifiedClamping` keeps behind the law's state where commands move a target.

    Attributes
    ----------
    started
        1 after the first sample.
    lag
        Of each joint behind its target.
    last, sent
        Configuration and command of the last sample.
    """

    started: Annotated[Array, 1]
    lag: Annotated[Array, "m"]
    last: Annotated[Array, "m"]
    sent: Annotated[Array, "m"]


class ClampingWork(NamedTuple):
    """Scratch: which joints are held (1: at a limit, 2: at a value) and at what, and the law's state before."""

    is_held: Annotated[Array, "m"]
    value: Annotated[Array, "m"]
    state_before: Annotated[Array, "state"]


clamping_parameters: MemoryLayout[ClampingParameters] = MemoryLayout(ClampingParameters, "m")
lag_memory: MemoryLayout[LagMemory] = MemoryLayout(LagMemory, "m")
clamping_work: MemoryLayout[ClampingWork] = MemoryLayout(ClampingWork, "m", "state")


@inline
def _block(i, twist_jacobian, preferred):
    """Take joint i out of the Jacobian and of the preferred motion."""
    for k in range(6):
        twist_jacobian[k, i] = 0.0
    preferred[i] = 0.0


@inline
def _fix(i, value, twist_jacobian, preferred):
    """Let the law reckon with a joint that moves at a given speed."""
    for k in range(6):
        twist_jacobian[k, i] *= FIXED
    preferred[i] = value / FIXED


@inline
def _follow_lags(kept, q, coordinate, period, longest):
    """Add to each joint's lag behind its target what was sent, less what the joint went."""
    lag, last = kept.lag, kept.last
    for i in range(coordinate.shape[0]):
        angle = q[int(coordinate[i])]
        if kept.started[0] != 0.0:
            lag[i] = min(max(lag[i] + period * kept.sent[i] - (angle - last[i]), -longest[i]), longest[i])
        last[i] = angle
    kept.started[0] = 1.0


@kernel(POSITION_LIMIT)
def modified_clamping(
    law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, parameters, work, out
):
    """Ask the law again without the joints that it would drive out of their limits, until it keeps them all.

    Joints at their position limits are blocked, all at once; then the one that is furthest beyond what it may do in
    this period is held at that, one after the other.
    """
    n = out.shape[0]
    given = clamping_parameters(parameters, n)
    period, tolerance, velocity = given.period, given.tolerance, given.velocity
    lower, upper, input_coordinates = given.lower, given.upper, given.coordinate
    own = clamping_work(work, n, state.shape[0])
    is_held, value, state_before = own.is_held, own.value, own.state_before
    moves_target, law_size = given.memory != 0.0, state.shape[0] - int(given.memory)
    kept = lag_memory(state[law_size:], n)
    if moves_target:
        _follow_lags(kept, q, input_coordinates, period, given.longest)
    for i in range(n):
        is_held[i] = 0.0
    for i in range(law_size):
        state_before[i] = state[i]
    again = True
    while again:  # holds a joint more each time
        status = call_law(
            law,
            q,
            pose,
            pose_jacobian,
            twist_jacobian,
            sample,
            law_constants,
            state[0:law_size],
            law_work,
            out,
        )
        if status != OK:
            return status
        again = False
        worst, most_beyond, bound = -1, 0.0, 0.0
        for i in range(n):
            if is_held[i] != 0.0:
                out[i] = value[i]
                continue
            angle = q[int(input_coordinates[i])]
            lag = kept.lag[i] if moves_target else 0.0
            above, below = angle + max(lag, 0.0), angle + min(lag, 0.0)
            if (out[i] > 0.0 and above >= upper[i] - tolerance) or (
                out[i] < 0.0 and below <= lower[i] + tolerance
            ):
                is_held[i], value[i] = 1.0, 0.0
                _block(i, twist_jacobian, law_work)
                again = True
                continue
            fastest = velocity[i] if velocity.shape[0] > 0 else math.inf
            distance = upper[i] - above if out[i] > 0.0 else below - lower[i]
            allowed = min(fastest, max(distance / period * _JUST_SHORT, 0.0))
            beyond = abs(out[i]) - allowed
            if beyond > max(
                most_beyond, 1e-9 * allowed
            ):  # rounding of the law's solution is no reason to hold
                worst, most_beyond, bound = i, beyond, math.copysign(allowed, out[i])
        if not again and worst >= 0:
            is_held[worst], value[worst] = 2.0, bound
            _fix(worst, bound, twist_jacobian, law_work)
            again = True
        if again:
            for i in range(law_size):
                state[i] = state_before[i]
    for i in range(n):
        if is_held[i] == 2.0:
            for k in range(6):
                twist_jacobian[k, i] /= FIXED
            law_work[i] = 0.0  # as it stays where nothing is preferred
        angle = q[int(input_coordinates[i])]
        lag = kept.lag[i] if moves_target else 0.0
        fastest = velocity[i] if velocity.shape[0] > 0 else math.inf
        least = max(min((lower[i] - (angle + min(lag, 0.0))) / period * _JUST_SHORT, 0.0), -fastest)
        most = min(max((upper[i] - (angle + max(lag, 0.0))) / period * _JUST_SHORT, 0.0), fastest)
        out[i] = min(max(out[i], least), most)
    return OK


class ModifiedClamping(PositionLimit, frozen=True, kw_only=True, tag="modified-clamping"):
    """Block joints at a limit only while the law drives them outwards: q̇ = H (J H)⁺ y, H = diag(hᵢ). [S17 4.47]

    hᵢ = 0 if joint i is at a limit and the command without blocking drives it outwards; the law is then asked again
    without its column of J, and so on while that drives further joints outwards from their limits. So the joints left
    do what they can for the task (least squares), and a blocked joint is free as soon as the command without blocking
    points inwards. Then the joint that is furthest beyond (qmin − q)/T … (qmax − q)/T, or its velocity limit, is held
    at that and the law asked for the others again, joint by joint, so that they make up for it: with ideal joints a
    limit is reached up to rounding and never crossed. (The print asks for q = qmax, which never holds in samples.) A
    joint that starts outside its limits is never driven further out, and comes in when the law wants it in. Scaling to
    velocity limits afterwards keeps all this. Joints without limits are passed over.

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

    def parameters(self, robot: Robot, period: float, command_mode: str, velocity: np.ndarray) -> np.ndarray:
        """Return period, tolerance, command mode, position limits, longest lags and velocity limits."""
        tolerance = self.tolerance
        return clamping_parameters.pack(
            period=period,
            tolerance=tolerance,
            memory=self.memory(robot, command_mode, period),
            **position_limits("limits.position", robot)._asdict(),
            longest=_MOST_LAG * robot.limits.velocity,
            velocity=velocity,
        )

    def memory(self, robot: Robot, command_mode: str, period: float) -> int:
        """Return room for lags, the last configuration and the last command, where commands move a target."""
        return lag_memory.size(robot.input_size) if command_mode == "integrated" else 0
