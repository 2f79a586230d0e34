"""Targets of the end effector now: on a spec's reference, on the way to a pose, or where a twist leads."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import Kernel
from dqcontrol.loop import target_motion
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TIME

_NOTHING: Array = np.zeros(0)


class Target(Protocol):
    """What gives the desired motion at a time."""

    def start(self, pose: Array, time: float = 0.0) -> None:
        """Begin with the end effector at a pose (8,), at a time, s."""
        ...

    def sample(self, time: float, pose: Array) -> Array:
        """Return the desired motion (21,) at a time since the start, s, with the end effector at a pose (8,)."""
        ...

    def is_over(self, time: float) -> bool:
        """Return whether the motion has ended."""
        ...


@dataclass
class Speeds:
    """How fast a target may move, m/s and rad/s, and how soon it gets faster, m/s²; turns in proportion."""

    linear: float = 0.1
    angular: float = 0.5
    acceleration: float = 1.0

    def share(self, linear: float, angular: float) -> float:
        """Return the factor, at most 1, that brings two speeds or distances within these."""
        return min(1.0, self.linear / max(linear, 1e-12), self.angular / max(angular, 1e-12))


class SampledTarget:
    """A reference sampled once a period, shape (N, 21)."""

    def __init__(self, samples: Array, period: float) -> None:
        self._samples, self._period, self._begin = samples, period, 0.0

    def start(self, pose: Array, time: float = 0.0) -> None:
        """Begin; the reference has its own first pose."""
        self._begin = time

    def sample(self, time: float, pose: Array) -> Array:
        """Return the nearest sample."""
        return self._samples[min(max(self._index(time), 0), len(self._samples) - 1)]

    def is_over(self, time: float) -> bool:
        """Return whether the last sample's period has passed."""
        return self._index(time) >= len(self._samples)

    def _index(self, time: float) -> int:
        return round((time - self._begin) / self._period)


class MovingTarget:
    """A desired pose that moves while it is not too far ahead of the end effector."""

    _motion: Kernel

    def __init__(self, speeds: Speeds, timeout: float) -> None:
        self.speeds, self.timeout = speeds, timeout
        self._memory = np.zeros(target_motion.MOVING_SIZE)
        self._row, self._asked = self._memory[:SAMPLE_SIZE], _NOTHING

    def start(self, pose: Array, time: float = 0.0) -> None:
        """Begin at rest where the end effector is."""
        self._memory[:] = 0.0
        moving = target_motion.moving_sample(self._memory)
        moving.pose[:], moving.last[0], self._asked = pose, time, _NOTHING

    def sample(self, time: float, pose: Array) -> Array:
        """Return where the desired pose has come to."""
        bounds = target_motion.target_speeds.pack(timeout=self.timeout, **vars(self.speeds))
        self._motion(pose, time, self._asked, bounds, self._memory)
        return self._row

    def is_over(self, time: float) -> bool:
        """Return False: it runs until somebody ends it."""
        return False


class PoseTarget(MovingTarget):
    """The way to the last pose asked for, on a straight line with limited speeds and accelerations.

    Where that is too old, or no pose at all (NaN), the end effector is to stay where it is then.

    Attributes
    ----------
    timeout
        After which a pose no longer counts, s; infinite for goals that are said once.
    """

    _motion = target_motion.move_to_pose

    def __init__(self, speeds: Speeds, timeout: float = math.inf) -> None:
        super().__init__(speeds, timeout)

    def ask(self, time: float, goal: Array) -> None:
        """Go to a pose (8,) that was said at a time, s."""
        pose = goal if np.isfinite(goal).all() else np.full(8, np.nan)
        self._asked = target_motion.asked_pose.pack(pose=pose, time=time)

    @property
    def goal(self) -> Array | None:
        """The pose asked for, shape (8,); None before the first. Set, it does not become too old."""
        return self._asked[:8] if len(self._asked) else None

    @goal.setter
    def goal(self, goal: Array) -> None:
        self.ask(math.inf, goal)


class Clutch:
    """Poses of a device as poses of the end effector, from where both are when it is engaged, which moves nothing.

    Parameters
    ----------
    hand, device
        Poses then, shape (8,).
    of_hand
        Whether the device's own axes are those of the end effector, x_h x_d0* x_d: a device that is turned about its
        own x axis turns the end effector about the end effector's. Else both move alike in the room: p_h + p_d − p_d0
        and r_d r_d0* r_h.

    Examples
    --------
    >>> import numpy as np
    >>> from dqcontrol import algebra
    >>> hand, device = algebra.exp_screw([0.1, 0, 0, 0.3, 0, 0.2]), algebra.exp_screw([0, 0.4, 0, 5, 0, 0])
    >>> clutch = Clutch(hand, device)
    >>> np.allclose(clutch.goal(device), hand)
    True
    """

    def __init__(self, hand: Array, device: Array, *, of_hand: bool = True) -> None:
        self._hand, self._device, self._of_hand = hand, device, of_hand

    def goal(self, device: Array) -> Array:
        """Return where the end effector is to be with the device at a pose, both of shape (8,)."""
        if self._of_hand:
            return algebra.multiply(algebra.multiply(self._hand, algebra.conjugate(self._device)), device)
        turn = algebra.multiply(_turn(device), algebra.conjugate(_turn(self._device)))
        shift = algebra.translation(device) - algebra.translation(self._device)
        rotation = algebra.multiply(turn, _turn(self._hand))[:4]
        return algebra.pose(rotation / np.linalg.norm(rotation), algebra.translation(self._hand) + shift)


def _turn(pose: Array) -> Array:
    """Return the rotation of a pose alone, shape (8,)."""
    return np.concatenate([pose[:4], np.zeros(4)])


class LeaderTarget(PoseTarget):
    """Goes along with the poses of a leader, as soon as speeds allow: from where both are, alike in the room.

    What is too old, or no pose at all (NaN), lets the leader go: the end effector stays where it is, and the next pose
    moves nothing.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> target, hand = LeaderTarget(Speeds(linear=0.5)), dqc.algebra.pose([1, 0, 0, 0], [0.5, 0, 0.3])
    >>> target.start(hand)
    >>> for time, x in ((0.01, 7.0), (0.02, 7.001)):
    ...     target.ask(time, dqc.algebra.pose([1, 0, 0, 0], [x, 0, 0]))
    ...     sample = target.sample(time, hand)
    >>> round(float(dqc.algebra.translation(sample[:8])[0]), 6), round(float(sample[11]), 6)
    (0.501, 0.1)
    """

    _motion = target_motion.move_with_pose

    def __init__(self, speeds: Speeds, timeout: float = math.inf) -> None:
        super().__init__(speeds, timeout)
        self._clutch: Clutch | None = None
        self._told = -math.inf
        # anywhere: a leader may be told before it begins
        self.start(algebra.pose([1.0, 0, 0, 0], [0.0, 0, 0]))

    def start(self, pose: Array, time: float = 0.0) -> None:
        """Begin at rest where the end effector is, without a leader."""
        super().start(pose, time)
        self._clutch = None

    def ask(self, time: float, goal: Array) -> None:
        """Go along with the leader's pose (8,) that was said at a time, s."""
        is_some = bool(np.isfinite(goal).all())
        if not is_some or time - self._told > self.timeout:
            self._clutch = None
        self._told = time
        if is_some:
            self._clutch = self._clutch or Clutch(self._row[POSE].copy(), goal, of_hand=False)
            goal = self._clutch.goal(goal)
        super().ask(time, goal)

    def is_led(self, time: float) -> bool:
        """Return whether a leader's pose counts at a time, s."""
        return self._clutch is not None and not time - self._told > self.timeout


class TwistTarget(MovingTarget):
    """The way that a twist leads; without a new one in time the desired pose rests.

    Attributes
    ----------
    timeout
        After which a twist no longer counts, s.
    """

    _motion = target_motion.move_by_twist

    def __init__(self, speeds: Speeds, timeout: float = 0.1) -> None:
        super().__init__(speeds, timeout)

    def ask(self, time: float, linear: Array, angular: Array, *, of_hand: bool) -> None:
        """Move on with these velocities (3,), m/s and rad/s, in the axes of the end effector or of the base."""
        if not (np.isfinite(linear).all() and np.isfinite(angular).all()):  # it is none
            linear, angular = np.zeros(3), np.zeros(3)
        share = self.speeds.share(float(np.linalg.norm(linear)), float(np.linalg.norm(angular)))
        twist = {"angular": share * angular, "linear": share * linear}
        self._asked = target_motion.asked_twist.pack(**twist, time=time, of_hand=of_hand)


class JogTarget:
    """Joints that are told their velocities; the end effector is where they take it.

    Parameters
    ----------
    inputs
        m, how many velocities the robot takes.
    timeout
        After which velocities no longer count, s: the joints stand.

    Examples
    --------
    >>> target = JogTarget(2)
    >>> target.ask(1.0, np.array([0.1, 0.0]))
    >>> target.rates(1.05).tolist(), target.rates(1.2).tolist()
    ([0.1, 0.0], [0.0, 0.0])
    """

    def __init__(self, inputs: int, timeout: float = 0.1) -> None:
        self.timeout = timeout
        self._row, self._rates, self._asked = np.zeros(SAMPLE_SIZE), np.zeros(inputs), -math.inf

    def start(self, pose: Array, time: float = 0.0) -> None:
        """Begin at rest."""
        self._asked = -math.inf

    def ask(self, time: float, rates: Array) -> None:
        """Move on with these inputs, shape (m,), rad/s or m/s, that were said at a time, s."""
        self._asked, self._rates = time, rates

    def rates(self, time: float) -> Array:
        """Return the inputs at a time, s; zeros where nothing, or nothing new, was asked."""
        return self._rates if time - self._asked <= self.timeout else np.zeros_like(self._rates)

    def sample(self, time: float, pose: Array) -> Array:
        """Return the end effector's own pose, at rest."""
        self._row[POSE], self._row[TIME] = pose, time
        return self._row

    def is_over(self, time: float) -> bool:
        """Return False: it runs until somebody ends it."""
        return False
