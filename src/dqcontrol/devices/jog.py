"""Driving a robot by keys, and keeping the poses that it is brought to."""

from __future__ import annotations

import numpy as np

from dqcontrol.algebra import translation
from dqcontrol.errors import Error
from dqcontrol.loop.live import Live
from dqcontrol.references.points import PointsWriter

# Axis of the twist (linear, then angular) and direction: forward, left, up; turns by the right hand.
MOVES = {
    "w": (0, 1),
    "s": (0, -1),
    "a": (1, 1),
    "d": (1, -1),
    "r": (2, 1),
    "f": (2, -1),
    "l": (3, 1),
    "j": (3, -1),
    "i": (4, 1),
    "k": (4, -1),
    "u": (5, 1),
    "o": (5, -1),
}
END = "q"
HELP = (
    "hold to move   w s  x   a d  y   r f  z     to turn   l j  x   i k  y   u o  z",
    "+ - faster, slower    h axes of end effector or base    p keep this pose",
    "space stop    g resume after a stop    q quit, also by c or Ctrl-C",
)


class Jog:
    """What keys do to a robot: one moves the end effector while it repeats.

    Parameters
    ----------
    live
        The robot; its speeds are the fastest.
    poses
        What keeps poses; none are kept if omitted.

    Attributes
    ----------
    share
        Of the fastest speeds, that keys ask for.
    of_hand
        Whether they mean the axes of the end effector, or those of the base.
    """

    live: Live
    share: float
    of_hand: bool

    def __init__(self, live: Live, poses: PointsWriter | None = None) -> None:
        self.live, self._poses = live, poses
        self.share, self.of_hand = 0.5, False

    @property
    def status(self) -> str:
        """Where the end effector is, what keys mean, and what the robot does."""
        live = self.live
        x, y, z = translation(live.robot.fkm(live.plant.measured))
        keys = f"{self.share * live.speeds.linear:.2g} m/s {self.share * live.speeds.angular:.2g} rad/s"
        axes = "hand" if self.of_hand else "base"
        return f"x {x:+.3f} y {y:+.3f} z {z:+.3f} m  {keys}  {axes} axes  {live.condition}"

    def press(self, key: str) -> str:
        """Do what a key says; return what there is to tell, if anything. Keys without a meaning do nothing."""
        if key in MOVES:
            self._move(*MOVES[key])
        elif key in ("+", "-"):
            self.share = min(1.0, max(1 / 64, self.share * (2.0 if key == "+" else 0.5)))
        elif key == "h":
            self.of_hand = not self.of_hand
        elif key == " ":
            self.live.stop()
        elif key in (END, "c"):
            self.live.end()
        elif key in ("g", "p"):
            try:
                return self._keep() if key == "p" else self._go_on()
            except Error as error:
                return str(error)
        return ""

    def _move(self, axis: int, sign: int) -> None:
        asked = np.zeros((2, 3))
        speed = (self.live.speeds.linear, self.live.speeds.angular)[axis // 3]
        asked[axis // 3, axis % 3] = sign * self.share * speed
        self.live.move(asked[0], asked[1], of_hand=self.of_hand)

    def _keep(self) -> str:
        if self._poses is None:
            return "no file for poses"
        measured = self.live.plant.measured
        joints = ", ".join(f"{angle:.6g}" for angle in measured)
        count = self._poses.add(self.live.robot.fkm(measured), f"start: [{joints}]")
        return f"pose {count} kept in {self._poses.path}"

    def _go_on(self) -> str:
        self.live.resume()
        return "resumed"
