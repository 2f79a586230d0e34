"""Twists that come early, and lead: what joints with a delay and a lag must be told to be there in time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import OK, READ, READ2, STATUS, WRITE2, inline_ieee, kernel
from dqcontrol.errors import as_positive
from dqcontrol.references.reference import SNAP, Reference, begun
from dqcontrol.references.sample import TWIST, TWIST_RATE, point_motion

if TYPE_CHECKING:
    from dqcontrol.references.sequence import Guards

_STEP = 0.2  # of the lag, between the twists whose difference leads
_LEAST_STEP = 1e-3  # s
_FEW = 10_000  # samples, which take half as long in Python as their kernel takes to compile


@dataclass(frozen=True, eq=False, repr=False)
class Previewed(Reference):
    """A reference whose poses are those of another one, and whose twists are what makes lagging joints follow them.

    A joint with delay D and lag τ that is told the velocity u answers y with τÿ + ẏ = u(t − D). So laws with
    feed-forward are given (ξ(t + D) − a ξ(t + D − h))/(1 − a) with a = exp(−h/τ), which for short h is
    ξ(t + D) + τ ξ̇(t + D), as twist of the pose at t. Where a twist jumps by Δ, at corners and at a start at speed, that
    would be a pulse of about Δ τ/h for h: no joint follows it. Jumps are led by Δ for τ instead, which makes up for the
    same way that the lag costs; points that follow one another within the lag are samples of a smooth motion, and
    led exactly. Where these are evenly spaced, the twist from one to the next is that of their middle, and goes
    straight from middle to middle: read as constant it would come up to half a period early. Errors are corrected as
    before, so no loop's stability changes. What cannot be done in advance is not: the first D seconds.

    Parameters
    ----------
    reference
        What is followed.
    delay, lag
        D and τ of the joints, s, as ``dqcontrol identify`` finds them: those of the slowest, or the mean.
    step
        h, s; the control period is best. Default: a fifth of the lag.

    Attributes
    ----------
    smoothed
        Points that follow one another evenly and sooner than that, s, are samples of a smooth motion.

    Raises
    ------
    ValueRangeError
        If a time is negative.

    Examples
    --------
    >>> from dqcontrol.references import Circle
    >>> circle = Circle([1, 0, 0, 0, 0, 0, 0, 0], radius=0.1, duration=10.0)
    >>> early = Previewed(circle, delay=0.5)
    >>> bool(abs(early.at(1.0).twist - circle.at(1.5).twist).max() < 1e-12)
    True
    """

    reference: Reference
    delay: float = 0.0
    lag: float = 0.0
    step: float | None = None
    smoothed: float = field(init=False)

    def __post_init__(self) -> None:
        delay = as_positive("delay", self.delay, zero_allowed=True)
        lag = as_positive("lag", self.lag, zero_allowed=True)
        step = max(_STEP * lag, _LEAST_STEP) if self.step is None else as_positive("step", self.step)
        starts, jumps = _starts(_Same(self.reference))
        gaps, smoothed = np.diff(starts), max(lag, step + SNAP)
        close = gaps < smoothed
        even = 1 + np.flatnonzero((gaps[1:] < smoothed) & (np.abs(np.diff(gaps)) < SNAP))
        sampled = starts[even], gaps[even - 1], jumps[even]
        if close.any():
            jumps = jumps.copy()  # of samples of a smooth motion
            jumps[np.append(False, close) | np.append(close, False)] = 0.0
        ends = starts[1:] - delay
        moved = np.unique(np.concatenate([ends, starts - delay + lag])) if lag else ends
        moved = moved[(moved > 0) & (moved < self.reference.duration)]
        moved.flags.writeable = False
        jumped = np.zeros((len(starts) + 1, 6))
        np.cumsum(jumps, axis=0, out=jumped[1:])
        share = math.exp(-step / lag) if lag else 0.0
        vars(self).update(duration=self.reference.duration, corners=moved)
        vars(self).update(_share=share, _ahead=delay, _behind=step, _starts=starts - SNAP, _jumped=jumped)
        vars(self).update(smoothed=smoothed, _sampled=sampled)

    @property
    def guards(self) -> Guards:
        """Those of the reference: poses come when they did."""
        return self.reference.guards._replace(lead=(self.delay, self.lag))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        share, step = self._share, self._behind  # type: ignore[attr-defined]
        seen = _seen_early(_Same(self.reference), self._ahead, step if share else 0.0, times.tobytes())  # type: ignore[attr-defined]
        numbers = np.array([share, self._ahead, self.lag, step])  # type: ignore[attr-defined]
        out = seen.samples.copy()
        moving = self._smooth(times + self._ahead, seen.moving)  # type: ignore[attr-defined]
        before = self._smooth(times + self._ahead - step, seen.before)  # type: ignore[attr-defined]
        lead.worth_compiling(len(times), _FEW)(
            numbers, times, self._starts, self._jumped, seen.position, seen.present, moving, before, out  # type: ignore[attr-defined]
        )  # fmt: skip
        return out

    def _smooth(self, times: Array, moving: Array) -> Array:
        """Return [ω; ṗ] and its rate (N, 12) at some times with that of evenly spaced points from middle to middle."""
        corners, gaps, jumps = self._sampled  # type: ignore[attr-defined]
        if not len(corners):
            return moving
        k = np.minimum(np.searchsorted(corners + gaps / 2, times), len(corners) - 1)
        away = times - corners[k]
        # In the middle it is what it is, to the last bit.
        found = np.flatnonzero(np.abs(away) < gaps[k] / 2 - SNAP)
        k, away, out = k[found], away[found], moving.copy()
        out[found, :6] += (away / gaps[k] + np.where(away < -SNAP, 0.5, -0.5))[:, None] * jumps[k]
        return out


@inline_ieee
def _cross(a, b):
    """Return a × b of two triples."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


# share, delay, lag and step; times, starts, sums of their jumps; of `_Ahead` all but the samples; samples
@kernel(STATUS(READ, READ, READ, READ2, READ2, READ2, READ2, READ2, WRITE2), strict=True)
def lead(numbers, times, starts, jumped, position, present, moving, before, out):
    """Write twists and their rates that are led into samples."""
    share, delay, lag, step = numbers[0], numbers[1], numbers[2], numbers[3]
    for k in range(times.shape[0]):
        turning, turning_rate, p = out[k, 8:11], out[k, 14:17], position[k]
        speed, speed_rate = out[k, 11:14], out[k, 17:20]
        for i in range(3):
            turning[i], speed[i] = moving[k, i], moving[k, 3 + i]
            turning_rate[i], speed_rate[i] = moving[k, 6 + i], moving[k, 9 + i]
        if share != 0.0:
            ahead = times[k] + delay
            now, late, close = begun(starts, ahead), begun(starts, ahead - lag), begun(starts, ahead - step)
            for i in range(3):
                for at, led in ((i, turning), (3 + i, speed)):
                    led[i] = (led[i] - share * before[k, at]) / (1.0 - share)
                    led[i] += jumped[now, at] - jumped[late, at]
                    led[i] -= share / (1.0 - share) * (jumped[now, at] - jumped[close, at])
                turning_rate[i] = (turning_rate[i] - share * before[k, 6 + i]) / (1.0 - share)
                speed_rate[i] = (speed_rate[i] - share * before[k, 9 + i]) / (1.0 - share)
        a, b, c = _cross(present[k], turning), _cross(p, turning_rate), _cross(p, turning)
        for i in range(3):
            speed_rate[i] += a[i] + b[i]
            speed[i] += c[i]
    return OK


class _Same:
    """A reference as a key, whatever it says of equality."""

    def __init__(self, reference: Reference) -> None:
        self.reference = reference

    def __hash__(self) -> int:
        return id(self.reference)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.reference is other.reference


class _Ahead(NamedTuple):
    """A reference at some times, and what it does later: whatever the lag, so the runs of a study share it.

    Attributes
    ----------
    samples, position, present
        Samples (N, 21), positions and ṗ, each (N, 3).
    moving, before
        [ω; ṗ] and its rate a delay later, and by how much before that, each (N, 12).
    """

    samples: Array
    position: Array
    present: Array
    moving: Array
    before: Array


@lru_cache(maxsize=16)  # of a few thousand times each
def _seen_early(same: _Same, delay: float, step: float, at: bytes) -> _Ahead:
    times = np.frombuffer(at)
    samples = same.reference.motion(times)
    position, present, _ = point_motion(samples)
    ahead = times + delay
    moving = _moving(same.reference, ahead)
    before = ahead - step
    led = _moving(same.reference, before) * (before >= 0)[:, None] if step else moving
    return _Ahead(samples, position, present, moving, led)


@lru_cache(maxsize=4)
def _starts(same: _Same) -> tuple[Array, Array]:
    """Return the start of a reference and its corners, and how [ω; ṗ] jumps there."""
    starts = np.concatenate([[0.0], same.reference.corners])
    jumps = _moving(same.reference, starts)[:, :6]
    jumps[1:] -= _moving(same.reference, starts[1:] - 2 * SNAP)[:, :6]
    return starts, jumps


def _moving(reference: Reference, times: Array) -> Array:
    """Return [ω; ṗ] of a reference and its rate, shape (N, 12), at rest before and after it."""
    samples = reference.samples(np.maximum(times, 0.0))
    _, speed, speed_rate = point_motion(samples)
    return np.hstack([samples[:, TWIST][:, :3], speed, samples[:, TWIST_RATE][:, :3], speed_rate])
