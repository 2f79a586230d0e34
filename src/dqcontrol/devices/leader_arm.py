"""A leader arm: an arm that somebody moves by hand, and whose end effector the robot's follows."""

from __future__ import annotations

import time
from collections.abc import Callable

from numpy.typing import ArrayLike

from dqcontrol.devices.teleoperation import Told
from dqcontrol.errors import Error, as_array
from dqcontrol.robots import Robot


class LeaderArm:
    """An `Input`: the pose that a leader arm's joint angles give. The follower may be any other robot.

    Parameters
    ----------
    robot
        The leader.
    joints
        Called for its configuration, shape (n,), rad or m; returns None while there is none.
    clutch
        Called for whether it drives; always if omitted.
    gripper
        Called for how far its gripper is closed, 0 … 1; it has none if omitted.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> leader = LeaderArm(dqc.load_robot("youbot-arm"), lambda: [0.1, 0.2, 0.3, 0.4, 0.5])
    >>> leader.read().pose.shape
    (8,)
    """

    def __init__(
        self,
        robot: Robot,
        joints: Callable[[], ArrayLike | None],
        *,
        clutch: Callable[[], bool] = lambda: True,
        gripper: Callable[[], float] = lambda: float("nan"),
    ) -> None:
        self._robot, self._joints, self._clutch, self._gripper = robot, joints, clutch, gripper

    def read(self) -> Told | None:
        """Return where its end effector is now; see `Input`. Angles that are no numbers are none."""
        said = self._joints()
        if said is None:
            return None
        try:
            q = as_array("joints", said, (self._robot.configuration_size,))
        except Error:
            return None
        return Told(time.monotonic(), self._clutch(), pose=self._robot.fkm(q), gripper=self._gripper())

    def close(self) -> None:
        """Do nothing: whoever reads its joints lets go of it."""
