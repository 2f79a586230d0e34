"""Motions preferred where the task leaves freedom: u = z + J⁺(y − Jz) = J⁺y + (I − J⁺J)z."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from dqcontrol.compile import OK, READ, READ2, STATUS, WRITE, Kernel, inlined, kernel
from dqcontrol.errors import as_array, as_positive
from dqcontrol.laws.symmetric import cholesky, cholesky_solve
from dqcontrol.limits.gradient import repulsion
from dqcontrol.limits.position_limit import position_limits
from dqcontrol.robots.robot import Robot

# q, twist jacobian, parameters, work, preferred motion z
PREFERENCE = STATUS(READ, READ2, READ, WRITE, WRITE)


class NullSpace(Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A preferred motion; subclasses name a kernel of signature `PREFERENCE`."""

    kernel: ClassVar[Kernel]

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return the kernel's parameters."""
        raise NotImplementedError

    def loop_rate(self, robot: Robot) -> float | None:
        """Return how fast the free motion settles at most, 1/s; None if that depends on the configuration."""
        return None


@kernel(PREFERENCE)
def no_preference(q, twist_jacobian, parameters, work, out):
    """Leave z = 0."""
    return OK


@kernel(PREFERENCE)
def towards_posture(q, twist_jacobian, parameters, work, out):
    """Write z = −α (q − q_rest), α a number for each joint."""
    n = out.shape[0]
    for i in range(n):
        out[i] = parameters[i] * (parameters[n + i] - q[i])
    return OK


class Posture(NullSpace, frozen=True, kw_only=True, tag="posture"):
    """Drift towards a rest configuration: z = −α (q − q_rest).

    Parameters
    ----------
    gain
        α, 1/s.
    rest
        q_rest, one number a joint, rad or m; the middle of the joint's range (0 if it has none) if omitted.
    """

    kernel = towards_posture
    gain: Annotated[float, Meta(gt=0, description="1/s")]
    rest: Annotated[list[float] | None, Meta(description="rad or m")] = None

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return gains and rest configuration."""
        n = robot.configuration_size
        rates = np.full(n, as_positive("null_space.gain", self.gain))
        if self.rest is None:
            return np.concatenate([rates, middle_of_range(robot)])
        return np.concatenate([rates, as_array("null_space.rest", self.rest, (n,))])

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
        lower, upper = position_limits("null_space", robot)
        half = (upper - lower) / 2
        rates = 2 * as_positive("null_space.gain", self.gain) / (len(half) * half * half)
        return np.concatenate([rates, middle_of_range(robot)])

    def loop_rate(self, robot: Robot) -> float:
        """Return the rate of the fastest joint."""
        return float(self.parameters(robot)[: robot.configuration_size].max())


@kernel(PREFERENCE)
def away_from_limits(q, twist_jacobian, parameters, work, out):
    """Write z = −α ∇H, no joint faster than allowed."""
    n = out.shape[0]
    lower, upper = parameters[2 : 2 + n], parameters[2 + n : 2 + 2 * n]
    for i in range(n):
        gradient = 4.0 / (upper[i] - lower[i]) * repulsion(q[i], lower[i], upper[i])
        out[i] = min(max(-parameters[0] * gradient, -parameters[1]), parameters[1])
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
        gain = as_positive("null_space.gain", self.gain)
        fastest = as_positive("null_space.fastest", self.fastest)
        return np.concatenate([[gain, fastest], *position_limits("null_space", robot)])


@inlined
def _manipulability_gradient(twist_jacobian, work, out):
    """Write ∂m/∂q of m = √det(J_wJ_wᵀ) and return m: ∂m/∂qᵢ = m Σ_{j>i} (ξᵢ × ξⱼ)·(row j of J_w⁺).

    ξⱼ are the columns; for joints in a row ∂ξⱼ/∂qᵢ = ξᵢ × ξⱼ if i < j, else 0 (dual cross product). The result does
    not depend on where the inertial origin is.
    """
    n = twist_jacobian.shape[1]
    gram = work[0:36].reshape(6, 6)
    row = work[36:42]
    for i in range(6):
        for j in range(i + 1):
            value = 0.0
            for k in range(n):
                value += twist_jacobian[i, k] * twist_jacobian[j, k]
            gram[i, j] = value
    for i in range(n):
        out[i] = 0.0
    if not cholesky(gram, 6):
        return 0.0
    m = 1.0
    for i in range(6):
        m /= gram[i, i]
    for j in range(n):
        for k in range(6):
            row[k] = twist_jacobian[k, j]
        a, b, c = row[0], row[1], row[2]
        d, e, f = row[3], row[4], row[5]
        cholesky_solve(gram, 6, row)
        for i in range(j):
            x, y, z = twist_jacobian[0, i], twist_jacobian[1, i], twist_jacobian[2, i]
            u, v, w = twist_jacobian[3, i], twist_jacobian[4, i], twist_jacobian[5, i]
            out[i] += m * (
                row[0] * (y * c - z * b)
                + row[1] * (z * a - x * c)
                + row[2] * (x * b - y * a)
                + row[3] * (y * f - z * e + v * c - w * b)
                + row[4] * (z * d - x * f + w * a - u * c)
                + row[5] * (x * e - y * d + u * b - v * a)
            )
    return m


@kernel(PREFERENCE)
def towards_manipulability(q, twist_jacobian, parameters, work, out):
    """Write z = α ∂m/∂q."""
    _manipulability_gradient(twist_jacobian, work, out)
    for i in range(out.shape[0]):
        out[i] *= parameters[0]
    return OK


@kernel(STATUS(READ2, WRITE, WRITE))
def manipulability_gradient(twist_jacobian, work, out):
    """Write the gradient (n) and, last, the manipulability."""
    n = twist_jacobian.shape[1]
    out[n] = _manipulability_gradient(twist_jacobian, work, out[0:n])
    return OK


class ManipulabilityAscent(NullSpace, frozen=True, kw_only=True, tag="manipulability"):
    """Drift where the manipulability m = √det(J_wJ_wᵀ) grows: z = α ∂m/∂q. [Yoshikawa 1985]

    Parameters
    ----------
    gain
        α, 1/s; m is of the order of 0.1 for arms of 1 m, so useful gains are of the order of 10.
    """

    kernel = towards_manipulability
    gain: Annotated[float, Meta(gt=0, description="1/s")]

    def parameters(self, robot: Robot) -> NDArray[np.float64]:
        """Return the gain."""
        return np.array([as_positive("null_space.gain", self.gain)])


WORK_SIZE = 42  # what a preference needs

AnyNullSpace = Posture | ManipulabilityAscent | JointCentring | LimitAvoidance
