"""A Franka arm, by the client ``franky`` on libfranka."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.plants.drivers.driver import ArmAtHost, Link, client

_REALTIME = Path("/sys/kernel/realtime")  # of kernels with PREEMPT_RT, which libfranka asks for


class FrankaArm(ArmAtHost, frozen=True, kw_only=True, tag="franka"):
    """A Franka FR3 (or Panda, with a ``franky`` built for it) over its control interface, FCI.

    Joint velocities go to ``franky``, whose own loop answers the robot each millisecond and keeps velocity,
    acceleration and jerk in Franka's limits on the way to each. A velocity lasts ``timeout``: without another the arm
    brakes. If this process dies or freezes, the robot stops by itself, as FCI hears nothing.

    Parameters
    ----------
    host
        Name or address of the robot's control.
    dynamics
        Share of Franka's limits of velocity, acceleration and jerk that ``franky`` uses.

    Raises
    ------
    MissingExtraError
        When started, if the client is not installed.

    Examples
    --------
    >>> FrankaArm(host="172.16.0.2").address
    'Franka at 172.16.0.2'
    """

    maker: ClassVar[str] = "Franka"
    dynamics: Annotated[float, Meta(gt=0, le=1, description="share of the limits")] = 0.5

    def link(self, period: float) -> Link:
        """Return what reads it."""
        return _Franky(self)


class _Franky(Link):
    def __init__(self, plant: FrankaArm) -> None:
        self._franky: Any = client("franky", "'dqcontrol[franka]'")
        real_time = self._franky.RealtimeConfig
        has_priorities = hasattr(os, "sched_getscheduler")
        before = (os.sched_getscheduler(0), os.sched_getparam(0)) if has_priorities else None
        try:
            asked = real_time.Enforce if _REALTIME.exists() else real_time.Ignore
            self._robot: Any = self._franky.Robot(
                plant.host, relative_dynamics_factor=plant.dynamics, realtime_config=asked
            )
        finally:  # it takes the highest priority for this thread, too, and never gives it back
            if before:
                os.sched_setscheduler(0, *before)
        self._held = self._franky.Duration(round(1000 * plant.timeout))
        self._state: Any = None

    def take(self) -> None:
        """Nothing: the first velocity begins a motion."""

    def read(self) -> tuple[Array, object]:
        self._state = self._robot.state
        return self._state.q, self._state.time.to_msec()

    def send(self, target: Array, rate: Array) -> None:
        self._robot.move(self._franky.JointVelocityMotion(rate, self._held), asynchronous=True)

    def fault(self) -> str:
        mode = self._state.robot_mode
        if mode in (self._franky.RobotMode.Idle, self._franky.RobotMode.Move):
            return ""
        errors = self._state.current_errors, self._state.last_motion_errors
        said = [name for each in errors for name in dir(each) if getattr(each, name) is True]
        return ", ".join(dict.fromkeys([f"robot mode {mode.name}", *said]))

    def close(self) -> None:
        if not self.fault() and self._robot.is_in_control:
            self._robot.stop()
        del self._robot  # franky disconnects with the last reference
