"""The stage that keeps joints within their position limits; it asks the law with Jacobians of its own.

Jacobian clamping takes joints at their limits out of the Jacobian [Colomé and Torras 2015, S17 4.47]; with weighted
least norm joints near their limits cost more [Chan and Dubey 1995].
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, OK, READ, STATUS, WRITE, WRITE2, Kernel, inline, kernel
from dqcontrol.compiled.intrinsics import ADDRESS, call_law
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ValueRangeError
from dqcontrol.named_fields import NamedFields

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot

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


# Where a limit fixes an input at a value, it hands the law this share of its column of J and z = value/share: the law
# then reckons with the value in y − J z, and its inverse moves the input by no more than the share's square: rounding.
FIXED = 1e-8

# law, what it takes, the limit's own parameters and work (2 m numbers and as many as the state), out; the state ends
# with the limit's memory, and that with the last command that left; the twist Jacobian is handed back as it was but for
# columns of inputs that are 0, the preferred motion may be overwritten
POSITION_LIMIT = STATUS(
    ADDRESS,  # of the law
    INPUT,
    WRITE,
    WRITE2,
    WRITE2,
    READ,
    READ,
    WRITE,
    WRITE,
    READ,
    WRITE,
    WRITE,
)


class PositionLimit(NamedFields, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """How position limits are kept; subclasses name a kernel of signature `POSITION_LIMIT`.

    Mobile bases have no limits and are passed over.
    """

    spec_key: ClassVar[str] = "limits.position"
    kernel: ClassVar[Kernel]

    def parameters(
        self, robot: Robot, period: float, command_mode: str, velocity: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the kernel's parameters, for the parameters of the limit on velocities (none without).

        Raises
        ------
        Error
            If one is not allowed, or the robot has no limits to keep.
        """
        raise NotImplementedError

    def memory(self, robot: Robot, command_mode: str, period: float) -> int:
        """Return how many numbers are kept from sample to sample, the last m of them the command that left."""
        return 0


class InputRanges(NamedTuple):
    """Limits of what each input moves, and which coordinate that is."""

    lower: Annotated[Array, "m"]
    upper: Annotated[Array, "m"]
    coordinate: Annotated[Array, "m"]


input_ranges: MemoryLayout[InputRanges] = MemoryLayout(InputRanges, "m")


def position_limits(field: str, robot: Robot) -> InputRanges:
    """Return the position limits of a robot.

    Raises
    ------
    ValueRangeError
        If no joint has limits.
    """
    lower, upper, input_coordinates = robot.limits.lower, robot.limits.upper, robot.input_coordinates
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        raise ValueRangeError(f"{field}: {robot.name} has no joint limits to keep")
    return InputRanges(
        lower[input_coordinates], upper[input_coordinates], input_coordinates.astype(np.float64)
    )


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
            # rounding of the law's solution is no reason to hold
            if beyond > max(most_beyond, 1e-9 * allowed):
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
        return clamping_parameters.pack(
            period=period,
            tolerance=self.tolerance,
            memory=self.memory(robot, command_mode, period),
            **position_limits("limits.position", robot)._asdict(),
            longest=_MOST_LAG * robot.limits.velocity,
            velocity=velocity,
        )

    def memory(self, robot: Robot, command_mode: str, period: float) -> int:
        """Return room for lags, the last configuration and the last command, where commands move a target."""
        return lag_memory.size(robot.input_size) if command_mode == "integrated" else 0


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
