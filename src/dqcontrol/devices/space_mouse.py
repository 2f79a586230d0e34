"""A SpaceMouse, by pyspacemouse: a knob that is pushed and turned in all six directions."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from dqcontrol.devices.teleoperation import Told
from dqcontrol.errors import Error, from_extra

_DEAD = 0.05  # of its way: it rests not quite at 0


class SpaceMouse:
    """An `Input`: the first knob that is plugged in. Its first button closes the gripper, its second opens it.

    A knob that is pushed is held: it needs no clutch.

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
        pushed = np.where(np.abs(pushed) < _DEAD, 0.0, pushed)
        for button, closed in zip(state.buttons, (1.0, 0.0), strict=False):
            if button:
                self._gripper = closed
        return Told(
            time.monotonic(), bool(pushed.any()), linear=pushed[:3], angular=pushed[3:], gripper=self._gripper
        )

    def close(self) -> None:
        """Let go of it."""
        self._device.close()
