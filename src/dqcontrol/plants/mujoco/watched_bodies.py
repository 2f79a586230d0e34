"""What cameras say about bodies of the world: their poses, seldom, late and with noise."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import error_prefix
from dqcontrol.plants.channels import Channel
from dqcontrol.plants.plant import begun_periods
from dqcontrol.world import Body

_SNAP = 1e-9  # periods; frames that are nearer to a sample than that are of it


class WatchedBodies:
    """Watched bodies at work.

    Attributes
    ----------
    seen
        By name the measured pose, unit dual quaternion (8,), updated in place.
    """

    def __init__(
        self, watched: Mapping[str, Body], places: Mapping[str, Any], period: float, seed: int
    ) -> None:
        self._eyes = [
            _Eye(name, body, place, period, np.random.default_rng([seed, 5, k]))
            for k, ((name, body), place) in enumerate(zip(watched.items(), places.values(), strict=True))
        ]
        self.seen: dict[str, Array] = {eye.name: eye.pose for eye in self._eyes}

    def look(self, out: Array) -> None:
        """Take what arrives at the next sample, and write the readings."""
        for k, eye in enumerate(self._eyes):
            eye.look()
            out[7 * k : 7 * k + 3] = algebra.translation(eye.pose)
            out[7 * k + 3 : 7 * k + 7] = eye.pose[:4]


def seen_channels(watched: Mapping[str, Body]) -> Iterator[Channel]:
    """Yield what is recorded of watched bodies."""
    for name in watched:
        yield Channel(f"{name}_seen_position", ("x", "y", "z"), "m")
        yield Channel(f"{name}_seen_quaternion", ("w", "x", "y", "z"), "")


class _Eye:
    """What watches one body: frames at equal times, each shown at the first sample at or after it."""

    def __init__(self, name: str, body: Body, place: Any, period: float, rng: np.random.Generator) -> None:
        assert body.watch is not None
        self.name, self._watch, self._place, self._rng = name, body.watch, place, rng
        with error_prefix(f"world.{name}.watch"):
            self._delay, _ = begun_periods("delay", body.watch.delay, period)
        self._per_period = body.watch.rate * period
        self._weight = body.watch.weight
        self.pose: Array = body.pose.copy()
        self._shown: deque[Array] = deque(maxlen=self._delay + 1)
        self._k = -1

    def look(self) -> None:
        self._k += 1
        self._shown.append(algebra.pose(self._place.xquat, self._place.xpos))
        shown = self._k - self._delay
        if shown <= 0:
            return  # the first frame is exact: where the world says that it is
        frame, before = (math.floor(k * self._per_period + _SNAP) for k in (shown, shown - 1))
        if frame > before:
            self.pose[:] = algebra.sclerp(self.pose, self._noisy(self._shown[0]), self._weight)

    def _noisy(self, pose: Array) -> Array:
        turn = 0.5 * self._watch.angle_noise * self._rng.standard_normal(3)
        shift = self._watch.position_noise * self._rng.standard_normal(3)
        rotation = algebra.exp_body(np.concatenate([turn, np.zeros(3)]))[:4]
        turned = algebra.multiply(algebra.pose(rotation, np.zeros(3)), algebra.pose(pose[:4], np.zeros(3)))
        return algebra.pose(turned[:4], algebra.translation(pose) + shift)
