"""Limits on what a law may command: velocities of joints, bases and wheels, joint positions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, TypeAlias

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from dqcontrol.compiled.compile import Kernel
from dqcontrol.errors import ValueRangeError
from dqcontrol.extensions.registry import union_of
from dqcontrol.limits import rates
from dqcontrol.limits.compensation import Compensation
from dqcontrol.limits.position_limit import PositionLimit
from dqcontrol.named_fields import NamedFields
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    AnyPositionLimit: TypeAlias = PositionLimit
else:  # ours are in the file that is imported above
    AnyPositionLimit = union_of(PositionLimit, "dqcontrol.limits", loaded=True)


class CommandLimits(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is done to a law's command before it leaves.

    Parameters
    ----------
    velocity
        True: where an input exceeds the robot's velocity limit, or the rim of a wheel its rim speed, the whole
        command is scaled down, so that the end effector keeps its direction and only slows. With `ModifiedClamping`
        joints do not slow the rest: each is held at its own limit, and the others make up for it as far as they can.
        If omitted, the plant decides (see `dqcontrol.plants.limits_before`); a law prepared without a plant leaves the
        command as it is.
    position
        How joints are kept within their position limits; not at all if omitted.
    compensation
        Sag fed forward, and a disturbance observer; not together with ``position``.
    """

    spec_key: ClassVar[str] = "limits"
    velocity: Annotated[bool | None, Meta(description="scale commands to the velocity limits")] = None
    position: AnyPositionLimit | None = None
    compensation: Compensation | None = None

    @property
    def around(self) -> AnyPositionLimit | Compensation | None:
        """The stage around the law, if there is one.

        Raises
        ------
        ValueRangeError
            If two are asked for.
        """
        if self.position is not None and self.compensation is not None:
            raise ValueRangeError("limits: 'position' and 'compensation' do not go together; leave one out")
        return self.compensation if self.position is None else self.position

    def prepare(self, robot: Robot) -> tuple[Kernel, NDArray[np.float64]]:
        """Return the kernel that keeps the velocity limits, and its parameters.

        Raises
        ------
        ValueRangeError
            If the robot has no velocity limits to keep.
        """
        if not self.velocity:
            return rates.unlimited, np.zeros(0)
        if not np.isfinite(robot.limits.velocity).any():
            raise ValueRangeError(f"limits.velocity: {robot.name} has no velocity limits to keep")
        fastest, drives, rollers = robot.limits.velocity, robot.drives, robot.rollers
        if not len(rollers):
            return rates.scale_velocity, rates.speed_limits.pack(fastest=fastest, drives=drives)
        return rates.scale_velocity_on_rollers, rates.roller_speed_limits.pack(
            fastest=fastest, drive_count=len(drives), drives=drives, rollers=rollers
        )
