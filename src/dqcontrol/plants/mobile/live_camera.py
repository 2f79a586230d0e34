"""A camera at work on a live plant: its estimate of x, y and φ, sample by sample."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.plants.camera import Camera
from dqcontrol.plants.mobile.odometry import Odometry

SEEN = ("camera", "fused")  # locations that take frames


class Sight:
    """What a `Camera` says about one base, for a number of periods.

    Attributes
    ----------
    pose
        Its estimate of x, y and φ, shape (3,), m and rad, updated in place.
    """

    def __init__(self, camera: Camera, start: Array, period: float, steps: int, seed: int) -> None:
        self._plan = camera.schedule(period, steps, 1, seed)
        self.pose: Array = start.copy()
        self._shown = deque([start.copy()] * (self._plan.delay + 1), maxlen=self._plan.delay + 1)
        self._k = 0

    @property
    def age(self) -> float:
        """Time since the last frame arrived, s."""
        return float(self._plan.age[min(self._k, len(self._plan.age) - 1)])

    @property
    def share(self) -> float:
        """Share of the commands that is still obeyed."""
        return float(self._plan.share[min(self._k, len(self._plan.share) - 1)])

    @property
    def is_over(self) -> bool:
        """Whether the periods that were asked for are over."""
        return self._k >= len(self._plan.age)

    def look(self, true: Array) -> None:
        """Take the frame of the next sample, at which the base is at ``true``."""
        self._k += 1
        self._shown.append(true.copy())
        if self._plan.arrives[self._k]:
            self.pose += self._plan.weight * (self._shown[0] + self._plan.errors[self._k] - self.pose)


class FusedSight(Sight):
    """A camera, or another localisation, that corrects odometry: between frames, and while they are late, wheels tell.

    The estimate is T ⊕ o: what odometry says, o, displaced by T in the plane. A frame that shows the base d periods
    ago corrects the estimate of then, z = T ⊕ o(k − d), by the frame's weight, and with it T; what the wheels turned
    since stays as it is. So the delay costs nothing as far as odometry is right, and a low weight (a long
    `filter_time`) averages the frames' noise without lagging behind the motion.

    Parameters
    ----------
    camera, start, period, steps, seed
        As of `Sight`.
    odometry
        Of the same base, already up to date when it looks.
    """

    def __init__(
        self, camera: Camera, start: Array, period: float, steps: int, seed: int, odometry: Odometry
    ) -> None:
        super().__init__(camera, start, period, steps, seed)
        self._odometry = odometry
        self._counted = deque([odometry.pose.copy()] * (self._plan.delay + 1), maxlen=self._plan.delay + 1)
        self._displacement = np.zeros(3)  # T

    def look(self, true: Array) -> None:
        """Take the frame of the next sample, at which the base is at ``true``."""
        self._k += 1
        self._shown.append(true.copy())
        self._counted.append(self._odometry.pose.copy())
        if self._plan.arrives[self._k]:
            counted = self._counted[0]
            then = displaced(self._displacement, counted)
            missing = self._shown[0] + self._plan.errors[self._k] - then
            missing[2] = math.remainder(missing[2], math.tau)
            then += self._plan.weight * missing
            turn = then[2] - counted[2]
            c, s = math.cos(turn), math.sin(turn)
            x, y = counted[:2]
            self._displacement = np.array([then[0] - c * x + s * y, then[1] - s * x - c * y, turn])
        self.pose[:] = displaced(self._displacement, self._odometry.pose)


def displaced(displacement: Array, pose: Array) -> Array:
    """Return (x, y, φ) displaced by another (x, y, φ), m and rad: turned about the origin, then shifted."""
    c, s = math.cos(displacement[2]), math.sin(displacement[2])
    x, y, angle = pose
    return displacement + np.array([c * x - s * y, s * x + c * y, angle])
