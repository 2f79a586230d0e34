"""The cascade that S17 replaces: a law for a base that could move sideways, and a loop that makes a drive follow."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline, kernel
from dqcontrol.compiled.layout import Layout
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.laws.feedback_linearization import FeedbackLinearization
from dqcontrol.laws.law import LAW
from dqcontrol.laws.linearization import (
    linearization_parameters,
    linearization_state,
    linearization_work,
    linearize,
)
from dqcontrol.laws.null_space import AnyNullSpace
from dqcontrol.laws.unconstrained_drive import drive_table, turn_rates
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference


class CascadeParameters(NamedTuple):
    """What compiled code knows of the law."""

    outer: Annotated[Array, linearization_parameters.sized("drives")]
    inner_gain: float


class CascadeState(NamedTuple):
    """What it keeps: the state of the outer loop, and x, y and φ of the virtual bases."""

    outer: Annotated[Array, linearization_state.sized("columns")]
    virtual: Annotated[Array, "drives", 3]


cascade_parameters = Layout(CascadeParameters, "drives")
cascade_state = Layout(CascadeState, "columns", "drives")


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


@kernel(LAW)
def cascade(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write the rates of the outer law, those of bases as the inner loop follows them."""
    m, k = out.shape[0], q.shape[0] - out.shape[0]
    given, kept = cascade_parameters(parameters, k), cascade_state(state, m + k, k)
    outer, last = linearization_parameters(given.outer, k), linearization_state(kept.outer, m + k)
    own = linearization_work(work, m, m + k)
    drives, rates = outer.drives, own.rates
    status = linearize(pose, twist_jacobian, sample, outer, last, own)
    for i in range(m):
        out[i] = rates[i]
    for i in range(k):
        j = int(drives[i, 0])
        sideways, displacement = rates[m + i], drives[i, 1]
        track_virtual_base(
            q, j + i, kept.virtual[i], rates, j, sideways, displacement, given.inner_gain, outer.period, out
        )
    turn_rates(drives, out, outer.period, rates)
    for i in range(m + k):
        last.last[i] = rates[i]
    return status


class Cascade(FeedbackLinearization, frozen=True, kw_only=True, tag="cascade"):
    """Two loops in place of one law, to compare with. [Silva and Adorno 2016, Salazar-Sangucho and Adorno 2014]

    The outer loop is `FeedbackLinearization` with the velocity state ``"commanded"``: it takes bases as if they could
    move sideways, and so generates ẋ, ẏ, φ̇ and q̇ from the hand's measured pose. Joints take their q̇. A virtual base
    integrates ẋ, ẏ and φ̇ from where the base starts, and the inner loop, input–output linearising, makes the point
    y = p + d [cos φ, sin φ] of each drive follow that of its virtual base, y_r:

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
    velocity_state: Literal["commanded"] = "commanded"
    null_space: AnyNullSpace | None = None
    inner_gain: Annotated[float, Meta(gt=0, description="κ, 1/s")] = 2.0

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return the row of `FeedbackLinearization` and κ."""
        if len(drive_table(robot)) < len(robot.drives):
            raise ValueRangeError(f"law: cascade is for the constrained form of {robot.name}, got the other")
        return cascade_parameters.pack(
            outer=super().rows(robot, reference, dt), inner_gain=as_positive("inner_gain", self.inner_gain)
        )

    def loop_rates(self, parameters: np.ndarray) -> None:
        """Return None: the inner loop has a share in them."""

    def state_size(self, robot: Robot) -> int:
        """Return room for the state of `FeedbackLinearization` and a virtual base for each drive."""
        k = len(robot.drives)
        return cascade_state.size(robot.input_size + k, k)

    def initial_state(self, robot: Robot, q: np.ndarray) -> np.ndarray:
        """Return the state at rest, virtual bases where the bases are."""
        state = super().initial_state(robot, q)
        bases = (robot.drives[:, :1] + np.arange(3)).astype(int)
        cascade_state(state, robot.input_size + len(bases), len(bases)).virtual[:] = q[bases]
        return state
