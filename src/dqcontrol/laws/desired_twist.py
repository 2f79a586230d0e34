"""The desired twist as laws feed it forward: to second order in the period, so that held commands stay on the path.

A command is held for a period T, in which both the desired twist and the Jacobian go on. Fed forward is therefore

  t = ξ_d + h (ξ̇_d − J̇(u⁻) u⁻),   h = T/2 + D + τ,

u⁻ the last command that left: J(q + h u⁻) u = ξ_d + h ξ̇_d to second order. Joints with a delay D and a lag τ do later
what they are told, so the twist and the Jacobian of that time count. A `Previewed` reference has led its twists itself:
then only the Jacobian is led, by its delay and lag.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import position
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline, shared
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import unknown_name
from dqcontrol.laws.law import Law, beside
from dqcontrol.references.previewed import Previewed

if TYPE_CHECKING:
    from dqcontrol.laws.inverses import FilteredInverse, Inverse
    from dqcontrol.references import Reference
    from dqcontrol.robots import Robot

Feedforward: TypeAlias = Literal["second-order", "printed"]

# of |ξ_d|: with a larger share, u = J⁺ (ξ_d − h J̇(u⁻) u⁻) no longer contracts from sample to sample
_MOST = 0.5


class SecondOrder(NamedTuple):
    """What compiled code knows of it; no numbers at all where the twist is fed forward as it is printed.

    Attributes
    ----------
    half_period
        T/2.
    preview
        Delay and lag by which the reference leads its twists; −1 if it does not.
    lag
        D + τ of the joints.
    length
        ℓ, m.
    order
        Columns of the Jacobian from the base to the end effector, each moved by those before; −1 where there are no
        more.
    drives
        Columns of the speeds v of drives, whose heading their ω, the next column, turns.
    """

    half_period: float
    preview: float
    lag: float
    length: float
    order: Annotated[Array, "m"]
    drives: Annotated[Array, ...]


second_order: MemoryLayout[SecondOrder] = MemoryLayout(SecondOrder, "m", unchecked=True)


class SignedState(NamedTuple):
    """What laws keep that remember the sign of their error alone, and for second order the last command that left."""

    sign: Annotated[Array, 1]
    last: Annotated[Array, "m"]


signed_state: MemoryLayout[SignedState] = MemoryLayout(SignedState, "m", unchecked=True)


def _numbers(
    feedforward: Feedforward, robot: Robot, reference: Reference | None, period: float, length: float
) -> Array:
    """Return `SecondOrder` for a law, a row of numbers; none if it feeds forward as printed."""
    if feedforward not in get_args(Feedforward):
        raise unknown_name("feedforward", str(feedforward), get_args(Feedforward))
    if feedforward == "printed":
        return np.zeros(0)
    order = np.full(robot.input_size, -1.0)
    columns = robot.columns_outwards
    order[: len(columns)] = columns
    led = isinstance(reference, Previewed)
    return second_order.pack(
        half_period=period / 2,
        preview=reference.delay + reference.lag if led else -1.0,
        lag=0.0,
        length=length,
        order=order,
        drives=drive_table(robot)[:, 0],
    )


class FeedforwardLaw(Law, frozen=True, kw_only=True):
    """A law that feeds the desired twist forward: its parameters end with `SecondOrder`, its state with u⁻.

    Attributes
    ----------
    parameters_before, state_before
        How many numbers come before these.
    """

    parameters_before: ClassVar[int]
    state_before: ClassVar[int] = signed_state.place("last", 0)
    if TYPE_CHECKING:  # of the law itself
        feedforward: Feedforward = "second-order"
        inverse: Inverse = FilteredInverse()

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> Array:
        """Return the rows of the law itself, and what feed-forward of second order needs."""
        rows = super().rows(robot, reference, period)
        numbers = _numbers(self.feedforward, robot, reference, period, self.inverse.characteristic_length)
        return beside(rows, numbers)

    def state_size(self, robot: Robot) -> int:
        """Return room for the state of the law itself, and the last command."""
        return self.last_at + robot.input_size if self.last_at else super().state_size(robot)

    @property
    def last_at(self) -> int:
        """Where the state takes the last command."""
        return 0 if self.feedforward == "printed" else self.state_before

    @property
    def lag_at(self) -> int:
        """Where the parameters take the joints' lag."""
        return self.parameters_before + second_order.place("lag", 0) if self.last_at else 0


def drive_table(robot: Robot) -> Array:
    """Return a row [index of the input v, displacement d] for each drive whose inputs are v and ω, shape (k, 2)."""
    drives = robot.drives if robot.input_size < robot.configuration_size else robot.drives[:0]
    return np.array([[first - k, drive[0]] for k, (first, *drive) in enumerate(drives)]).reshape(-1, 2)


@inline
def desired_twist(sample, pose, twist_jacobian, numbers, last, out):
    """Write ξ_d, or the t that second order makes of it with the last command that left.

    h J̇u⁻ is at most half of |ξ_d + h ξ̇_d| in the measure [ℓω ; v of the end effector]: near singularities u⁻ grows
    without bounds. At goals at rest nothing is added; where a path turns back ξ_d is 0 for a moment, but ξ̇_d is not.
    """
    moving = 0.0
    for i in range(6):
        out[i] = sample[8 + i]
        moving += abs(sample[8 + i]) + abs(sample[14 + i])
    if numbers.shape[0] > 0 and moving != 0.0:  # at rest the call is spared
        _add_second_order(sample, pose, twist_jacobian, numbers, last, out)


@shared
def _add_second_order(sample, pose, twist_jacobian, numbers, last, out):
    m = twist_jacobian.shape[1]
    given = second_order(numbers, m)
    px, py, pz = position(pose)
    lead = given.preview if given.preview >= 0.0 else given.half_period + given.lag
    if given.preview < 0.0:
        for i in range(6):
            out[i] += lead * sample[14 + i]
    size = _square(given.length, px, py, pz, out)
    if size > 0.0:
        wx, wy, wz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # what moves a column: the inputs before it
        ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # J̇u
        for k in range(m):
            j = int(given.order[k])
            if j < 0:
                break
            u = last[j]
            a, b, c = u * twist_jacobian[0, j], u * twist_jacobian[1, j], u * twist_jacobian[2, j]
            d, e, f = u * twist_jacobian[3, j], u * twist_jacobian[4, j], u * twist_jacobian[5, j]
            ax, ay, az = ax + wy * c - wz * b, ay + wz * a - wx * c, az + wx * b - wy * a
            bx += wy * f - wz * e + vy * c - vz * b
            by += wz * d - wx * f + vz * a - vx * c
            bz += wx * e - wy * d + vx * b - vy * a
            wx, wy, wz, vx, vy, vz = wx + a, wy + b, wz + c, vx + d, vy + e, vz + f
        for k in range(given.drives.shape[0]):
            j = int(given.drives[k])
            u, v = last[j], last[j + 1]
            a, b, c = v * twist_jacobian[0, j + 1], v * twist_jacobian[1, j + 1], v * twist_jacobian[2, j + 1]
            d, e, f = u * twist_jacobian[3, j], u * twist_jacobian[4, j], u * twist_jacobian[5, j]
            bx, by, bz = bx + b * f - c * e, by + c * d - a * f, bz + a * e - b * d
        ax, ay, az, bx, by, bz = -lead * ax, -lead * ay, -lead * az, -lead * bx, -lead * by, -lead * bz
        # a twist that is led is that of the end effector where it is, not where it will be
        if given.preview > 0.0:
            vx, vy, vz = vx + wy * pz - wz * py, vy + wz * px - wx * pz, vz + wx * py - wy * px
            bx -= lead * (wy * vz - wz * vy)
            by -= lead * (wz * vx - wx * vz)
            bz -= lead * (wx * vy - wy * vx)
        added = _square(given.length, px, py, pz, (ax, ay, az, bx, by, bz))
        share = 1.0
        if added > _MOST * _MOST * size:
            share = _MOST * math.sqrt(size / added)
        out[0], out[1], out[2] = out[0] + share * ax, out[1] + share * ay, out[2] + share * az
        out[3], out[4], out[5] = out[3] + share * bx, out[4] + share * by, out[5] + share * bz


@inline
def _square(length, px, py, pz, twist):
    """Return |[ℓω ; ṗ]|² of a twist."""
    a, b, c = twist[0], twist[1], twist[2]
    x, y, z = twist[3] + b * pz - c * py, twist[4] + c * px - a * pz, twist[5] + a * py - b * px
    return length * length * (a * a + b * b + c * c) + x * x + y * y + z * z
