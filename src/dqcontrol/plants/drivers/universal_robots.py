"""A Universal Robots arm, by the client ``ur_rtde``."""

from __future__ import annotations

import re
import time
from typing import Annotated, Any, ClassVar, Literal

from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.plants.drivers.driver import ArmAtHost, Link, client

_CLIENT = "'dqcontrol[ur]'"
_CYCLE = 0.002  # s: of the e-Series
_RECEIVED = ["timestamp", "actual_q", "robot_status_bits", "safety_status_bits", "runtime_state"]
_PLAYING = 2  # of RTDE's runtime_state
_BEGINS = 1.0  # s until both connections say that the program runs
_POWER = 1  # of its robot_status_bits
_OLDEST = [3, 4]  # PolyScope


class UniversalRobot(ArmAtHost, frozen=True, kw_only=True, tag="ur"):
    """A UR arm in remote control, over RTDE; a program on it takes ``servoJ`` or ``speedJ`` once a period.

    The robot's own watchdog stops it after ``timeout`` without commands, however this computer fails; a protective stop
    is then to be unlocked on it.

    Parameters
    ----------
    host
        Name or address of the robot.
    command_mode
        ``integrated``: joint positions, which ``servoJ`` follows; ``velocity``: joint velocities, by ``speedJ``.
    lookahead, gain
        Of ``servoJ``: smoothing time, s, and proportional gain.
    acceleration
        Of ``speedJ``, and of the stop at the end, rad/s².

    Raises
    ------
    MissingExtraError
        When started, if the client is not installed.

    Examples
    --------
    >>> UniversalRobot(host="192.168.1.10").address
    'UR at 192.168.1.10'
    """

    maker: ClassVar[str] = "UR"
    command_mode: Literal["integrated", "velocity"] = "integrated"
    lookahead: Annotated[float, Meta(ge=0.03, le=0.2, description="s")] = 0.1
    gain: Annotated[float, Meta(ge=100, le=2000)] = 300.0
    acceleration: Annotated[float, Meta(gt=0, le=40, description="rad/s²")] = 10.0

    def link(self, period: float) -> Link:
        """Return what reads it."""
        return _Rtde(self, period)


class _Rtde(Link):
    def __init__(self, plant: UniversalRobot, period: float) -> None:
        self._plant, self._period, self._is_watched = plant, period, False
        self._control: Any = None
        receive, dashboard = client("rtde_receive", _CLIENT), client("dashboard_client", _CLIENT)
        asked = dashboard.DashboardClient(plant.host)
        asked.connect()
        version = [int(part) for part in re.findall(r"\d+", asked.polyscopeVersion())[:2]]
        asked.disconnect()
        if version < _OLDEST:  # before, the program's registers cannot be read
            raise RuntimeError(
                f"its PolyScope is {version[0]}.{version[1]}; {_OLDEST[0]}.{_OLDEST[1]} is needed"
            )
        self._received: Any = receive.RTDEReceiveInterface(plant.host, variables=_RECEIVED)

    def take(self) -> None:
        self._control = client("rtde_control", _CLIENT).RTDEControlInterface(self._plant.host)
        until = time.monotonic() + _BEGINS
        while self._received.getRuntimeState() != _PLAYING and time.monotonic() < until:
            time.sleep(_CYCLE)  # the program runs; the other connection hears so a message later

    def read(self) -> tuple[Array, object]:
        return self._received.getActualQ(), self._received.getTimestamp()

    def send(self, target: Array, rate: Array) -> None:
        plant = self._plant
        if not self._is_watched:  # only now: until the loop begins no commands come
            self._is_watched = self._control.setWatchdog(1 / plant.timeout)
        if plant.command_mode == "velocity":
            done = self._control.speedJ(rate.tolist(), plant.acceleration, self._period)
        else:
            done = self._control.servoJ(target.tolist(), 0, 0, self._period, plant.lookahead, plant.gain)
        if not done:
            raise RuntimeError(self.fault() or "the program on the robot takes no command")

    def fault(self) -> str:
        if not self._received.isConnected() or (self._control and not self._control.isConnected()):
            return "the connection broke"
        if self._received.isEmergencyStopped():
            return "emergency stop"
        if self._received.isProtectiveStopped():
            return "protective stop; unlock it on the robot"
        if not self._received.getRobotStatus() & _POWER:
            return "its power is off, or its brakes are on"
        is_over = self._control and self._received.getRuntimeState() != _PLAYING
        return "the program on the robot ended" if is_over else ""

    def close(self) -> None:
        if self._control is not None:
            if not self.fault():
                is_speed = self._plant.command_mode == "velocity"
                (self._control.speedStop if is_speed else self._control.servoStop)(self._plant.acceleration)
                self._control.stopScript()
            self._control.disconnect()
        self._received.disconnect()
