"""Compensation in the joints around any law: sag fed forward, and a disturbance observer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, TypeAlias

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, Kernel, kernel
from dqcontrol.compiled.intrinsics import as_matrix, call_law
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_each
from dqcontrol.limits.position_limit import POSITION_LIMIT
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.kinematics.gravity import WORK, robot_gravity_torque

if TYPE_CHECKING:
    from dqcontrol.robots.robot import Robot


def lag_weights(share: float, lag: float, period: float) -> tuple[float, float]:
    """Return the weight of the older target, and what is left of the distance to it after a period, exp(−T/τ).

    A target that is followed for the first share f of a period T, before the next one is for the rest, counts with
    (exp(−(1 − f)T/τ) − exp(−T/τ))/(1 − exp(−T/τ)).

    Parameters
    ----------
    share
        f, above 0, up to 1: of the period, in which the older target holds.
    lag
        Time constant τ, s; 0: joints are where their newest target is.
    period
        Period T, s.

    Examples
    --------
    >>> [round(each, 3) for each in lag_weights(0.5, 0.05, 0.01)]
    [0.475, 0.819]
    """
    if not lag:
        return 1.0 if share == 1 else 0.0, 0.0
    decay = math.exp(-period / lag)
    oldest = (
        1.0 if share == 1 else (math.exp((share - 1) * period / lag) - decay) / -math.expm1(-period / lag)
    )
    return oldest, decay


Each: TypeAlias = Annotated[float, Meta(ge=0)] | list[Annotated[float, Meta(ge=0)]]
_MOST_LATE = 2000  # periods


class CompensationParameters(NamedTuple):
    """What compiled code knows of it.

    Attributes
    ----------
    period
        T.
    share
        1 − exp(−T/τ_q) of the observer; 0 without one.
    gravity
        In the base frame.
    compliance, decay, delay, oldest
        Of each joint: c, exp(−T/τ), delay in periods begun, and the weight of the older target.
    weights, table
        Of the robot's bodies, and the table of the joints that carry them; see `robots.gravity`.
    """

    period: float
    share: float
    sags: float
    gravity: Annotated[Array, 3]
    compliance: Annotated[Array, "n"]
    decay: Annotated[Array, "n"]
    delay: Annotated[Array, "n"]
    oldest: Annotated[Array, "n"]
    weights: Annotated[Array, "sizes.bodies", 4]
    table: Annotated[Array, "sizes.bodies + 1", "sizes.columns"]


class CompensationSizes(NamedTuple):
    """What stands before the parameters: the size of the memory, and how many targets, bodies and columns there are."""

    memory: int
    late: int
    bodies: int
    columns: int
    rest: Annotated[Array, ...]


class CompensationMemory(NamedTuple):
    """What it keeps, and scratch; the command that left stands last, as `PositionLimit.memory` asks for it."""

    begun: Annotated[Array, 1]
    before: Annotated[Array, "n"]
    disturbance: Annotated[Array, "n"]
    torque: Annotated[Array, "n"]
    ahead: Annotated[Array, "n"]
    moved: Annotated[Array, "n"]
    scratch: Annotated[Array, "bodies", WORK]
    targets: Annotated[Array, "late", "n"]
    sent: Annotated[Array, "n"]


compensation_sizes: MemoryLayout[CompensationSizes] = MemoryLayout(CompensationSizes)
compensation_parameters: MemoryLayout[CompensationParameters] = MemoryLayout(
    CompensationParameters, "n", "sizes"
)
compensation_memory: MemoryLayout[CompensationMemory] = MemoryLayout(
    CompensationMemory, "n", "late", "bodies"
)


@kernel(POSITION_LIMIT)
def compensate(
    law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, parameters, work, out
):
    """Write the law's command, with what the joints will give way added, and what they were seen to give way.

    The memory, which stands last in the state, has a size that depends on how many targets and bodies it holds.
    """
    status = call_law(
        law, q, pose, pose_jacobian, twist_jacobian, sample, law_constants, state, law_work, out
    )
    if status != OK:
        return status
    n = out.shape[0]
    sizes = compensation_sizes(parameters)
    given, late = compensation_parameters(sizes.rest, n, sizes), sizes.late
    kept = compensation_memory(state[state.shape[0] - sizes.memory :], n, late, sizes.bodies)
    targets, torque, before = kept.targets, kept.torque, kept.before
    scratch = as_matrix(kept.scratch, 1, WORK * sizes.bodies)[0]
    for i in range(n):
        torque[i] = 0.0
        kept.moved[i] = q[i]
    if given.sags != 0.0:
        status = robot_gravity_torque(given.table, given.weights, kept.moved, given.gravity, torque, scratch)
        if status != OK:
            return status
    if kept.begun[0] == 0.0:
        kept.begun[0] = 1.0
        for i in range(n):
            before[i] = q[i]
            for k in range(late):
                targets[k, i] = q[i] + given.compliance[i] * torque[i]
    else:
        for k in range(late - 1, 0, -1):
            for i in range(n):
                targets[k, i] = targets[k - 1, i]
        for i in range(n):
            targets[0, i] += given.period * kept.sent[i]
    for i in range(n):
        if given.share != 0.0:
            delay = int(given.delay[i])
            goal = targets[delay, i]
            if given.oldest[i] < 1.0:
                goal = given.oldest[i] * goal + (1.0 - given.oldest[i]) * targets[delay - 1, i]
            answer = (q[i] - given.decay[i] * before[i]) / (1.0 - given.decay[i])
            seen = answer - goal + given.compliance[i] * torque[i]
            change = given.share * (seen - kept.disturbance[i])
            kept.disturbance[i] += change
            out[i] -= change / given.period
            before[i] = q[i]
    if given.sags != 0.0:
        for i in range(n):
            kept.moved[i] = q[i] + given.period * out[i]
        status = robot_gravity_torque(
            given.table, given.weights, kept.moved, given.gravity, kept.ahead, scratch
        )
        if status != OK:
            return status
        for i in range(n):
            out[i] += given.compliance[i] * (kept.ahead[i] - torque[i]) / given.period
    return OK


class Compensation(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Sag fed forward, and a disturbance observer, for joints whose targets the commands move (``integrated``).

    The observer compares the targets that left, through what it takes the joints for, with where they are, and takes
    the difference, low-passed with τ_q, off the next targets: an integral of what disturbs the joints that does not
    wind up, as it knows what left. It is stable as long as |Q Δ| < 1 at all frequencies, Q its low pass and Δ by what
    share the joints differ from the model; ``dqcontrol check`` judges the loop with it.

    Parameters
    ----------
    compliance
        c = α/K: by how much a joint gives way to its gravity torque, rad/(N·m), each; needs a robot with inertia. It is
        fed forward, and what of it is known is not taken for a disturbance.
    observer
        τ_q, s; without it nothing is observed.
    lag, delay
        What the observer takes the joints for, s, each.
    gravity
        m/s² in the base frame.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), [0, 0.6, 0, 1.6, 0, 0.6, 0]
    >>> circle = dqc.references.StartRamp(dqc.references.Circle(arm.fkm(q), radius=0.05, duration=2.0), 0.5)
    >>> law, plant = dqc.laws.ProportionalFeedforward(gain=5.0), dqc.plants.Servo(sag=1.0)
    >>> limits = [None, dqc.limits.CommandLimits(compensation=dqc.limits.Compensation(compliance=1 / 500))]
    >>> errors = [
    ...     dqc.simulate(arm, circle, law, plant, q, 0.01, limits=each).position_error.max() for each in limits
    ... ]
    >>> bool(errors[1] < 0.8 * errors[0])
    True
    """

    spec_key: ClassVar[str] = "limits.compensation"
    kernel: ClassVar[Kernel] = compensate
    compliance: Annotated[Each, Meta(description="rad/(N·m) or m/N")] = 0.0
    observer: Annotated[float, Meta(gt=0, description="s")] | None = None
    lag: Annotated[Each, Meta(description="s")] = 0.0
    delay: Annotated[Each, Meta(description="s")] = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def parameters(
        self, robot: Robot, period: float, command_mode: str, velocity: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the kernel's parameters.

        Raises
        ------
        Error
            If one is not allowed, the robot has a drive, or no inertia for its sag.
        """
        n = robot.configuration_size
        if robot.input_size != n:
            raise ShapeError(f"limits.compensation: is for arms, and {robot.name} drives")
        compliance = self._each("compliance", n)
        if compliance.any() and robot.inertia is None:
            raise ValueRangeError(f"limits.compensation.compliance: {robot.name} has no inertia to sag under")
        answers = [self._answer(delay, lag, period) for delay, lag in zip(*self._model(n), strict=True)]
        delays, oldest, decays = np.array(answers).T
        weights, table = self._bodies(robot)
        share = -math.expm1(-period / self.observer) if self.observer else 0.0
        rest = compensation_parameters.pack(
            period=period,
            share=share,
            sags=float(compliance.any()),
            gravity=as_array("limits.compensation.gravity", self.gravity, (3,)),
            compliance=compliance,
            decay=decays,
            delay=delays,
            oldest=oldest,
            weights=weights,
            table=table,
        )
        return compensation_sizes.pack(
            memory=self.memory(robot, command_mode, period),
            late=self._late(n, period),
            bodies=len(weights),
            columns=table.shape[1],
            rest=rest,
        )

    def memory(self, robot: Robot, command_mode: str, period: float) -> int:
        """Return how many numbers are kept from sample to sample, the last n of them the command that left."""
        n = robot.configuration_size
        return compensation_memory.size(n, self._late(n, period), len(self._bodies(robot)[0]))

    def _bodies(self, robot: Robot) -> tuple[Array, Array]:
        """Return the robot's bodies that sag, and the table of the joints that carry them."""
        if robot.inertia is None or not np.any(self.compliance):
            return np.zeros((0, 4)), np.zeros((1, 8))
        return robot.inertia.table, robot.inertia_chain

    def _late(self, n: int, period: float) -> int:
        delays, _ = self._model(n)
        most = float(delays.max(initial=0.0)) / period
        if most > _MOST_LATE:
            raise ValueRangeError(
                f"limits.compensation.delay: must be ≤ {_MOST_LATE} periods, got {delays.max():g} s"
            )
        return math.ceil(most - 1e-9) + 1

    def _model(self, n: int) -> tuple[Array, Array]:
        return self._each("delay", n), self._each("lag", n)

    def _each(self, field: str, n: int) -> Array:
        return as_each(f"limits.compensation.{field}", getattr(self, field), n)

    @staticmethod
    def _answer(delay: float, lag: float, period: float) -> tuple[float, float, float]:
        """Return delay in periods begun, weight of the older target, and exp(−T/τ), as servos have them."""
        periods = delay / period
        begun = round(periods) if abs(round(periods) - periods) * period <= 1e-9 else math.ceil(periods)
        share = 1.0 if begun - periods < 1e-9 / period else periods - math.floor(periods)
        return float(begun), *lag_weights(share, lag, period)

    def behind(self, transition: Array, inputs: Array, n: int, period: float) -> tuple[Array, Array] | None:
        """Return a plant's linear model x⁺ = A x + B u with the observer before it; None without an observer.

        Sag, which changes with the configuration, is left out. y are the first entries of x, as before.
        """
        if not self.observer:
            return None
        size, m = inputs.shape
        delays, lags = self._model(n)
        if m == 1:  # one joint stands for all
            delays, lags = delays[:1], lags[:1]
        answers = [self._answer(delay, lag, period) for delay, lag in zip(delays, lags, strict=True)]
        late, share = self._late(n, period), -math.expm1(-period / self.observer)

        def step(state: Array, command: Array) -> Array:
            x, rest = state[:size], state[size:]
            targets = rest[: late * m].reshape(late, m).copy()
            before, disturbance, sent = rest[late * m :].reshape(3, m)
            targets[1:] = targets[:-1].copy()
            targets[0] += period * sent
            change = np.zeros(m)
            for i, (delay, oldest, decay) in enumerate(answers):
                goal = oldest * targets[int(delay), i] + (1 - oldest) * targets[max(int(delay) - 1, 0), i]
                seen = (x[i] - decay * before[i]) / (1 - decay) - goal
                change[i] = share * (seen - disturbance[i])
            left = command - change / period
            return np.concatenate(
                [transition @ x + inputs @ left, targets.ravel(), x[:m], disturbance + change, left]
            )

        whole = size + (late + 3) * m
        zero, idle = np.zeros(whole), np.zeros(m)
        return (
            np.column_stack([step(unit, idle) for unit in np.eye(whole)]),
            np.column_stack([step(zero, unit) for unit in np.eye(m)]),
        )
