"""A UFACTORY xArm, by its maker's SDK."""

from __future__ import annotations

import socket
import sys
import time
from contextlib import redirect_stdout
from typing import Annotated, Any, ClassVar

from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.plants.drivers.driver import ArmAtHost, Link, client

_CLIENT = "'dqcontrol[xarm]'"
_OLDEST = (1, 9, 0)  # firmware: before, measured joints cannot be asked for
_VELOCITY, _MOVES, _STANDS = 4, 1, 2  # of the SDK's modes and states
_READY, _STOP = 0, 4  # states to be set
_SILENT = 3  # the SDK's code of an answer that does not come
_BEGINS = 1.0  # s until its report, five a second, says the mode


class XArm(ArmAtHost, frozen=True, kw_only=True, tag="xarm"):
    """An xArm 5, 6 or 7, an 850 or a Lite 6: joint velocities in the controller's velocity mode.

    A velocity lasts ``timeout``: without another the controller brakes the arm, however this computer fails. Brakes are
    released, and an error is not cleared, when a run begins; at its end the arm is stopped, and holds.

    Parameters
    ----------
    host
        Name or address of the control box.
    acceleration
        Most that the controller accelerates joints at on the way to each velocity, rad/s².

    Raises
    ------
    MissingExtraError
        When started, if the SDK is not installed.

    Examples
    --------
    >>> XArm(host="192.168.1.20").address
    'xArm at 192.168.1.20'
    """

    maker: ClassVar[str] = "xArm"
    acceleration: Annotated[float, Meta(gt=0, le=20, description="rad/s²")] = 10.0

    def link(self, period: float) -> Link:
        """Return what reads it."""
        with redirect_stdout(sys.stderr):  # where the SDK tells what it finds
            return _Sdk(self)


class _Sdk(Link):
    def __init__(self, plant: XArm) -> None:
        self._plant, self._reads, self._is_taken = plant, 0, False
        sdk, codes = client("xarm.wrapper", _CLIENT), client("xarm.core.config.x_code", _CLIENT)
        self._title = codes.ControllerError
        # it says on stdout what is raised here
        client("xarm.core.utils.log", _CLIENT).logger.setLevel("CRITICAL")
        address = socket.gethostbyname(plant.host)  # anything else than four numbers would be a serial port
        self._arm: Any = sdk.XArmAPI(address, is_radian=True, report_type="normal", check_is_pause=False)
        self._arm.set_timeout(plant.timeout)
        if self._arm.version_number < _OLDEST:
            self._arm.disconnect()
            found, needed = (".".join(map(str, each)) for each in (self._arm.version_number, _OLDEST))
            raise RuntimeError(f"its firmware is {found}; {needed} is needed")
        self._arm.get_err_warn_code()
        self._arm.get_state()

    def take(self) -> None:
        arm = self._arm
        self._done(arm.motion_enable(enable=True))
        self._done(arm.set_mode(_VELOCITY))
        self._done(arm.set_state(_READY))
        self._done(arm.set_joint_maxacc(self._plant.acceleration))
        until = time.monotonic() + _BEGINS
        while arm.mode != _VELOCITY and time.monotonic() < until:
            time.sleep(0.01)
        self._is_taken = True

    def read(self) -> tuple[Array, object]:
        code, states = self._arm.get_joint_states(num=1)
        self._done(code)
        self._reads += 1  # each is a measurement of its own, or raises
        return states[0][: self._arm.axis], self._reads

    def send(self, target: Array, rate: Array) -> None:
        lasts = self._plant.timeout
        self._done(self._arm.vc_set_joint_velocity(rate.tolist(), is_sync=False, duration=lasts))

    def fault(self) -> str:
        arm = self._arm
        if arm.error_code:
            title = self._title(arm.error_code).title["en"]
            return f"error C{arm.error_code}, {title}; clear it on the robot"
        if self._is_taken and (arm.mode, arm.state) not in ((_VELOCITY, _MOVES), (_VELOCITY, _STANDS)):
            return f"mode {arm.mode} and state {arm.state}; somebody else has taken or stopped it"
        return ""

    def close(self) -> None:
        if self._is_taken and self._arm.connected and not self.fault():
            self._arm.set_state(_STOP)
        self._arm.disconnect()

    def _done(self, code: int) -> None:
        """Raise if the robot did not do what it was asked."""
        if code == _SILENT:
            raise RuntimeError(f"silent for {self._plant.timeout:g} s; is it on, and its cable plugged in?")
        if code:
            self._arm.get_err_warn_code()  # the report may be a fifth of a second old
            raise RuntimeError(self.fault() or f"it refused, code {code} of the SDK")
