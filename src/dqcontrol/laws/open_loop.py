"""Open-loop resolved motion rate control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np

from dqcontrol.algebra.dual_quaternion_kernels import multiply
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.laws.growth import NO_ERROR
from dqcontrol.laws.hand_twist import solve_hand_twist, twist_work
from dqcontrol.laws.inverses import FilteredInverse, Inverse
from dqcontrol.laws.law import LAW, Law, LoopRates
from dqcontrol.laws.pose_error import hand_twist_of_rate, short_sign

if TYPE_CHECKING:
    from dqcontrol.robots import Robot


class OpenLoopWork(NamedTuple):
    """Scratch of `OpenLoop`."""

    preferred: Annotated[Array, "m"]
    rate: Annotated[Array, 8]
    half_twist: Annotated[Array, 8]
    solver: Annotated[Array, twist_work.sized("m")]


open_loop_work: MemoryLayout[OpenLoopWork] = MemoryLayout(OpenLoopWork, "m")


@kernel(LAW)
def open_loop(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write q̇ = J⁺ vec8(ẋ_d), ẋ_d = ½ξ_d x_d; the parameters are the inverse's, the state is the sign of x_d."""
    own = open_loop_work(work, out.shape[0])
    half_twist = own.half_twist
    dot = pose[0] * sample[0] + pose[1] * sample[1] + pose[2] * sample[2] + pose[3] * sample[3]
    sign = short_sign(dot, 0.0, state)
    half_twist[0], half_twist[4] = 0.0, 0.0
    for i in range(3):
        half_twist[1 + i] = 0.5 * sign * sample[8 + i]
        half_twist[5 + i] = 0.5 * sign * sample[11 + i]
    multiply(half_twist, sample, own.rate)
    twist = hand_twist_of_rate(own.rate, pose)
    return solve_hand_twist(pose, twist_jacobian, twist, NO_ERROR, own.preferred, parameters, own.solver, out)


class OpenLoop(Law, frozen=True, kw_only=True, tag="open-loop"):
    """Resolved motion rate control without feedback: q̇ = J⁺ vec8(ẋ_d). [P16 2.10–2.13]

    The errors of integration, joints and start are never corrected: the end effector drifts. For comparison only.

    Sampling limits: none, as there is no loop; the error of integration grows with T.

    Parameters
    ----------
    inverse
        How J is inverted; the default is exact away from singularities.
    null_space
        Motion preferred where the task leaves freedom.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> arm, q = dqc.load_robot("iiwa7"), np.array([0, 0.6, 0, 1.6, 0, 0.6, 0])
    >>> twist = arm.twist_jacobian(q) @ np.full(7, 0.1)
    >>> u = dqc.laws.OpenLoop().command(arm, q, dqc.Sample(arm.fkm(q), twist), period=0.01)
    >>> np.allclose(arm.twist_jacobian(q) @ u, twist)
    True
    """

    kernel = open_loop
    work = open_loop_work
    inverse: Inverse = FilteredInverse()

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return the inverse's parameters."""
        return np.array([self.inverse.parameters()])

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return zeros: no error is corrected."""
        return LoopRates(position=np.zeros(len(parameters)), orientation=np.zeros(len(parameters)))
