"""Paths of the end effector between plans: with the configurations that follow them, known before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.constraints.prepared_constraints import PreparedConstraints
from dqcontrol.errors import PlanError, ValueRangeError, as_array
from dqcontrol.planning.branches import continued
from dqcontrol.planning.certified_edges import CertifiedEdges
from dqcontrol.planning.standing_base import standing_at
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.gripping import GripperStep
from dqcontrol.references.reference import Reference
from dqcontrol.references.sample import POSE
from dqcontrol.robots import Robot

_SAME_POSE = 1e-6  # as in a sequence


@dataclass(frozen=True, eq=False, repr=False)
class FollowedPath(PlannedWay):
    """A motion of the end effector, and the configurations that follow it; see `followed`.

    Parameters
    ----------
    reference, robot
        What is followed, and by whom.
    knots
        Configurations at multiples of a period, shape (K, n), rad or m; edges between them are straight.
    period
        s.
    """

    reference: Reference
    robot: Robot
    knots: Array
    period: float
    duration: float = field(init=False)
    corners: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "duration", self.reference.duration)
        object.__setattr__(self, "corners", self.reference.corners)

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """Those of the reference."""
        return self.reference.gripper_steps

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        at, numbers = as_array("times", times) / self.period, np.arange(len(self.knots))
        return np.column_stack([np.interp(at, numbers, column) for column in self.knots.T])

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        begins = as_array("times", times)
        moved = self.configurations(begins + period) - self.configurations(begins)
        return moved[:, self.robot.input_coordinates] / period

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return self.reference.samples(times)


def followed(reference: Reference, kept: PreparedConstraints, q: Array, where: str) -> FollowedPath:
    """Return how a robot follows a motion from a configuration, (n,): each edge proved to keep the constraints.

    Raises
    ------
    PlanError
        If the motion stops somewhere (reason ``path``): at which sample, why.
    ValueRangeError
        If it never ends, starts elsewhere, or ends where something is touched.
    """
    if not math.isfinite(reference.duration):
        raise ValueRangeError(f"{where}: never ends; give its duration")
    if reference.guards.moves:
        raise ValueRangeError(
            f"{where}: 'until' and 'touch' are in no sequence that is planned: nobody knows its end"
        )
    robot, period = kept.robot, kept.period
    times = period * np.arange(math.ceil(reference.duration / period - 1e-9) + 1)
    poses, hand = reference.samples(times)[:, POSE], robot.fkm(q)
    if min(np.abs(poses[0] - hand).max(), np.abs(poses[0] + hand).max()) > _SAME_POSE:
        raise ValueRangeError(f"{where}: must start where the step before it ends")
    if np.abs(poses - poses[0]).max() == 0.0:
        return FollowedPath(reference, robot, np.array([q, q]), period)
    edges = CertifiedEdges(standing_at(robot, q), kept).eased_at(q)
    found = continued(edges, q, poses)
    if found.why:
        at = len(found.configurations)
        raise PlanError(
            f"{where}: stops at sample {at} of {len(poses)}: {found.why}", "path", pair=found.pair, sample=at
        )
    return FollowedPath(reference, robot, found.configurations, period)
