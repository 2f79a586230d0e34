"""Proportional control along a planned way: the plan's inputs, and feedback of what is missing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

import numpy as np
from msgspec import Meta

from dqcontrol.compile import inlined, kernel
from dqcontrol.errors import Error, as_positive
from dqcontrol.laws.law import LAW, check_steps
from dqcontrol.laws.pose_error import left_error, solve_left_error
from dqcontrol.laws.pose_law import GAIN, HYSTERESIS, PoseLaw
from dqcontrol.laws.sideways import drive_table
from dqcontrol.references.drive_to import DriveTo
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

_PULL = GAIN + 8  # then the drives, q_r and u_r


@inlined
def towards(planned, q, pull, drives, out):
    """Write z = α Gᵀ (q_r − q) with q̇ = G u; headings of drives count modulo a turn."""
    i, k = 0, 0
    for j in range(out.shape[0]):
        if k < drives.shape[0] and int(drives[k, 0]) == j:
            x, y = planned[i] - q[i], planned[i + 1] - q[i + 1]
            out[j] = pull * (x * math.cos(q[i + 2]) + y * math.sin(q[i + 2]))
            i += 2
        elif k < drives.shape[0] and int(drives[k, 0]) == j - 1:
            turn = planned[i] - q[i]
            out[j] = pull * math.atan2(math.sin(turn), math.cos(turn))
            i, k = i + 1, k + 1
        else:
            out[j] = pull * (planned[i] - q[i])
            i += 1


@kernel(LAW)
def guided_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write u = u_r + z + N⁺ (K vec8(e) − N z)."""
    n, m = q.shape[0], out.shape[0]
    last = parameters.shape[0] - n - m
    drives = parameters[_PULL + 1 : last].reshape((last - _PULL - 1) // 2, 2)
    towards(parameters[last : last + n], q, parameters[_PULL], drives, work[0:m])
    own = work[m:]
    error, target = own[0:8], own[8:16]
    sign = left_error(pose, sample, parameters[HYSTERESIS], state, error)
    for i in range(8):
        target[i] = parameters[GAIN + i] * error[i]
    status = solve_left_error(
        target, error, pose, pose_jacobian, twist_jacobian, sample, sign, parameters, work, out
    )
    for i in range(m):
        out[i] += parameters[last + n + i]
    return status


class GuidedProportional(PoseLaw, frozen=True, kw_only=True, tag="guided-proportional"):
    """K for goals anywhere, along a `DriveTo` reference: u = u_r + z + N⁺ (K vec8(e) − N z), z = α Gᵀ (q_r − q).

    u_r are the planned inputs of the robot, their means from each sample to the next, and q_r are the planned
    configurations; G are the directions that inputs give them, q̇ = G u. On its way e = 1 − x*x_d is 0 and u = u_r
    whatever J is: the twist asked for, J u_r, lies in the range of J by construction. So singularities are passed as
    planned, joints stay within their limits, and the command starts from rest. Feedback only has to remove what
    disturbs: the hand's error as in `Proportional`, and in what the hand leaves free that of the configuration.

    Choice: laws without a plan are for goals that move, or change while the robot drives. k as for `Proportional`.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, or eight diagonal entries.
    inverse
        How N is inverted; the default is exact away from singularities.
    hysteresis
        How far Re(x*x_d) must pass 0 before the sign of x_d changes.
    pull
        α, 1/s.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    >>> goal = robot.fkm([-0.5, 1.0, 3.0, 0.5, -0.5, 0.5, 0.5, 0])  # beside and behind
    >>> way = dqc.references.DriveTo.pose(robot, start, goal)
    >>> law, plant = dqc.laws.GuidedProportional(gain=1.0), dqc.plants.Integrator()
    >>> bool(dqc.simulate(robot, way, law, plant, start, period=0.05).error.max() < 1e-3)
    True
    """

    kernel = guided_proportional
    null_space: None = None
    pull: Annotated[float, Meta(gt=0, description="1/s")] = 1.0

    def rows(self, robot: Robot, reference: Reference | None, dt: float) -> np.ndarray:
        """Return inverse, hysteresis, gains, pull and drives, and the plan at each sample.

        Raises
        ------
        Error
            If the reference is no `DriveTo` of this robot.
        """
        if not isinstance(reference, DriveTo) or reference.robot.input_names != robot.input_names:
            raise Error(f"law: guided-proportional follows a drive-to reference, planned for {robot.name}")
        if self.null_space is not None:
            raise Error("null_space: leave it out, guided-proportional follows its plan")
        steps = math.ceil(reference.duration / dt) + 1
        check_steps("plan", steps)
        times = dt * np.arange(steps)
        own = self.parameter_rows(robot, times)
        head = [as_positive("pull", self.pull), *drive_table(robot).ravel()]
        plan = reference.configurations(times), reference.mean_inputs(times, dt)
        return np.hstack([np.broadcast_to(own, (steps, own.shape[1])), np.tile(head, (steps, 1)), *plan])
