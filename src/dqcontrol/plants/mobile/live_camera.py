"""A camera at work on a live plant: its estimate of x, y and φ, sample by sample."""

from __future__ import annotations

from collections import deque

from dqcontrol.arrays import Array
from dqcontrol.plants.camera import Camera


class Sight:
    """What a `Camera` says about one base, for a number of periods.

    Attributes
    ----------
    pose
        Its estimate of x, y and φ, shape (3,), m and rad, updated in place.
    """

    def __init__(self, camera: Camera, start: Array, dt: float, steps: int, seed: int) -> None:
        self._plan = camera.schedule(dt, steps, 1, seed)
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
