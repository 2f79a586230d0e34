"""The cascades that S17 replaces: a law for a base that could move sideways, and a loop that makes a drive follow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled import LAW, MemoryLayout, inline, kernel
from dqcontrol.errors import ValueRangeError
from dqcontrol.laws import PoseLaw, parts
from dqcontrol.robots import Robot
from dqcontrol_theses.variants.classic_proportional import classic_twist
from dqcontrol_theses.variants.published_linearization import (
    PublishedLinearization,
    linearize_sideways,
    published_parameters,
    published_work,
)
from dqcontrol_theses.variants.sideways_drives import turn_rates, twist_jacobian_with_sideways

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class CascadeParameters(NamedTuple):
    """What compiled code knows of the law."""

    outer: Annotated[Array, published_parameters.sized("drives")]
    inner_gain: float


class CascadeState(NamedTuple):
    """What it keeps: the state of the outer loop, and x, y and φ of the virtual bases."""

    outer: Annotated[Array, parts.linearization_state.sized("columns")]
    virtual: Annotated[Array, "drives", 3]


class ClassicCascadeParameters(NamedTuple):
    """What compiled code knows of the law with the classic outer loop."""

    inverse: Annotated[Array, parts.inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]
    inner_gain: float
    period: float
    drives: Annotated[Array, "drives", 2]


class ClassicCascadeState(NamedTuple):
    """What it keeps: the sign of x_d, and x, y and φ of the virtual bases."""

    sign: Annotated[Array, 1]
    virtual: Annotated[Array, "drives", 3]


class ClassicCascadeWork(NamedTuple):
    """Its scratch; columns are those of m inputs, and one for each drive that cannot move sideways."""

    preferred: Annotated[Array, "m"]
    rate: Annotated[Array, 8]
    jacobian: Annotated[Array, 6, "columns"]
    rates: Annotated[Array, "columns"]
    preferred_rates: Annotated[Array, "columns"]
    solver: Annotated[Array, parts.twist_work.sized("columns")]


cascade_parameters: MemoryLayout[CascadeParameters] = MemoryLayout(CascadeParameters, "drives")
cascade_state: MemoryLayout[CascadeState] = MemoryLayout(CascadeState, "columns", "drives")
classic_cascade_parameters: MemoryLayout[ClassicCascadeParameters] = MemoryLayout(
    ClassicCascadeParameters, "drives"
)
classic_cascade_state: MemoryLayout[ClassicCascadeState] = MemoryLayout(ClassicCascadeState, "drives")
classic_cascade_work: MemoryLayout[ClassicCascadeWork] = MemoryLayout(ClassicCascadeWork, "m", "columns")


@inline
def track_virtual_base(q, i, virtual, rates, j, sideways, displacement, gain, period, out):
    """Write v and ω with which the displaced point follows that of a virtual base, and move the virtual base."""
    c, s = math.cos(q[i + 2]), math.sin(q[i + 2])
    ahead_c, ahead_s = math.cos(virtual[2]), math.sin(virtual[2])
    turning = rates[j + 1]
    xdot, ydot = rates[j] * c - sideways * s, rates[j] * s + sideways * c
    px = xdot - displacement * turning * ahead_s
    py = ydot + displacement * turning * ahead_c
    px += gain * (virtual[0] + displacement * ahead_c - q[i] - displacement * c)
    py += gain * (virtual[1] + displacement * ahead_s - q[i + 1] - displacement * s)
    out[j] = px * c + py * s
    out[j + 1] = (py * c - px * s) / displacement
    virtual[0] += period * xdot
    virtual[1] += period * ydot
    virtual[2] += period * turning


@inline
def follow_virtual_bases(q, virtual, rates, drives, gain, period, out):
    """Write the m inputs that follow m + k rates of the outer law, and move the virtual bases."""
    m = out.shape[0]
    for i in range(m):
        out[i] = rates[i]
    for i in range(drives.shape[0]):
        j = int(drives[i, 0])
        sideways, displacement = rates[m + i], drives[i, 1]
        track_virtual_base(q, j + i, virtual[i], rates, j, sideways, displacement, gain, period, out)


@kernel(LAW)
def cascade(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write the rates of the outer law, those of bases as the inner loop follows them."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given, kept = cascade_parameters(parameters, k), cascade_state(state, m + k, k)
    outer, last = published_parameters(given.outer, k), parts.linearization_state(kept.outer, m + k)
    own, period = published_work(work, m, m + k), parts.linearization_parameters(outer.linear).period
    rates = own.rates
    status = linearize_sideways(pose, twist_jacobian, sample, outer, last, own)
    follow_virtual_bases(q, kept.virtual, rates, outer.drives, given.inner_gain, period, out)
    turn_rates(outer.drives, out, period, rates)
    for i in range(m + k):
        last.last[i] = rates[i]
    return status


@kernel(LAW)
def classic_cascade(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write J⁺ K vec8(x_d − x), J with a sideways column for each drive; bases as the inner loop follows them."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given, kept = classic_cascade_parameters(parameters, k), classic_cascade_state(state, k)
    own = classic_cascade_work(work, m, m + k)
    twist_jacobian_with_sideways(given.drives, twist_jacobian, own.jacobian)
    for i in range(m + k):
        own.preferred_rates[i] = own.preferred[i] if i < m else 0.0
    twist = classic_twist(pose, sample, given.gain, given.hysteresis, kept.sign, own.rate)
    status = parts.solve_hand_twist(
        pose,
        own.jacobian,
        twist,
        parts.pose_error(pose, sample),
        own.preferred_rates,
        given.inverse,
        own.solver,
        own.rates,
    )
    follow_virtual_bases(q, kept.virtual, own.rates, given.drives, given.inner_gain, given.period, out)
    return status


def _constrained_drives(robot: Robot, name: str) -> np.ndarray:
    """Return the robot's table of drives, or raise a `ValueRangeError` if its bases move sideways in its own model."""
    drives = parts.drive_table(robot)
    if len(drives) < len(robot.drives):
        raise ValueRangeError(f"law: {name} is for the constrained form of {robot.name}, got the other")
    return drives


def _bases(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Return x, y and φ of each drive, shape (k, 3)."""
    return q[(robot.drives[:, :1] + np.arange(3)).astype(int)]


class Cascade(PublishedLinearization, frozen=True, kw_only=True, tag="cascade"):
    """Two loops in place of one law, to compare with. [Silva and Adorno 2016, Salazar-Sangucho and Adorno 2014]

    The outer loop is `PublishedLinearization`: it takes bases as if they could move sideways, and so generates ẋ, ẏ,
    φ̇ and q̇ from the hand's measured pose. Joints take their q̇. A virtual base integrates ẋ, ẏ and φ̇ from where the
    base starts, and the inner loop, input–output linearising, makes the point y = p + d [cos φ, sin φ] of each drive
    follow that of its virtual base, y_r:

    [v ; ω] = C⁻¹ (ẏ_r + κ (y_r − y)),   C = [[cos φ, −d sin φ], [sin φ, d cos φ]].

    ẏ − ẏ_r = −κ (y − y_r), so y_r is followed; the heading is what follows from that, hence the hand does not move as
    the outer loop means it to. S17 leaves open whether that loop sees the robot or a model of it; here it sees the
    robot, because with a model alone the hand would not arrive. S17's F is the inner loop with the virtual base put
    back onto the base at every sample.

    Parameters
    ----------
    inner_gain
        κ, 1/s; stable for κT < 2.
    """

    kernel = cascade
    velocity_state: Literal["commanded"] = "commanded"  # pyright: ignore[reportIncompatibleVariableOverride]
    inner_gain: Annotated[float, Meta(gt=0, description="κ, 1/s")] = 2.0

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return the row of `PublishedLinearization` and κ."""
        _constrained_drives(robot, "cascade")
        return cascade_parameters.pack(
            outer=super().rows(robot, reference, period), inner_gain=self.inner_gain
        )

    def loop_rates(self, parameters: np.ndarray) -> None:
        """Return None: the inner loop has a share in them."""

    def state_size(self, robot: Robot) -> int:
        """Return room for the state of `PublishedLinearization` and a virtual base for each drive."""
        k = len(robot.drives)
        return cascade_state.size(robot.input_size + k, k)

    def initial_state(self, robot: Robot, q: np.ndarray) -> np.ndarray:
        """Return the state at rest, virtual bases where the bases are."""
        state = super().initial_state(robot, q)
        bases = _bases(robot, q)
        cascade_state(state, robot.input_size + len(bases), len(bases)).virtual[:] = bases
        return state


class ClassicCascade(PoseLaw, frozen=True, kw_only=True, tag="classic-cascade"):
    """The cascade with the classic outer loop, which S17's first version replaced. [Salazar-Sangucho and Adorno 2014]

    The outer loop is the classic law on the Jacobian of a base that could move sideways: J⁺ K vec8(x_d − x) gives ẋ,
    ẏ, φ̇ and q̇ [S17 footnote 11]. The inner loop is that of `Cascade`: joints take their q̇, and each drive follows a
    virtual base that integrates ẋ, ẏ and φ̇. So S17's chapter 2 describes it; that the outer loop sees the robot, as
    that of `Cascade` does, and κ are assumed.

    Sampling limits: those of `ClassicProportional`, and κT < 2. No decay is guaranteed: the heading is what follows
    from the inner loop. The first command is proportional to the error.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, eight diagonal entries, or a `Schedule` of k.
    inner_gain
        κ, 1/s; stable for κT < 2.
    inverse
        How J is inverted; the default is exact away from singularities.
    hysteresis
        How far ⟨r, r_d⟩ must pass 0 before the sign of x_d flips.
    null_space
        Motion preferred where the task leaves freedom; sideways motion is not preferred.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> from dqcontrol_theses.variants import ClassicCascade
    >>> robot, q = dqc.load_robot("little-john"), np.array([0, 0, 0, 0.3, -0.8, 1.2, 0.6, 0.4])
    >>> target = dqc.Sample(robot.fkm(q + [0.1, 0.05, 0, 0, 0, 0, 0, 0]))
    >>> law = ClassicCascade(gain=0.5)
    >>> dict(zip(robot.input_names, law.command(robot, q, target, period=0.05).round(3).tolist()))["v"] > 0
    True
    """

    kernel = classic_cascade
    inner_gain: Annotated[float, Meta(gt=0, description="κ, 1/s")] = 2.0

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return inverse, hysteresis, gain diagonal, κ, period and the table of drives at each time."""
        drives = _constrained_drives(robot, "classic-cascade")
        given = parts.pose_parameters(super().rows(robot, reference, period))
        inner_gain = self.inner_gain
        return classic_cascade_parameters.pack(
            **given._asdict(), inner_gain=inner_gain, period=period, drives=drives
        )

    def loop_rates(self, parameters: np.ndarray) -> None:  # type: ignore[override]
        """Return None: the inner loop has a share in them."""

    def work_size(self, robot: Robot) -> int:
        """Return room for the preferred motion and scratch, with a sideways speed for each drive."""
        return classic_cascade_work.size(robot.input_size, robot.input_size + len(parts.drive_table(robot)))

    def state_size(self, robot: Robot) -> int:
        """Return room for the sign of x_d and a virtual base for each drive."""
        return classic_cascade_state.size(len(robot.drives))

    def initial_state(self, robot: Robot, q: np.ndarray) -> np.ndarray:
        """Return the state before the first sample, virtual bases where the bases are."""
        state = super().initial_state(robot, q)
        classic_cascade_state(state, len(robot.drives)).virtual[:] = _bases(robot, q)
        return state
