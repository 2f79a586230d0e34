"""Proportional control along a planned way: the plan's inputs, and feedback of what is missing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import inline, kernel
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import Error
from dqcontrol.laws.desired_twist import drive_table
from dqcontrol.laws.inverses import inverse_parameters
from dqcontrol.laws.law import LAW, check_steps
from dqcontrol.laws.pose_error import left_error, solve_left_error
from dqcontrol.laws.pose_law import PoseLaw, pose_parameters
from dqcontrol.laws.proportional import proportional_work
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

# How sharply a drive beside its line turns towards it, 1/m²: along it, y″ + (α/v) y′ + 4 y = 0 brings it back with
# 2 rad/m, and without overshoot as long as v ≤ α/4.
_STEERING = 4.0
_HANDOVER = 1.0  # s


class PlanParameters(NamedTuple):
    """What compiled code knows of the law at a sample, for n coordinates and m inputs.

    Attributes
    ----------
    pull, share
        α and w.
    drives
        Table of the drives, see `drive_table`.
    planned, inputs
        q_r and u_r.
    """

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]
    pull: float
    share: float
    drives: Annotated[Array, "n - m", 2]
    planned: Annotated[Array, "n"]
    inputs: Annotated[Array, "m"]


plan_parameters: MemoryLayout[PlanParameters] = MemoryLayout(PlanParameters, "n", "m")


@inline
def along_plan(q, planned, inputs, pull, drives, out):
    """Write what drives and joints add to their planned inputs so as to come back to their plan."""
    i, k = 0, 0
    for j in range(out.shape[0]):
        if k < drives.shape[0] and int(drives[k, 0]) == j:
            x, y, turn = planned[i] - q[i], planned[i + 1] - q[i + 1], planned[i + 2] - q[i + 2]
            c, s = math.cos(q[i + 2]), math.sin(q[i + 2])
            out[j] = pull * (x * c + y * s)
            out[j + 1] = pull * math.sin(turn) + _STEERING * inputs[j] * (y * c - x * s)
            i, k = i + 3, k + 1
        elif k == 0 or int(drives[k - 1, 0]) != j - 1:
            out[j] = pull * (planned[i] - q[i])
            i += 1


@kernel(LAW)
def guided_proportional(q, pose, pose_jacobian, twist_jacobian, sample, parameters, state, work, out):
    """Write u = u_r + z + w N⁺ (K vec8(e) − N z)."""
    m = out.shape[0]
    given, own = plan_parameters(parameters, q.shape[0], m), proportional_work(work, m)
    along_plan(q, given.planned, given.inputs, given.pull, given.drives, own.preferred)
    left_error(pose, sample, given.hysteresis, state, own.error)
    for i in range(8):
        own.target[i] = given.gain[i] * own.error[i]
    status = solve_left_error(
        own.target, own.error, pose, twist_jacobian, sample, own.preferred, given.inverse, own.solver, out
    )
    for i in range(m):
        out[i] = given.inputs[i] + given.share * out[i] + (1.0 - given.share) * own.preferred[i]
    return status


class GuidedProportional(PoseLaw, frozen=True, kw_only=True, tag="guided-proportional"):
    """K for goals anywhere, along `DriveTo` or `planning.PlanTo`: u = u_r + z + w N⁺ (K vec8(1 − x*x_d) − N z).

    u_r are the planned inputs of the robot, their means from each sample to the next. z leads back to the planned
    configuration q_r: α (q_r − q) for joints, and for drives, whose plan is e_x ahead, e_y to the left and turned by
    e_φ, v = α e_x and ω = α sin e_φ + 4/m² v_r e_y [Kanayama 1990]. w is 0 on the way and grows to 1 in the second
    after it: then z moves only what the end effector leaves free, and the end effector's error is removed as by
    `Proportional`.

    So what is asked of the end effector on the way, J (u_r + z), lies in the range of J by construction: singularities
    are passed as planned, joints stay within their limits, and the command starts from rest, however far the goal. Only
    the rest of the error, at a goal configuration that was chosen far from singularities, is left to N⁺.

    Choice: laws without a plan are for goals that move, or change while the robot drives. k as for `Proportional`.

    Parameters
    ----------
    gain
        K in 1/s: a number k for kI, or eight diagonal entries.
    inverse
        How J is inverted; the default is exact away from singularities.
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
    work = proportional_work
    null_space: None = None
    pull: Annotated[float, Meta(gt=0, description="1/s")] = 1.0

    def rows(self, robot: Robot, reference: Reference | None, period: float) -> np.ndarray:
        """Return inverse, hysteresis, gains, pull, the end effector's share, drives, and the plan at each sample.

        Raises
        ------
        Error
            If the reference is no `DriveTo`, `DriveThrough` or `planning.PlanTo` of this robot.
        """
        if not isinstance(reference, PlannedWay) or reference.robot.input_names != robot.input_names:
            raise Error(
                f"law: guided-proportional follows a drive-to or plan-to reference, planned for {robot.name}"
            )
        if self.null_space is not None:
            raise Error("null_space: leave it out, guided-proportional follows its plan")
        steps = math.ceil((reference.duration + _HANDOVER) / period) + 1
        check_steps("plan", steps)
        times = period * np.arange(steps, dtype=np.float64)
        return plan_parameters.pack(
            **pose_parameters(self.parameter_rows(robot, times))._asdict(),
            pull=self.pull,
            share=np.clip(reference.rested(times) / _HANDOVER, 0.0, 1.0),
            drives=drive_table(robot),
            planned=reference.configurations(times),
            inputs=reference.mean_inputs(times, period),
        )
