"""Where the hand should be now: on a spec's reference, on the way to a pose, or where a twist leads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TIME, TWIST

# How far the desired pose may be ahead of the hand before it waits: a hand that is held must not jump when let go.
_LEAD, _ANGULAR_LEAD = 0.05, 0.3  # m, rad


class Target(Protocol):
    """What gives the desired motion at a time."""

    def start(self, pose: Array) -> None:
        """Begin with the hand at a pose (8,)."""
        ...

    def sample(self, time: float, pose: Array) -> Array:
        """Return the desired motion (21,) at a time since the start, s, with the hand at a pose (8,)."""
        ...

    def is_over(self, time: float) -> bool:
        """Return whether the motion has ended."""
        ...


@dataclass
class Speeds:
    """How fast the hand may be asked to move, m/s and rad/s."""

    linear: float = 0.1
    angular: float = 0.5

    def share(self, linear: float, angular: float) -> float:
        """Return the factor, at most 1, that brings two speeds or distances within these."""
        return min(1.0, self.linear / max(linear, 1e-12), self.angular / max(angular, 1e-12))


class SampledTarget:
    """A reference sampled once a period, shape (N, 21)."""

    def __init__(self, samples: Array, period: float) -> None:
        self._samples, self._period = samples, period

    def start(self, pose: Array) -> None:
        """Begin; the reference has its own first pose."""

    def sample(self, time: float, pose: Array) -> Array:
        """Return the nearest sample."""
        return self._samples[min(max(round(time / self._period), 0), len(self._samples) - 1)]

    def is_over(self, time: float) -> bool:
        """Return whether the last sample's period has passed."""
        return round(time / self._period) >= len(self._samples)


class MovingTarget:
    """A desired pose that moves while it is not too far ahead of the hand."""

    def __init__(self, speeds: Speeds) -> None:
        self.speeds = speeds
        self._row, self._last = np.zeros(SAMPLE_SIZE), 0.0

    def start(self, pose: Array) -> None:
        """Begin at rest where the hand is."""
        self._row[:] = 0.0
        self._row[POSE], self._last = pose, 0.0

    def sample(self, time: float, pose: Array) -> Array:
        """Return where the desired pose has come to."""
        dt, self._last = max(time - self._last, 0.0), time
        self._row[TIME], self._row[TWIST] = time, 0.0
        ahead = _distance(pose, self._row[POSE])
        if dt and ahead[0] <= _LEAD and ahead[1] <= _ANGULAR_LEAD:
            self._advance(time, dt)
        return self._row

    def is_over(self, time: float) -> bool:
        """Return False: it runs until somebody ends it."""
        return False

    def _advance(self, time: float, dt: float) -> None:
        raise NotImplementedError


class PoseTarget(MovingTarget):
    """The way to the last pose asked for, on a straight line with limited speeds."""

    def __init__(self, speeds: Speeds) -> None:
        super().__init__(speeds)
        self.goal: Array | None = None

    def start(self, pose: Array) -> None:
        """Begin at rest where the hand is."""
        super().start(pose)
        self.goal = None

    def _advance(self, time: float, dt: float) -> None:
        if self.goal is not None:
            present = self._row[POSE].copy()
            way, turn = _distance(present, self.goal)
            share = self.speeds.share(way / dt, turn / dt)
            r = algebra.sclerp(_turned(present[:4]), _turned(self.goal[:4]), share)[:4]
            start, end = algebra.translation(present), algebra.translation(self.goal)
            self._row[POSE] = algebra.pose(r / np.linalg.norm(r), start + share * (end - start))


class TwistTarget(MovingTarget):
    """The way that a twist leads; without a new one in time the desired pose rests.

    Attributes
    ----------
    timeout
        After which a twist no longer counts, s.
    """

    def __init__(self, speeds: Speeds, timeout: float = 0.1) -> None:
        super().__init__(speeds)
        self.timeout = timeout
        self._twist, self._asked, self._of_hand = np.zeros(6), -math.inf, False

    def start(self, pose: Array) -> None:
        """Begin at rest where the hand is."""
        super().start(pose)
        self._asked = -math.inf

    def ask(self, time: float, linear: Array, angular: Array, *, of_hand: bool) -> None:
        """Move on with these velocities (3,), m/s and rad/s, in the axes of the hand or of the base."""
        share = self.speeds.share(float(np.linalg.norm(linear)), float(np.linalg.norm(angular)))
        self._twist[:3], self._twist[3:] = share * angular, share * linear
        self._asked, self._of_hand = time, of_hand

    def _advance(self, time: float, dt: float) -> None:
        if time - self._asked > self.timeout:
            return
        present = self._row[POSE].copy()
        r, p = algebra.rotation(present), algebra.translation(present)
        w, v = self._twist[:3], self._twist[3:]
        if self._of_hand:
            matrix = algebra.matrix_from_rotation(r)
            w, v = matrix @ w, matrix @ v
        angle = float(np.linalg.norm(w)) * dt
        if angle:
            r = algebra.multiply(_turned(algebra.rotation_from_axis_angle(w, angle)), _turned(r))[:4]
        p = p + v * dt
        self._row[POSE] = algebra.pose(r / np.linalg.norm(r), p)
        self._row[TWIST] = np.concatenate([w, v + np.cross(p, w)])


def _turned(rotation: Array) -> Array:
    """Return a rotation (4,) as pose (8,) at the origin."""
    return np.concatenate([rotation, np.zeros(4)])


def _distance(a: Array, b: Array) -> tuple[float, float]:
    """Return how far two poses are apart, m and rad."""
    cosine = abs(float(a[:4] @ b[:4]))
    return (
        float(np.linalg.norm(algebra.translation(a) - algebra.translation(b))),
        2.0 * math.acos(min(cosine, 1.0)),
    )
