"""Robots behind their makers' own clients: what all drivers have in common."""

from __future__ import annotations

import re
import tempfile
import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Annotated, ClassVar, TypeVar

import numpy as np
from filelock import FileLock, Timeout
from msgspec import Meta

from dqcontrol.arrays import Array
from dqcontrol.errors import Error, MissingExtraError, ShapeError, ValueRangeError, as_positive
from dqcontrol.plants.plant import Plant, RunningPlant, as_command, start_within_limits
from dqcontrol.references.straight import PEAK_SPEED
from dqcontrol.robots.robot import CommandMode, Robot

Answer = TypeVar("Answer")

_STILL = 0.02  # rad/s or m/s: above it a robot moves; encoders at rest show a hundredth of it
_LOOK = 0.1  # s that it is watched to tell
_AT_START = 0.01  # rad or m that the robot may be from where the run starts; limits are kept as exactly
_PULL = 2.0  # 1/s: a robot that follows a tenth of a second late is damped well
_SETTLING = 3.0  # s, then at most
_FASTEST = 0.002  # s: 500 Hz of UR's e-Series, and two of the milliseconds in which franky answers its robot
_SLOWEST = 0.05  # s: beyond it servoJ stands between two commands


class Link(ABC):
    """What a driver has of its robot's client; whatever raises is a fault of the robot.

    Made, it reads; only `take` takes the robot over.
    """

    @abstractmethod
    def read(self) -> tuple[Array, object]:
        """Return the measured joints, shape (n,), rad or m, and a stamp that changes with each measurement."""

    @abstractmethod
    def take(self) -> None:
        """Get the robot ready for commands; it stands meanwhile."""

    @abstractmethod
    def send(self, target: Array, rate: Array) -> None:
        """Send where the joints are to be next, or how fast they go to be there, (n,) each, rad or m, and per s."""

    @abstractmethod
    def fault(self) -> str:
        """Return why the robot does not follow; empty while it does."""

    @abstractmethod
    def close(self) -> None:
        """Stop the robot and let go of it."""


class Driver(Plant, frozen=True, kw_only=True):
    """A robot behind its maker's client; the kinds say which.

    It is connected to where a run begins, never to check a spec; the run keeps real time, and a supervisor always
    stands before it. Commands are integrated to joint positions, from where the robot stands, unless a kind says
    otherwise.

    Parameters
    ----------
    approach
        Peak speed of the joints at which the robot first goes to where the run starts, straight in joint space and
        with no regard to what stands in its way, rad/s or m/s. If omitted it has to stand there already.
    timeout
        After which a silent robot is one that failed, s; and after which a robot that hears no command stops by
        itself, where its kind can.
    """

    is_supervised: ClassVar[bool] = True
    has_velocity_limits: ClassVar[bool] = True
    is_robot: ClassVar[bool] = True
    approach: Annotated[float, Meta(gt=0, le=0.5, description="rad/s or m/s")] | None = None
    timeout: Annotated[float, Meta(ge=0.02, le=1, description="s")] = 0.1

    @property
    def address(self) -> str:
        """What the robot is called in messages; one driver at a time may have it."""
        raise NotImplementedError

    def open(self, robot: Robot, period: float) -> Link:
        """Connect to the robot so that its state can be read; commands will come with a period (s)."""
        raise NotImplementedError

    def start(self, robot: Robot, start: Array, period: float, steps: int, seed: int) -> RunningDriver:
        """Return the robot, standing where the run starts.

        Raises
        ------
        Error
            If it is not there, is driven already, moves, has other joints, refuses, or stands elsewhere.
        """
        return RunningDriver(self, robot, start_within_limits(robot, start), as_positive("period", period))

    def target_mode(self) -> CommandMode:
        """Return what targets grow from: the last ones."""
        return "integrated"


class ArmAtHost(Driver, frozen=True, kw_only=True):
    """An arm that answers its maker's client at an address of the network.

    Parameters
    ----------
    host
        Name or address of the robot.
    """

    maker: ClassVar[str]
    host: str

    @property
    def address(self) -> str:
        """What the robot is called in messages."""
        return f"{self.maker} at {self.host}"

    def open(self, robot: Robot, period: float) -> Link:
        """Connect to the robot so that its state can be read; see `Driver.open`."""
        if not _FASTEST <= period <= _SLOWEST:
            limits = f"{_FASTEST:g} … {_SLOWEST:g} s for {self.maker} arms"
            raise ValueRangeError(f"period: must be {limits}, got {period:g}")
        return self.link(period)

    def link(self, period: float) -> Link:
        """Return what reads it."""
        raise NotImplementedError


class RunningDriver(RunningPlant):
    """A robot at work behind its client."""

    def __init__(self, driver: Driver, robot: Robot, start: Array, period: float) -> None:
        self._driver, self._period, self._fastest = driver, period, robot.limits.velocity
        lock = _locked(driver.address)
        try:
            link = told(driver.address, lambda: driver.open(robot, period))
        except BaseException:
            lock.release()
            raise
        self._link = link
        self._closing = weakref.finalize(self, _leave, link, lock)
        self._stamp: object = None
        self._has_begun = False
        self._heard = time.monotonic()
        try:
            q = self._standing(robot)
            self.q: Array = q.copy()
            self.measured: Array = q.copy()
            self._target = q.copy()
            self._check_start(robot, start)
            told(driver.address, link.take)
            self._go_to(start)
        except BaseException:
            self.close()
            raise

    def step(self, command: Array) -> None:
        """Send the command and read what the robot measured last; see `RunningPlant.step`.

        A robot that fails says so in ``fault``, and is sent nothing from then on.
        """
        rate = as_command(command, len(self.q))
        if not self._has_begun:  # kernels may have been compiled since it was connected to
            self._has_begun = True
            self._look()
        self._target += self._period * rate
        self._send(rate)
        self._look()

    def close(self) -> None:
        """Stop the robot and let go of it."""
        self._closing()

    def _send(self, rate: Array) -> None:
        if self.fault:
            return
        # Velocities alone would drift from the supervisor's position command, by each period that is late.
        back = np.clip(rate + _PULL * (self._target - self.q), -self._fastest, self._fastest)
        try:
            self._link.send(self._target, back)
        except Exception as error:  # clients raise what they like
            self.fault = f"{self._driver.address}: {_line(error)}"

    def _look(self) -> None:
        """Take the last measurement; say what is wrong with the robot, if anything is."""
        if self.fault:
            return
        try:
            joints, stamp = self._link.read()
            why = self._link.fault()
        except Exception as error:
            self.fault = f"{self._driver.address}: {_line(error)}"
            return
        now = time.monotonic()
        if stamp != self._stamp:
            self._stamp, self._heard = stamp, now
            self.q[:] = self.measured[:] = joints
        self.age = now - self._heard
        if not why and self.age > self._driver.timeout:
            why = f"silent for {self.age:.2f} s; is it on, and its cable plugged in?"
        self.fault = why and f"{self._driver.address}: {why}"

    def _standing(self, robot: Robot) -> Array:
        """Return the joints of a robot that has as many as it should, works, and stands still."""
        address = self._driver.address
        first, _ = told(address, self._link.read)
        if len(first) != robot.configuration_size:
            raise ShapeError(
                f"plant: {address} has {len(first)} joints, the robot of the spec {robot.configuration_size}"
            )
        if why := told(address, self._link.fault):
            raise Error(f"plant: {address}: {why}")
        began = time.monotonic()
        time.sleep(_LOOK)
        q, self._stamp = told(address, self._link.read)
        speed = np.abs(np.asarray(q) - first) / (time.monotonic() - began)
        if not np.isfinite(q).all() or speed.max() > _STILL:
            i = int(np.argmax(speed))
            raise Error(f"plant: {address} moves, {_joint(robot, i)} at {speed[i]:.2g} rad/s; it must stand")
        self._heard = time.monotonic()
        return np.array(q, dtype=np.float64)

    def _check_start(self, robot: Robot, start: Array) -> None:
        away = np.abs(start - self.q)
        i = int(np.argmax(away))
        if self._driver.approach is None and away[i] > _AT_START:
            where = ", ".join(f"{angle:.4f}" for angle in self.q)
            raise ValueRangeError(
                f"start: {self._driver.address} stands elsewhere: {_joint(robot, i)} at {self.q[i]:.4g}, not at "
                f"{start[i]:.4g}; write start: [{where}], or plant.approach, the speed to go there at"
            )

    def _go_to(self, start: Array) -> None:
        """Go to the start in a minimum-jerk motion, and on until the joints are there."""
        way = start - self.q
        farthest = float(np.abs(way).max())
        if farthest <= _AT_START or self._driver.approach is None:
            return
        count = int(np.ceil(PEAK_SPEED * farthest / self._driver.approach / self._period))
        for k in range(1, count + int(np.ceil(_SETTLING / self._period))):
            s = min(k / count, 1.0)
            if s == 1.0 and np.abs(start - self.q).max() <= _AT_START / 2:
                return
            self.step(way * 30 * s**2 * (1 - s) ** 2 / (count * self._period))
            if self.fault:
                raise Error(f"plant: on the way to the start: {self.fault}")
            time.sleep(self._period)
        off = np.abs(start - self.q).max()
        raise Error(f"plant: {self._driver.address} does not get to the start: {off:.3g} rad or m are left")


def client(module: str, requirement: str) -> ModuleType:
    """Return a robot's client, or say what to install for it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"plant: the robot's client is not installed ({error}); pip install {requirement}"
        ) from None


def told(address: str, ask: Callable[[], Answer]) -> Answer:
    """Return what a client answers; what it raises, in one line."""
    try:
        return ask()
    except Error:
        raise
    except Exception as error:  # clients raise what they like
        raise Error(f"plant: {address}: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _joint(robot: Robot, i: int) -> str:
    return f"joint {i + 1} '{robot.joint_names[i]}'"


def _locked(address: str) -> FileLock:
    """Return the lock of a robot, held; whoever drives it from this computer has it."""
    name = re.sub(r"[^\w.-]+", "-", address)
    lock = FileLock(Path(tempfile.gettempdir()) / f"dqcontrol-{name}.lock", timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise Error(f"plant: {address} is driven already, from this computer; stop that first") from None
    return lock


def _leave(link: Link, lock: FileLock) -> None:
    with suppress(Exception):  # nobody is left to be told
        link.close()
    lock.release()
