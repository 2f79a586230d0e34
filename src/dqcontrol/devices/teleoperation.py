"""Teleoperation: a clutch, scaling, and rest when nothing is told any more; and devices that tell: arm, pad, knob."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import Error, as_array, from_extra
from dqcontrol.loop.live import Live
from dqcontrol.loop.targets import Clutch
from dqcontrol.robots import Robot

_NOTHING: Array = np.zeros(3)
_UNIT = 1e-3  # of a quaternion's norm from 1: trackers round


class Told(NamedTuple):
    """What a device tells at a moment.

    Attributes
    ----------
    stamp
        When, s, of the clock of who asks.
    clutch
        Whether the dead man's button is held: without it nothing moves.
    linear, angular
        Twist as a share of the fastest, −1 … 1, shape (3,): forward, left, up, and about these.
    pose
        Of a device that is moved itself, shape (8,), m; None of one that is pushed.
    gripper
        0 open … 1 closed; NaN if it has none.
    """

    stamp: float
    clutch: bool
    linear: Array = _NOTHING
    angular: Array = _NOTHING
    pose: Array | None = None
    gripper: float = float("nan")


class Input(Protocol):
    """A device: keys, a gamepad, a knob, a tracker."""

    def read(self) -> Told | None:
        """Return the newest that it tells, without waiting; None if there is nothing."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


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


class Teleoperation:
    """Drives a robot by what a device tells.

    A device that is moved itself counts from where it is when the clutch is taken: that moves nothing. When it is let
    go, what is told is too old or no number, the end effector stays where it is.

    Parameters
    ----------
    live
        The robot.
    scale
        Metres of the end effector for a metre of the device.
    stale
        Age from which what is told no longer counts, s.
    of_hand
        Whether twists and poses are in the axes of the end effector, or of the base.

    Attributes
    ----------
    is_engaged
        Whether the device drives.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> arm, start = dqc.load_robot("iiwa7"), [0, 0.6, 0, 1.6, 0, 0.6, 0]
    >>> live = dqc.loop.Live(arm, dqc.laws.Proportional(gain=5.0), dqc.plants.Integrator(), 0.01, start=start)
    >>> driven = Teleoperation(live)
    >>> for k in range(100):
    ...     driven.take(Told(0.01 * k, True, linear=np.array([0, 0, 0.5])), now=0.01 * k)
    ...     live.step()
    >>> bool(live.state.pose[7] != arm.fkm(start)[7]), driven.is_engaged
    (True, True)
    """

    live: Live
    is_engaged: bool

    def __init__(self, live: Live, scale: float = 1.0, stale: float = 0.2, *, of_hand: bool = False) -> None:
        self.live, self._scale, self._stale, self._of_hand = live, scale, stale, of_hand
        self._clutch: Clutch | None = None
        self.is_engaged = False

    def take(self, told: Told | None, now: float) -> None:
        """Do what is told at a time, s; None: nothing is."""
        if told is None or not told.clutch or not now - told.stamp <= self._stale or not _is_sound(told):
            self._let_go()
            return
        if told.pose is None:
            speeds = self.live.speeds
            linear, angular = (np.clip(each, -1.0, 1.0) for each in (told.linear, told.angular))
            self.live.move(speeds.linear * linear, speeds.angular * angular, of_hand=self._of_hand)
        else:
            device = self._scaled(told.pose)
            if self._clutch is None:
                self._clutch = Clutch(self.live.state.pose, device, of_hand=self._of_hand)
            self.live.target = algebra.renormalise(self._clutch.goal(device))
        self.is_engaged = True

    def _let_go(self) -> None:
        if self.is_engaged:
            self.live.hold()
        self.is_engaged, self._clutch = False, None

    def _scaled(self, pose: Array) -> Array:
        rotation = pose[:4] / np.linalg.norm(pose[:4])
        return algebra.pose(rotation, self._scale * algebra.translation(algebra.renormalise(pose)))


def _is_sound(told: Told) -> bool:
    if told.pose is None:
        return bool(np.isfinite(told.linear).all() and np.isfinite(told.angular).all())
    return bool(np.isfinite(told.pose).all() and abs(np.linalg.norm(told.pose[:4]) - 1.0) < _UNIT)


_AXES = 6  # left x, left y, right x, right y, left trigger, right trigger, as SDL orders them
_LEFT_SHOULDER, _RIGHT_SHOULDER = 9, 10
_A, _B = 0, 1
_FULL = 32767.0  # SDL's axes are 16 bit integers
_STICK_REST = 0.08  # of a stick's way, around its middle: worn sticks rest there


class Gamepad:
    """An `Input`: the first gamepad that is plugged in, by SDL (pygame-ce).

    Left stick: forward and left; right stick: up, and turning about the vertical. Left shoulder held: drive; right one
    besides: the sticks turn. A closes the gripper, B opens it.

    Raises
    ------
    MissingExtraError
        If pygame-ce is not installed.
    Error
        If there is no gamepad.
    """

    def __init__(self) -> None:
        os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # no window
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        self._pygame, controllers = (
            from_extra(name, "devices", "gamepads") for name in ("pygame", "pygame._sdl2.controller")
        )
        self._pygame.display.init()
        controllers.init()
        found = [i for i in range(controllers.get_count()) if controllers.is_controller(i)]
        if not found:
            raise Error("gamepad: none is plugged in, or it is not known to SDL")
        self._device: Any = controllers.Controller(found[0])
        self._gripper = 0.0

    def read(self) -> Told | None:
        """Return what is pressed now; see `Input`."""
        self._pygame.event.pump()
        device = self._device
        if not device.attached():
            return None
        axes = np.array([device.get_axis(i) / _FULL for i in range(_AXES)])
        sticks = np.where(np.abs(axes[:4]) < _STICK_REST, 0.0, np.clip(axes[:4], -1.0, 1.0))
        left, forward, yaw, up = -sticks[0], -sticks[1], -sticks[2], -sticks[3]
        turns = bool(device.get_button(_RIGHT_SHOULDER))
        for button, closed in ((_A, 1.0), (_B, 0.0)):
            if device.get_button(button):
                self._gripper = closed
        return Told(
            time.monotonic(),
            bool(device.get_button(_LEFT_SHOULDER)),
            linear=np.zeros(3) if turns else np.array([forward, left, up]),
            angular=np.array([-left, forward, yaw]) if turns else np.array([0.0, 0.0, yaw]),
            gripper=self._gripper,
        )

    def close(self) -> None:
        """Let go of it."""
        self._device.quit()


_KNOB_REST = 0.05  # of its way: it rests not quite at 0


class SpaceMouse:
    """An `Input`: the first knob that is plugged in, by pyspacemouse.

    Its first button closes the gripper, its second opens it. A knob that is pushed is held: it needs no clutch.

    Raises
    ------
    MissingExtraError
        If pyspacemouse is not installed.
    Error
        If there is none, or it may not be read.
    """

    def __init__(self) -> None:
        library = from_extra("pyspacemouse", "devices", "space mice")
        try:
            # Forward, left and up, and turns about these (REP 103)
            self._device: Any = library.open(axis_convention=library.AxisConvention.ROS)
        except Exception as error:  # it raises RuntimeError, OSError, and errors of the HID library
            raise Error(f"space mouse: cannot be read: {error}") from None
        self._gripper = 0.0

    def read(self) -> Told | None:
        """Return how it is pushed now; see `Input`."""
        state = self._device.read()
        if state is None:
            return None
        pushed = np.array([state.x, state.y, state.z, state.roll, state.pitch, state.yaw], dtype=np.float64)
        pushed = np.where(np.abs(pushed) < _KNOB_REST, 0.0, pushed)
        for button, closed in zip(state.buttons, (1.0, 0.0), strict=False):
            if button:
                self._gripper = closed
        return Told(
            time.monotonic(), bool(pushed.any()), linear=pushed[:3], angular=pushed[3:], gripper=self._gripper
        )

    def close(self) -> None:
        """Let go of it."""
        self._device.close()
