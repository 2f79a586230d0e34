"""References made of another one: at another pace, with smooth starts and stops at corners; moved; along with a body.

At another pace the path is run through with the time σ(t) of the given reference: pose x(σ), twist σ̇ξ, rate σ̇²ξ̇ + σ̈ξ.
The rate σ̇ goes between 0 and 1 along 10s³ − 15s⁴ + 6s⁵, so that acceleration is continuous and jerk bounded:
from rest to the speed V in T seconds along a line takes at most 1.875 V/T and 5.774 V/T² of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol import algebra
from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_positive
from dqcontrol.references.reference import NO_CORNERS, Reference
from dqcontrol.references.sample import TIME, TWIST, TWIST_RATE, as_pose, displaced

_HALVINGS = 60  # of an interval: to the last bit of a double


class Paced(Reference):
    """A reference run through at a rate that changes smoothly, piece by piece.

    Attributes
    ----------
    inner
        The reference.
    pieces
        Begin of each piece, begin in the inner time, length (s), rate at its begin and at its end: shape (5, n).
    """

    inner: Reference
    pieces: Array

    def _pace(self, inner: Reference, pieces: Sequence[tuple[float, float, float]]) -> None:
        """Take pieces (seconds, rate at the start, rate at the end)."""
        seconds, before, after = np.array(pieces).T
        ends, inner_ends = np.cumsum(seconds), np.cumsum(0.5 * seconds * (before + after))
        begins = ends - seconds, inner_ends - 0.5 * seconds * (before + after)
        table = np.stack([*begins, seconds, before, after])
        vars(self).update(inner=inner, pieces=table, duration=float(ends[-1]))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        inner_time, rate, change = self._inner_time(times)
        inner_time = np.clip(inner_time, 0.0, self.inner.duration)
        # Not by `snapped`: where the rate is almost 0, 1 ns of the inner time is many milliseconds.
        if len(self.corners):
            near = np.clip(np.searchsorted(self.corners, times), 0, len(self.corners) - 1)
            inner_time = np.where(times == self.corners[near], self.inner.corners[near], inner_time)
        out = self.inner.motion(inner_time)
        twist, rate, change = out[:, TWIST].copy(), rate[:, None], change[:, None]
        out[:, TWIST] *= rate
        out[:, TWIST_RATE] = rate * rate * out[:, TWIST_RATE] + change * twist
        return out

    def _inner_time(self, times: Array) -> tuple[Array, Array, Array]:
        """Return σ, σ̇ and σ̈."""
        last = self.pieces.shape[1] - 1
        i = np.clip(np.searchsorted(self.pieces[0], times, side="right") - 1, 0, last)
        start, inner_start, seconds, before, after = self.pieces[:, i]
        s, gain = (times - start) / seconds, after - before
        s2 = s * s
        inner_time = inner_start + seconds * (before * s + gain * s2 * s2 * (2.5 - 3 * s + s2))
        rate = before + gain * s2 * s * (10 - 15 * s + 6 * s2)
        return inner_time, rate, gain * 30 * s2 * (1 - s) ** 2 / seconds

    def _outer_time(self, inner_times: Array) -> Array:
        """Return the t with σ(t) given, by bisection: σ increases."""
        low, high = np.zeros_like(inner_times), np.full_like(inner_times, self.duration)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            before = self._inner_time(middle)[0] < inner_times
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return high


@dataclass(frozen=True, eq=False, repr=False)
class StartRamp(Paced):
    """A reference that starts from rest and is at its own speed after the ramp.

    Parameters
    ----------
    reference
        What to start smoothly; of finite duration.
    seconds
        Length of the ramp, s; it covers half as much of the reference, which so takes half of it longer.

    Raises
    ------
    ValueRangeError
        If the ramp is not positive or longer than twice the reference, or the reference never ends.

    Examples
    --------
    >>> from dqcontrol.references import Circle
    >>> circle = Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=10.0)
    >>> StartRamp(circle, seconds=1.0).duration
    10.5
    """

    reference: Reference
    seconds: float

    def __post_init__(self) -> None:
        ramp, whole = as_positive("seconds", self.seconds), finite_duration(self.reference)
        if ramp > 2 * whole:
            raise ValueRangeError(f"seconds: must be ≤ {2 * whole:g}, twice the reference, got {ramp:g}")
        rest = whole - 0.5 * ramp
        self._pace(self.reference, [(ramp, 0.0, 1.0)] + ([(rest, 1.0, 1.0)] if rest > 0 else []))
        corners = self._outer_time(self.reference.corners)
        corners[self.reference.corners == whole] = self.duration
        corners.flags.writeable = False
        vars(self).update(corners=corners)


@dataclass(frozen=True, eq=False, repr=False)
class CornerStops(Paced):
    """A reference that starts from rest, stops smoothly at each of its corners and at its end.

    Parameters
    ----------
    reference
        What to slow down; of finite duration.
    seconds
        s; how long it takes to come to rest, and again to reach the reference's own speed. Between two
        corners so near that this cannot be reached, the speed stays below it.

    Raises
    ------
    ValueRangeError
        If the ramp is not positive or the reference never ends.

    Examples
    --------
    >>> from dqcontrol.references import Square
    >>> square = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0)
    >>> smooth = CornerStops(square, seconds=0.5)
    >>> smooth.duration, smooth.corners.tolist()
    (10.0, [])
    """

    reference: Reference
    seconds: float

    def __post_init__(self) -> None:
        ramp, whole = as_positive("seconds", self.seconds), finite_duration(self.reference)
        pieces = []
        for length in np.diff(np.unique([0.0, *self.reference.corners, whole])):
            rate = min(1.0, length / ramp)
            pieces.append((ramp, 0.0, rate))
            if length > ramp:
                pieces.append((length - ramp, 1.0, 1.0))
            pieces.append((ramp, rate, 0.0))
        self._pace(self.reference, pieces)
        vars(self).update(corners=NO_CORNERS)


def finite_duration(reference: Reference) -> float:
    """Return the duration of a reference, s, or say that it never ends."""
    if not np.isfinite(reference.duration):
        raise ValueRangeError("reference: never ends, so it has no pace to change")
    return reference.duration


@dataclass(frozen=True, eq=False, repr=False)
class Transformed(Reference):
    """A reference seen after a constant displacement y: pose yx, twist Ad(y)ξ, twist rate Ad(y)ξ̇ [S17 4.9].

    Parameters
    ----------
    reference
        What to displace.
    by
        y, unit dual quaternion, `DualQuaternion` or shape (8,), inertial frame, m.

    Raises
    ------
    ShapeError, ValueRangeError
        If ``by`` is no unit dual quaternion.

    Examples
    --------
    >>> from dqcontrol.references import SetPoint
    >>> up = [1, 0, 0, 0, 0, 0, 0, 0.5]
    >>> Transformed(SetPoint([1, 0, 0, 0, 0, 0.1, 0, 0]), by=up).at(0.0).pose.tolist()
    [1.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.5]
    """

    reference: Reference
    by: ArrayLike

    def __post_init__(self) -> None:
        by = as_pose("by", self.by)
        vars(self).update(by=by, duration=self.reference.duration, corners=self.reference.corners)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        return displaced(self.by, self.reference.motion(times))


@dataclass(frozen=True, eq=False, repr=False)
class Follow(Reference):
    """A reference x for a body at a place y₀, displaced at each sample to where the body is measured, y: y y₀* x.

    Its twist is that of x, turned alike: that of the body is not known. As long as nobody measures the body it is where
    it was to be.

    Parameters
    ----------
    reference
        The motion for the body at ``taught``.
    body
        Its name in the world.
    taught
        y₀, unit dual quaternion, shape (8,), inertial frame.
    until
        From then on the last measurement counts, s, as of a body that the end effector has gripped; to the end if
        omitted.

    Examples
    --------
    >>> from dqcontrol.references import SetPoint
    >>> above = SetPoint([1, 0, 0, 0, 0, 0.25, 0, 0.1])
    >>> follow = Follow(above, "cube", [1, 0, 0, 0, 0, 0.25, 0, 0])
    >>> row = follow.samples([0.0])
    >>> follow.carried(row[0], [1, 0, 0, 0, 0, 0.3, 0, 0])[5:8].tolist()  # half the position
    [0.3, 0.0, 0.1]
    """

    reference: Reference
    body: str
    taught: ArrayLike
    until: float = math.inf

    def __post_init__(self) -> None:
        if math.isfinite(self.until):
            as_positive("until", self.until, zero_allowed=True)
        vars(self).update(duration=self.reference.duration, corners=self.reference.corners)
        vars(self).update(taught=as_pose("taught", self.taught))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21) with the body where it was taught; see `Reference.motion`."""
        return self.reference.motion(times)

    def displacement(self, seen: ArrayLike) -> Array:
        """Return y y₀*, shape (8,), of a body that is measured at a pose y, shape (8,)."""
        return algebra.multiply(as_pose("seen", seen), algebra.conjugate(self.taught))

    def carried(self, row: Array, seen: ArrayLike) -> Array:
        """Return a sample (21,) for a body that is measured at a pose (8,)."""
        out = displaced(self.displacement(seen), row[None])[0]
        out[TIME] = row[TIME]
        return out


def follow_in(reference: Reference | None) -> Follow | None:
    """Return the `Follow` that a reference is, or that it leads in time; None if there is none."""
    while reference is not None and not isinstance(reference, Follow):
        reference = getattr(reference, "reference", None)
    return reference
