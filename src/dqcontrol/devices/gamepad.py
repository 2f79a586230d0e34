"""A gamepad, by SDL (pygame-ce): sticks move, shoulder buttons lift and turn, the lower left one is the clutch."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np

from dqcontrol.devices.teleoperation import Told
from dqcontrol.errors import Error, from_extra

_AXES = 6  # left x, left y, right x, right y, left trigger, right trigger, as SDL orders them
_LEFT_SHOULDER, _RIGHT_SHOULDER = 9, 10
_A, _B = 0, 1
_FULL = 32767.0  # SDL's axes are 16 bit integers
_DEAD = 0.08  # of a stick's way, around its middle: worn sticks rest there


class Gamepad:
    """An `Input`: the first gamepad that is plugged in.

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
        sticks = np.where(np.abs(axes[:4]) < _DEAD, 0.0, np.clip(axes[:4], -1.0, 1.0))
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
