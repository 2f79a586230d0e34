"""The hand's motion along a plan, timed so that a law that keeps the same constraints lets it pass."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array, as_positive
from dqcontrol.planning.kept_timing import Timing, kept_timing
from dqcontrol.planning.plan import Plan
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.reference import NO_CORNERS
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE
from dqcontrol.robots import Robot

_RAMP = 0.5  # s: no input reaches its full speed sooner, where nothing says how fast it may


@dataclass(frozen=True, eq=False, repr=False)
class PlanTo(PlannedWay):
    """The hand's motion while its robot goes a planned way; `laws.GuidedProportional` follows it.

    Speeds and accelerations along the way are the largest that limits allow [Pham and Pham 2018], and no distance d
    that is kept shrinks faster than ρ η (d − kept): so a law that keeps the same constraints has nothing to brake.

    Parameters
    ----------
    plan
        From `plan`.
    speed_fraction
        The most that is used of the limits of velocities and accelerations, 0 … 1. Where constraints limit no
        acceleration, an input takes 0.5 s to its full speed.
    approach
        ρ, 0 … 1.

    Attributes
    ----------
    duration
        s.

    Raises
    ------
    ValueRangeError
        If a share is no share, or an input has no velocity limit.
    MissingExtraError
        If TOPP-RA is not installed.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, start, goal = dqc.load_robot("panda"), [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [1.5, -0.8, 0, -2.4, 0, 1.6, 0.8]
    >>> post = dqc.world.Body(capsule=(0.05, 1.0), position=(0.4, 0.3, 0.5))
    >>> keep = dqc.constraints.Constraints(world=dqc.World(bodies={"post": post}), clear_of="all", acceleration=10)
    >>> law = dqc.laws.GuidedProportional(gain=2.0, constraints=keep)
    >>> way = dqc.planning.PlanTo(dqc.planning.plan(arm, keep, start, goal))
    >>> record = dqc.simulate(arm, way, law, dqc.plants.Integrator(), start, period=0.01)
    >>> bool(abs(record.q - way.configurations(record.time)).max() < 1e-6)
    True
    """

    kind = "plan-to"

    plan: Plan
    speed_fraction: float = 0.9
    approach: float = 0.9
    robot: Robot = field(init=False, repr=False)
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    timing: Timing = field(init=False, repr=False)

    def __post_init__(self) -> None:
        robot, kept = self.plan.robot, self.plan.kept
        fraction, approach = _share("speed_fraction", self.speed_fraction), _share("approach", self.approach)
        velocity = robot.limits.velocity
        if np.isinf(velocity).any():
            name = robot.input_names[int(np.isinf(velocity).argmax())]
            raise ValueRangeError(f"robot: {name} of {robot.name} has no velocity limit to plan with")
        asked = robot.acceleration_limits("constraints.acceleration", kept.given.acceleration)
        acceleration = np.minimum(asked, velocity / _RAMP)
        place = np.empty(robot.configuration_size, dtype=int)
        place[robot.input_coordinates] = np.arange(robot.input_size)
        timing = kept_timing(
            self.plan.way, kept, fraction * velocity[place], fraction * acceleration[place], approach
        )
        values = {
            "robot": robot,
            "duration": float(timing.times[-1]),
            "corners": NO_CORNERS,
            "timing": timing,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        return self.plan.way.at(self.timing.at(as_array("times", times))[0])[0]

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        moved = self.configurations(begins + period) - self.configurations(begins)
        return moved[:, self.robot.input_coordinates] / period

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        length, speed, rate = self.timing.at(times)
        q, along, bend = self.plan.way.at(length)
        inputs = self.robot.input_coordinates
        u = (along * speed[:, None])[:, inputs]
        change = (bend * speed[:, None] ** 2 + along * rate[:, None])[:, inputs]
        jacobian, turns = self.robot.twist_jacobian(q), self.robot.twist_jacobian_derivative(q, u)
        out = np.zeros((len(times), SAMPLE_SIZE))
        out[:, POSE] = self.robot.fkm(q)
        out[:, TWIST] = np.einsum("kij,kj->ki", jacobian, u)
        out[:, TWIST_RATE] = np.einsum("kij,kj->ki", jacobian, change) + np.einsum("kij,kj->ki", turns, u)
        return out


def _share(field_name: str, value: float) -> float:
    share = as_positive(field_name, value)
    if share > 1:
        raise ValueRangeError(f"{field_name}: must be ≤ 1, got {share:g}")
    return share
