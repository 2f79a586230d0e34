"""Motions preferred where the task leaves freedom: u = z + J⁺(y − Jz) = J⁺y + (I − J⁺J)z."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.algebra.symmetric import cholesky, cholesky_solve
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import INPUT, OK, READ, READ2, STATUS, WRITE, Kernel, inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import as_array
from dqcontrol.limits.position_limit import position_limits, repulsion
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.kinematics.driving import DRIVE_COLUMNS
from dqcontrol.robots.robot import Robot, base_coordinates

_REGULAR = 1e-9  # share of the trace that makes a Gram matrix of less than full rank invertible


class HeadingWork(NamedTuple):
    """Scratch of `turn_to_best_heading`."""

    gram: Annotated[Array, 6, 6]
    column: Annotated[Array, 6]


heading_work: MemoryLayout[HeadingWork] = MemoryLayout(HeadingWork)


@inline
def _gram_without(twist_jacobian, left_out, center, gram):
    """Write the lower triangle of Σ ξξᵀ over all columns but one, moved to a center, slightly regularised."""
    ox, oy, oz = center
    for i in range(6):
        for j in range(i + 1):
            gram[i, j] = 0.0
    trace = 0.0
    for c in range(twist_jacobian.shape[1]):
        if c == left_out:
            continue
        a, b, e = twist_jacobian[0, c], twist_jacobian[1, c], twist_jacobian[2, c]
        column = (
            a,
            b,
            e,
            twist_jacobian[3, c] - (oy * e - oz * b),
            twist_jacobian[4, c] - (oz * a - ox * e),
            twist_jacobian[5, c] - (ox * b - oy * a),
        )
        for i in range(6):
            trace += column[i] * column[i]
            for j in range(i + 1):
                gram[i, j] += column[i] * column[j]
    for i in range(6):
        gram[i, i] += _REGULAR * trace


@inline
def turn_to_best_heading(twist_jacobian, j, work):
    """Return the angle, −π/2 … π/2, from the heading of the drive with input v at j to the best one.

    With G = Σ ξξᵀ over all columns but v and c = [0 ; h], det(JJᵀ) = det G (1 + cᵀG⁻¹c): the best heading h is the
    principal axis of the horizontal part of G⁻¹. Forwards and backwards are the same.
    """
    own = heading_work(work)
    gram, column = own.gram, own.column
    ax, ay, az = twist_jacobian[0, j + 1], twist_jacobian[1, j + 1], twist_jacobian[2, j + 1]
    mx, my, mz = twist_jacobian[3, j + 1], twist_jacobian[4, j + 1], twist_jacobian[5, j + 1]
    hx, hy, hz = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
    sx, sy, sz = ay * hz - az * hy, az * hx - ax * hz, ax * hy - ay * hx
    axle = ay * mz - az * my, az * mx - ax * mz, ax * my - ay * mx
    _gram_without(twist_jacobian, j, axle, gram)
    if not cholesky(gram, 6):
        return 0.0
    for i in range(3):
        column[i] = 0.0
    column[3], column[4], column[5] = hx, hy, hz
    cholesky_solve(gram, 6, column)
    along = hx * column[3] + hy * column[4] + hz * column[5]
    mixed = sx * column[3] + sy * column[4] + sz * column[5]
    for i in range(3):
        column[i] = 0.0
    column[3], column[4], column[5] = sx, sy, sz
    cholesky_solve(gram, 6, column)
    across = sx * column[3] + sy * column[4] + sz * column[5]
    return 0.5 * math.atan2(2.0 * mixed, along - across)


# q, twist jacobian, parameters, work, preferred motion z
PREFERENCE = STATUS(INPUT, READ2, READ, WRITE, WRITE)


class NullSpace(NamedFields, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A preferred motion; subclasses name a kernel of signature `PREFERENCE`."""

    spec_key: ClassVar[str] = "null_space"
    kernel: ClassVar[Kernel]

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return the kernel's parameters."""
        raise NotImplementedError

    def loop_rate(self, robot: Robot) -> float | None:
        """Return how fast the free motion settles at most, 1/s; None if that depends on the configuration."""
        return None


class PostureParameters(NamedTuple):
    """What compiled code knows of `Posture`: a gain for each coordinate, q_rest, and the robot's drives."""

    pull: Annotated[Array, "n"]
    rest: Annotated[Array, "n"]
    drives: Annotated[Array, ..., DRIVE_COLUMNS]


posture_parameters: MemoryLayout[PostureParameters] = MemoryLayout(PostureParameters, "n")


@kernel(PREFERENCE)
def towards_posture(q, twist_jacobian, parameters, work, out):
    """Write z = −Gᵀ α (q − q_rest), α a number for each coordinate, q̇ = G u."""
    n = q.shape[0]
    given = posture_parameters(parameters, n)
    pull, rest, drives = given.pull, given.rest, given.drives
    kept = out.shape[0] == n
    i, j = 0, 0
    for k in range(0 if kept else drives.shape[0]):
        first = int(drives[k, 0])
        while i < first:
            out[j] = pull[i] * (rest[i] - q[i])
            i, j = i + 1, j + 1
        x, y = pull[i] * (rest[i] - q[i]), pull[i + 1] * (rest[i + 1] - q[i + 1])
        out[j] = x * math.cos(q[i + 2]) + y * math.sin(q[i + 2])
        i, j = i + 2, j + 1
    while i < n:
        out[j] = pull[i] * (rest[i] - q[i])
        i, j = i + 1, j + 1
    return OK


class Posture(NullSpace, frozen=True, kw_only=True, tag="posture"):
    """Drift towards a rest configuration: z = −α (q − q_rest).

    The v of a drive takes what of that lies along its heading; so z descends |q − q_rest|² there too.

    Parameters
    ----------
    gain
        α, 1/s.
    rest
        q_rest, one number a coordinate, rad or m; if omitted, the middle of each joint's range (0 if it has none), and
        mobile bases are left alone.
    """

    kernel = towards_posture
    gain: Annotated[float, Meta(gt=0, description="1/s")]
    rest: Annotated[list[float] | None, Meta(description="rad or m")] = None

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return gains and rest configuration."""
        n = robot.configuration_size
        rates = np.full(n, self.gain)
        if self.rest is None:
            rates[base_coordinates(robot)] = 0.0
            rest = middle_of_range(robot)
        else:
            rest = as_array("null_space.rest", self.rest, (n,))
        return posture_parameters.pack(pull=rates, rest=rest, drives=robot.drives)

    def loop_rate(self, robot: Robot) -> float:
        """Return α."""
        return self.gain


def middle_of_range(robot: Robot) -> NDArray[np.float64]:
    """Return the middle of each joint's range, 0 where it has none."""
    lower, upper = robot.limits.lower, robot.limits.upper
    bounded = np.isfinite(lower) & np.isfinite(upper)
    return (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2


class JointCentring(NullSpace, frozen=True, kw_only=True, tag="joint-centring"):
    """Drift towards the middle of the joints' ranges: z = −α ∇H, H = 1/n Σ ((qᵢ − q̄ᵢ)/(q̄ᵢ − qmaxᵢ))². [Liégeois 1977]

    q̄ᵢ is the middle of joint i's own range (the print has no index). It avoids limits where the task leaves freedom and
    guarantees nothing: H stays finite at a limit. Joints without both limits are passed over.

    Parameters
    ----------
    gain
        α, rad²/s; the rate of joint i is 2α/(n hᵢ²), hᵢ half its range.
    """

    kernel = towards_posture
    gain: Annotated[float, Meta(gt=0, description="rad²/s")]

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return rates and middles."""
        position_limits("null_space", robot)
        half = (robot.limits.upper - robot.limits.lower) / 2
        rates = 2 * self.gain / (len(half) * half * half)
        return posture_parameters.pack(pull=rates, rest=middle_of_range(robot), drives=robot.drives)

    def loop_rate(self, robot: Robot) -> float:
        """Return the rate of the fastest joint."""
        return float(posture_parameters(self.parameters(robot), robot.configuration_size).pull.max())


class AvoidanceParameters(NamedTuple):
    """What compiled code knows of `LimitAvoidance`: α, the largest speed, and limits as `position_limits` has them."""

    gain: float
    fastest: float
    lower: Annotated[Array, "m"]
    upper: Annotated[Array, "m"]
    coordinate: Annotated[Array, "m"]


avoidance_parameters: MemoryLayout[AvoidanceParameters] = MemoryLayout(AvoidanceParameters, "m")


@kernel(PREFERENCE)
def away_from_limits(q, twist_jacobian, parameters, work, out):
    """Write z = −α ∇H, no joint faster than allowed."""
    given = avoidance_parameters(parameters, out.shape[0])
    lower, upper = given.lower, given.upper
    for i in range(out.shape[0]):
        gradient = 4.0 / (upper[i] - lower[i]) * repulsion(q[int(given.coordinate[i])], lower[i], upper[i])
        out[i] = min(max(-given.gain * gradient, -given.fastest), given.fastest)
    return OK


class LimitAvoidance(NullSpace, frozen=True, kw_only=True, tag="limit-avoidance"):
    """Drift away from joint limits: z = −α ∇H, H = Σ Rᵢ/((qmaxᵢ − qᵢ)(qᵢ − qminᵢ)), Rᵢ = qmaxᵢ − qminᵢ. [Zghal 1990]

    H is as S17 2.4 prints it, in 1/rad; usual is R²/4 in place of R, which makes it 1 for a joint in the middle of its
    range. Its gradient grows without bound towards a limit, so the preferred speed of each joint is cut off at
    ``fastest``, also at and beyond its limits. It avoids limits where the task leaves freedom and guarantees nothing:
    the task comes first. Joints without both limits are passed over.

    Parameters
    ----------
    gain
        α, rad³/s.
    fastest
        Largest preferred speed of a joint, rad/s or m/s.
    """

    kernel = away_from_limits
    gain: Annotated[float, Meta(gt=0, description="rad³/s")]
    fastest: Annotated[float, Meta(gt=0, description="rad/s or m/s")] = 0.5

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return gain, largest speed and limits."""
        limits = position_limits("null_space", robot)
        return avoidance_parameters.pack(gain=self.gain, fastest=self.fastest, **limits._asdict())


@inline
def _carried(twist_jacobian, row, i, j):
    """Return (ξᵢ × ξⱼ)·row, the change of column j along input i where that carries it."""
    a, b, c = twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j]
    d, e, f = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
    x, y, z = twist_jacobian[0, i], twist_jacobian[1, i], twist_jacobian[2, i]
    u, v, w = twist_jacobian[3, i], twist_jacobian[4, i], twist_jacobian[5, i]
    return (
        row[0] * (y * c - z * b)
        + row[1] * (z * a - x * c)
        + row[2] * (x * b - y * a)
        + row[3] * (y * f - z * e + v * c - w * b)
        + row[4] * (z * d - x * f + w * a - u * c)
        + row[5] * (x * e - y * d + u * b - v * a)
    )


# rad or m: where all joints are moved by this, the gradient is taken instead of at a singularity
_BESIDE = 1e-3


@inline
def _column(twist_jacobian, j, before, beside, out):
    """Write ξⱼ where all inputs are moved by ``beside``: ξⱼ + beside (Σ_{i<j} ξᵢ) × ξⱼ; add ξⱼ to the sum before it."""
    a, b, c = twist_jacobian[0, j], twist_jacobian[1, j], twist_jacobian[2, j]
    d, e, f = twist_jacobian[3, j], twist_jacobian[4, j], twist_jacobian[5, j]
    x, y, z, u, v, w = before[0], before[1], before[2], before[3], before[4], before[5]
    out[0] = a + beside * (y * c - z * b)
    out[1] = b + beside * (z * a - x * c)
    out[2] = c + beside * (x * b - y * a)
    out[3] = d + beside * (y * f - z * e + v * c - w * b)
    out[4] = e + beside * (z * d - x * f + w * a - u * c)
    out[5] = f + beside * (x * e - y * d + u * b - v * a)
    before[0], before[1], before[2], before[3], before[4], before[5] = (
        x + a,
        y + b,
        z + c,
        u + d,
        v + e,
        w + f,
    )


@inline
def _factored_gram(twist_jacobian, beside, gram, row, before):
    """Write the Cholesky factor of J_wJ_wᵀ; return False where it has none."""
    for i in range(6):
        before[i] = 0.0
        for j in range(i + 1):
            gram[i, j] = 0.0
    for k in range(twist_jacobian.shape[1]):
        _column(twist_jacobian, k, before, beside, row)
        for i in range(6):
            for j in range(i + 1):
                gram[i, j] += row[i] * row[j]
    return cholesky(gram, 6)


class HeadingParameters(NamedTuple):
    """What compiled code knows of `ManipulabilityAscent` and `BestHeading`: α, and which inputs are v of drives."""

    gain: float
    drives: Annotated[Array, ...]


class AscentWork(NamedTuple):
    """Scratch of `ManipulabilityAscent`: the factor of J_wJ_wᵀ, a column, and the sum of those before it."""

    gram: Annotated[Array, 6, 6]
    row: Annotated[Array, 6]
    before: Annotated[Array, 6]


heading_parameters: MemoryLayout[HeadingParameters] = MemoryLayout(HeadingParameters)
ascent_work: MemoryLayout[AscentWork] = MemoryLayout(AscentWork)


@kernel(PREFERENCE)
def towards_manipulability(q, twist_jacobian, parameters, work, out):
    """Write z = α ∂m/∂q of m = √det(J_wJ_wᵀ): ∂m/∂qᵢ = m Σ_{j>i} (ξᵢ × ξⱼ)·(row j of J_w⁺).

    ξⱼ are the columns; for joints in a row ∂ξⱼ/∂qᵢ = ξᵢ × ξⱼ if i < j, else 0 (dual cross product). The ω of a drive
    turns also the column of its v, which comes before. The result does not depend on where the inertial origin is.
    In a singular configuration m has a kink, and every direction of its null space leads up: the gradient is that of a
    configuration beside it.
    """
    n = twist_jacobian.shape[1]
    given = heading_parameters(parameters)
    own, headings = ascent_work(work), given.drives
    gram, row, before = own.gram, own.row, own.before
    for i in range(n):
        out[i] = 0.0
    beside = 0.0
    if not _factored_gram(twist_jacobian, beside, gram, row, before):
        beside = _BESIDE
        if not _factored_gram(twist_jacobian, beside, gram, row, before):
            return OK
    m = 1.0
    for i in range(6):
        m /= gram[i, i]
        before[i] = 0.0
    passed = 0
    for j in range(n):
        _column(twist_jacobian, j, before, beside, row)
        for k in range(6):
            row[k] *= given.gain * m
        cholesky_solve(gram, 6, row)
        for i in range(j):
            out[i] += _carried(twist_jacobian, row, i, j)
        if passed < headings.shape[0] and int(headings[passed]) == j:
            out[j + 1] += _carried(twist_jacobian, row, j + 1, j)
            passed += 1
    return OK


class ManipulabilityAscent(NullSpace, frozen=True, kw_only=True, tag="manipulability"):
    """Drift where the manipulability m = √det(J_wJ_wᵀ) grows: z = α ∂m/∂q. [Yoshikawa 1985]

    It also leads out of singular configurations, where laws stand still if the end effector is wanted in the direction
    that is lost: an arm that is stretched and should draw its end effector straight in.

    Parameters
    ----------
    gain
        α, 1/s; m is of the order of 0.1 for arms of 1 m, so useful gains are of the order of 10.
    """

    kernel = towards_manipulability
    gain: Annotated[float, Meta(gt=0, description="1/s")]

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return the gain, and which inputs are forward speeds of drives."""
        return heading_parameters.pack(gain=self.gain, drives=_headings(robot))


def _headings(robot: Robot) -> NDArray[np.intp]:
    """Return which inputs are forward speeds of drives."""
    if robot.input_size == robot.configuration_size:
        return np.zeros(0, dtype=np.intp)
    return np.flatnonzero(np.isin(robot.input_coordinates, robot.drives[:, 0]))


@kernel(PREFERENCE)
def towards_best_heading(q, twist_jacobian, parameters, work, out):
    """Write ω = α (angle to the best heading) for each drive, 0 elsewhere."""
    given = heading_parameters(parameters)
    for i in range(out.shape[0]):
        out[i] = 0.0
    for k in range(given.drives.shape[0]):
        j = int(given.drives[k])
        out[j + 1] = given.gain * turn_to_best_heading(twist_jacobian, j, work)
    return OK


class BestHeading(NullSpace, frozen=True, kw_only=True, tag="best-heading"):
    """Turn differential drives to where their forward motion adds most to what the end effector can do: ω = α δ.

    Of all headings h of a drive, with the other columns as they are, δ (−π/2 … π/2) leads to the one with the largest
    det(JJᵀ), in closed form; forwards and backwards are the same. Where an arm can turn against its base, the end
    effector does not notice, and J loses rank only where no heading could help. Without it a base faces as it happens
    to, and laws end in singularities where the drive pushes along the arm's plane while the end effector should move
    across it. Robots without drives, and bodies in the unconstrained form, are left as they are.

    Parameters
    ----------
    gain
        α, 1/s.
    """

    kernel = towards_best_heading
    gain: Annotated[float, Meta(gt=0, description="1/s")] = 2.0

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return the gain and the input v of each drive."""
        return heading_parameters.pack(gain=self.gain, drives=_headings(robot))


WORK_SIZE = max(ascent_work.size(), heading_work.size())  # what a preference needs

AnyNullSpace = Posture | ManipulabilityAscent | JointCentring | LimitAvoidance | BestHeading
