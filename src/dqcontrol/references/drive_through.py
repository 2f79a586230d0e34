"""Several ways of a robot in a row, with pauses between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array
from dqcontrol.references.drive_to import PlannedWay
from dqcontrol.references.reference import NO_CORNERS
from dqcontrol.references.sample import SAMPLE_SIZE
from dqcontrol.robots import Robot

if TYPE_CHECKING:
    from dqcontrol.references.set_points import GripperStep

_SAME_PLACE = 1e-9  # rad or m


@dataclass(frozen=True, eq=False, repr=False)
class DriveThrough(PlannedWay):
    """Ways one after the other, each from where the one before it ends; `GuidedProportional` follows them as one.

    Parameters
    ----------
    ways
        At least one, of one robot.
    pauses
        How long the robot stays at the end of each, s.

    Attributes
    ----------
    begins, arrivals
        When each way begins, and ends, shape (k,), s; its rest begins then.

    Raises
    ------
    ShapeError, ValueRangeError
        If there is no way, not one rest a way, a rest is negative, or a way begins elsewhere.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> robot, start = dqc.load_robot("little-john"), [0, 0, 0, 0, -0.9, 0.9, 0.9, 0]
    >>> there = dqc.references.DriveTo(robot, start, [1, 0, 0, 0, -0.9, 0.9, 0.9, 0])
    >>> back = dqc.references.DriveTo(robot, there.goal, start)
    >>> both = DriveThrough([there, back], pauses=[2.0, 0.0])
    >>> round(both.duration - 2 * there.duration, 9)
    2.0
    """

    ways: Sequence[PlannedWay]
    pauses: Sequence[float]
    robot: Robot = field(init=False, repr=False)
    arrivals: Array = field(init=False, repr=False)
    begins: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        ways, pauses = tuple(self.ways), as_array("pauses", self.pauses)
        if not ways or pauses.shape != (len(ways),):
            raise ShapeError(f"pauses: expected {len(ways)} numbers, one a way, got {pauses.size}")
        if (pauses < 0).any():
            raise ValueRangeError(f"pauses: must be ≥ 0, got {pauses.min():g}")
        for i, (before, way) in enumerate(pairwise(ways), 1):
            apart = np.abs(way.configurations([0.0]) - before.configurations([before.duration])).max()
            if way.robot.input_names != before.robot.input_names or apart > _SAME_PLACE:
                raise ValueRangeError(f"ways[{i}]: must begin where ways[{i - 1}] ends")
        ends = np.cumsum(np.array([way.duration for way in ways]) + pauses)
        vars(self).update(robot=ways[0].robot, duration=float(ends[-1]), corners=NO_CORNERS)
        vars(self).update(arrivals=ends - pauses, begins=np.r_[0.0, ends[:-1]])

    def configurations(self, times: ArrayLike) -> Array:
        """Return the robot's configurations at times (N,), s: shape (N, n)."""
        at = as_array("times", times)
        out = np.empty((len(at), self.robot.configuration_size))
        for way, begin, here in self._shares(at):
            out[here] = way.configurations(at[here] - begin)
        return out

    def mean_inputs(self, times: ArrayLike, period: float) -> Array:
        """Return the means of the robot's inputs from times (N,), s, to a period later: shape (N, m)."""
        at = as_array("times", times)
        return sum(
            (way.mean_inputs(at - begin, period) for way, begin in zip(self.ways, self.begins, strict=True)),
            start=np.zeros((len(at), self.robot.input_size)),
        )

    def rested(self, times: Array) -> Array:
        """Return for how long the robot has been at the end of a way, s, shape (N,); not positive on the way."""
        return times - self.arrivals[self._way_of(times)]

    @property
    def gripper_steps(self) -> tuple[GripperStep, ...]:
        """Those of its ways."""
        ways = zip(self.ways, self.begins, strict=True)
        return tuple(step.later(float(begin)) for way, begin in ways for step in way.gripper_steps)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        out = np.empty((len(times), SAMPLE_SIZE))
        for way, begin, here in self._shares(times):
            out[here] = way.motion(times[here] - begin)
        return out

    def _way_of(self, times: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.begins, times, side="right") - 1, 0, len(self.ways) - 1)

    def _shares(self, times: Array) -> list[tuple[PlannedWay, float, NDArray[np.bool_]]]:
        """Return each way that some times are of, when it begins, and which they are."""
        of = self._way_of(times)
        return [(way, float(self.begins[k]), of == k) for k, way in enumerate(self.ways) if (of == k).any()]
