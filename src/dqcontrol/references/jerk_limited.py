"""The same path at the pace that given speeds, accelerations and jerks allow.

Between two stops the path is run through with an S-curve [`s_curve`] of its progress ℓ. Where the reference
runs and turns at constant speeds, as all lines, arcs and screws do, ℓ is its own time σ and the limits hold
exactly, those of turning too. Elsewhere ℓ is the length of the path, dℓ/dσ = √(|ṗ|² + λ²|ω|²), with λ the
metres that a radian counts. Then σ̇ = ℓ̇/ℓ', σ̈ = (ℓ̈ − ℓ''σ̇²)/ℓ', and pose x(σ), twist σ̇ξ, rate σ̇²ξ̇ + σ̈ξ.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_positive
from dqcontrol.references.modifiers import finite_duration
from dqcontrol.references.reference import NO_CORNERS, SNAP, Reference
from dqcontrol.references.sample import TWIST, TWIST_RATE, point_motion

_SLOWEST = 1e-6  # of the greatest speed; who is slower rests


class PathLength:
    """ℓ(σ) = ∫ √(|ṗ|² + λ²|ω|²) dσ of a stretch of a reference without corners, and its inverse.

    ℓ is summed by the trapezium rule with end corrections, h⁵ exact; σ(ℓ) is the quintic that has the right
    value, slope and curvature at both ends of an interval.

    Parameters
    ----------
    reference
        The motion.
    start, end
        Of the stretch, s.
    margin
        How long before the end its motion is taken, s: at the end itself it may be that of what follows.
    radian
        λ, the metres that a radian counts, m/rad.
    nodes
        Of the table.

    Attributes
    ----------
    length
        m.

    Raises
    ------
    ValueRangeError
        If the motion comes to rest within.
    """

    def __init__(
        self, reference: Reference, start: float, end: float, margin: float, radian: float, nodes: int
    ) -> None:
        self._radian = radian
        time = np.linspace(start, end, nodes + 1)
        margin = min(margin, 0.01 * (end - start))
        slope, bend = self.slope(reference.motion(np.minimum(time, end - margin)))
        slowest = int(np.argmin(slope))
        if slope[slowest] < _SLOWEST * slope.max():
            raise ValueRangeError(
                f"reference: comes to rest by itself at its {time[slowest]:g} s, where it has no corner: give it "
                f"without a ramp or stops of its own"
            )
        h = np.diff(time)
        steps = 0.5 * h * (slope[:-1] + slope[1:]) + h * h / 12 * (bend[:-1] - bend[1:])
        self._time, self._length = time, np.concatenate([[0.0], np.cumsum(steps)])
        self._slopes, self._bends = 1 / slope, -bend / slope**3  # dσ/dℓ, d²σ/dℓ²
        self.length: float = float(self._length[-1])

    def inner_time(self, length: Array) -> Array:
        """Return the times σ (N,), s, at which lengths (N,), m, are reached."""
        k = np.clip(np.searchsorted(self._length, length, side="right") - 1, 0, len(self._time) - 2)
        h = self._length[k + 1] - self._length[k]
        s = np.clip((length - self._length[k]) / h, 0.0, 1.0)
        rise = self._time[k + 1] - self._time[k]
        v0, v1 = h * self._slopes[k], h * self._slopes[k + 1]
        a0, a1 = 0.5 * h * h * self._bends[k], 0.5 * h * h * self._bends[k + 1]
        # Taylor's terms at the start, then what is left to meet the end.
        gap, slope, bend = rise - v0 - a0, v1 - v0 - 2 * a0, a1 - a0
        c3, c4, c5 = 10 * gap - 4 * slope + bend, -15 * gap + 7 * slope - 2 * bend, 6 * gap - 3 * slope + bend
        return self._time[k] + s * (v0 + s * (a0 + s * (c3 + s * (c4 + s * c5))))

    def slope(self, samples: Array) -> tuple[Array, Array]:
        """Return dℓ/dσ and d²ℓ/dσ² (N,) of samples (N, 21) of the motion."""
        _, v, a = point_motion(samples)
        w, alpha = samples[:, 8:11], samples[:, 14:17]
        weight = self._radian**2
        slope = np.sqrt(np.sum(v * v, axis=1) + weight * np.sum(w * w, axis=1))
        bend = np.sum(v * a, axis=1) + weight * np.sum(w * alpha, axis=1)
        return slope, np.divide(bend, slope, out=np.zeros_like(bend), where=slope > 0.0)


def speeds(samples: Array) -> tuple[Array, Array]:
    """Return speed, m/s, and angular speed, rad/s, (N,), of samples (N, 21)."""
    _, v, _ = point_motion(samples)
    return np.linalg.norm(v, axis=1), np.linalg.norm(samples[:, 8:11], axis=1)


# Jerk is +j, 0, −j while speeding up, 0 while cruising and −j, 0, +j while braking. From rest to rest with
# limits that are the same both ways, these seven phases take the least time that the limits allow.


class MotionLimits(NamedTuple):
    """How fast progress may be made: greatest speed, acceleration and jerk, in units per s, s², s³."""

    speed: float
    acceleration: float
    jerk: float


def phases(length: float, limits: MotionLimits) -> tuple[float, float, float]:
    """Return how long jerk lasts (each of four times), full acceleration (each of two), and cruising, s.

    Parameters
    ----------
    length
        How far to go, > 0.
    limits
        All > 0.

    Examples
    --------
    >>> phases(1.0, MotionLimits(speed=0.5, acceleration=1.0, jerk=4.0))
    (0.25, 0.25, 1.25)
    """
    v, a, j = limits
    ramp = a / j if v * j > a * a else math.sqrt(v / j)
    flat = max(0.0, v / a - ramp)
    if length >= v * (2 * ramp + flat):
        return ramp, flat, length / v - (2 * ramp + flat)
    if length > 2 * a * (a / j) ** 2:  # brakes before it is at full speed, but at full acceleration
        ramp = a / j
        reached = 2 * length / (ramp + math.sqrt(ramp * ramp + 4 * length / a))
        return ramp, max(0.0, reached / a - ramp), 0.0
    return math.cbrt(0.5 * length / j), 0.0, 0.0


def s_curve(length: float, limits: MotionLimits) -> tuple[Array, float]:
    """Return the progress over time as cubic pieces, and how long it takes, s.

    Braking mirrors speeding up and is anchored at its end, so that rest is reached exactly.

    Returns
    -------
    pieces
        Shape (n, 6): start of the piece, s; its anchor, s; there the progress, its rate, acceleration and jerk.
    seconds
        s.
    """
    ramp, flat, cruise = phases(length, limits)
    rise = 2 * ramp + flat
    seconds = 2 * rise + cruise
    rows, time, p, v, a = [], 0.0, 0.0, 0.0, 0.0
    for duration, jerk in ((ramp, limits.jerk), (flat, 0.0), (ramp, -limits.jerk)):
        if duration > 0.0:
            rows.append((time, time, p, v, a, jerk))
        p += duration * (v + duration * (0.5 * a + duration * jerk / 6))
        v += duration * (a + duration * 0.5 * jerk)
        a += duration * jerk
        time += duration
    ends = [row[0] for row in rows[1:]] + [rise]
    braking = [
        (seconds - end, seconds - begin, length - p, v, -a, jerk)
        for (begin, _, p, v, a, jerk), end in zip(reversed(rows), reversed(ends), strict=True)
    ]
    if cruise > 0.0:
        rows.append((rise, rise, p, v, 0.0, 0.0))
    return np.array(rows + braking), seconds


def progress_at(pieces: Array, times: Array) -> tuple[Array, Array, Array]:
    """Return progress, rate and acceleration (N,) of cubic pieces, (N, 6) as of `s_curve`, at times (N,), s."""
    _, anchor, p, v, a, jerk = pieces.T
    t = times - anchor
    return p + t * (v + t * (0.5 * a + t * jerk / 6)), v + t * (a + 0.5 * t * jerk), a + t * jerk


_EVEN = 1e-9  # speeds that differ by no more than this fraction are constant
_AT_REST = 1e-9  # m and rad; who goes less far between two stops rests
_BEFORE = 2 * SNAP  # s before a stop the reference has surely the twist that leads to it
_PROBES = np.concatenate([[1e-3], np.linspace(0.01, 0.99, 29), [1 - 1e-3]])
_LEAST, _MOST = 1e-6, 1e6  # of limits, in units of m or rad
_TABLE_SIZE = 400_000  # nodes of all tables of path length together


@dataclass(frozen=True, eq=False, repr=False)
class JerkLimited(Reference):
    """A reference's path from rest to rest, within limits of speed, acceleration and jerk along the path.

    It stops at each corner of the reference and at its end; pauses last as long as in the reference. Between
    two stops it is as fast as the limits allow, whatever the reference's own speed. Acceleration and jerk are
    those along the path (of the speed); in a bend of radius ρ, v²/ρ towards its centre comes on top.

    Parameters
    ----------
    reference
        Of finite duration. It must not slow down to rest by itself other than at corners and in pauses: give
        it without `StartRamp` or `CornerStops`.
    velocity, acceleration, jerk
        MotionLimits along the path, m/s, m/s², m/s³.
    angular_velocity, angular_acceleration, angular_jerk
        MotionLimits of turning, rad/s, rad/s², rad/s³: all or none. Needed where the reference turns on the spot.
        On a path whose turn per metre changes (`ViaPoints`), both speed limits hold, but acceleration and
        jerk are limited of √(s² + λ²θ²), λ the largest of the three ratios of the limits, m/rad.

    Raises
    ------
    ValueRangeError
        If a limit is not positive, the reference never ends, never moves or slows down to rest by itself, or
        it turns on the spot and no limits of turning are given.
    ShapeError
        If some, but not all limits of turning are given.

    Examples
    --------
    >>> from dqcontrol.references import Square
    >>> square = Square([1, 0, 0, 0, 0, 0, 0, 0], side=0.1, duration=8.0)
    >>> smooth = JerkLimited(square, velocity=0.1, acceleration=0.5, jerk=5.0)
    >>> round(smooth.duration, 12), smooth.corners.tolist()  # 1 s to run 0.1 m, 0.2 s to be fast, 0.1 s to be smooth
    (5.2, [])
    """

    reference: Reference
    _: KW_ONLY
    velocity: float
    acceleration: float
    jerk: float
    angular_velocity: float | None = None
    angular_acceleration: float | None = None
    angular_jerk: float | None = None
    _pieces: Array = field(init=False, repr=False)
    _stretches: NDArray[np.intp] = field(init=False, repr=False)  # of each piece
    _stops: Array = field(init=False, repr=False)  # σ at the ends of the stretches
    _lengths: dict[int, PathLength] = field(init=False, repr=False)  # of uneven stretches

    def __post_init__(self) -> None:
        linear = MotionLimits(*(_limit(n, getattr(self, n)) for n in ("velocity", "acceleration", "jerk")))
        angular = self._angular()
        stops = np.unique([0.0, *self.reference.corners, finite_duration(self.reference)])
        seconds = np.diff(stops)
        probes = stops[:-1, None] + seconds[:, None] * _PROBES
        inner = self.reference.motion(probes.ravel())
        running, turning = (each.reshape(probes.shape) for each in speeds(inner))
        runs, turns = (each.max(axis=1) * seconds > _AT_REST for each in (running, turning))
        running, turning = running * runs[:, None], turning * turns[:, None]  # without round-off
        if not (runs | turns).any():
            raise ValueRangeError("reference: never moves, so it has no pace to change")
        if angular is None and (turns & ~runs).any():
            where = stops[np.argmax(turns & ~runs)]
            raise ValueRangeError(
                f"angular_velocity: needed, with angular_acceleration and angular_jerk: the reference turns on "
                f"the spot at its {where:g} s"
            )
        even = _is_even(running) & (_is_even(turning) | (angular is None))
        nodes = int(np.clip(_TABLE_SIZE // max(1, np.count_nonzero(~even)), 64, 4096))
        pieces, stretches, lengths, time = [], [], {}, 0.0
        for i in range(len(seconds)):
            if not (runs[i] or turns[i]):
                table, lasts = np.zeros((1, 6)), seconds[i]
            elif even[i]:
                limits = _own_time(linear, angular, running[i, 0], turning[i, 0])
                table, lasts = s_curve(seconds[i], limits)
            else:
                limits, radian = _joint(linear, angular)
                lengths[i] = PathLength(self.reference, stops[i], stops[i + 1], _BEFORE, radian, nodes)
                if not math.isfinite(lengths[i].length):
                    raise ValueRangeError("reference: too far and fast for its pace to be changed")
                table, lasts = s_curve(lengths[i].length, limits)
            table[:, :2] += time
            pieces.append(table)
            stretches += [i] * len(table)
            time += lasts
        vars(self).update(duration=float(time), corners=NO_CORNERS, _pieces=np.concatenate(pieces))
        vars(self).update(_stretches=np.array(stretches), _stops=stops, _lengths=lengths)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        k = np.clip(np.searchsorted(self._pieces[:, 0], times, side="right") - 1, 0, None)
        progress, rate, change = progress_at(self._pieces[k], times)
        stretch = self._stretches[k]
        start, end = self._stops[stretch], self._stops[stretch + 1]
        inner_time = np.clip(start + progress, start, end)
        uneven = [int(i) for i in np.unique(stretch) if i in self._lengths] if self._lengths else []
        for i in uneven:
            rows = stretch == i
            inner_time[rows] = self._lengths[i].inner_time(progress[rows])
        out = self.reference.motion(inner_time)
        # At the end of a stretch the reference already has the twist of what follows.
        late = np.flatnonzero(inner_time > end - _BEFORE)
        if len(late):
            before = np.maximum(end[late] - _BEFORE, start[late])
            out[late, TWIST.start : TWIST_RATE.stop] = self.reference.motion(before)[
                :, TWIST.start : TWIST_RATE.stop
            ]
        for i in uneven:
            rows = stretch == i
            slope, bend = self._lengths[i].slope(out[rows])
            rate[rows] /= slope
            change[rows] = (change[rows] - bend * rate[rows] ** 2) / slope
        twist, rate, change = out[:, TWIST].copy(), rate[:, None], change[:, None]
        out[:, TWIST] *= rate
        out[:, TWIST_RATE] = rate * rate * out[:, TWIST_RATE] + change * twist
        return out

    def _angular(self) -> MotionLimits | None:
        names = ("angular_velocity", "angular_acceleration", "angular_jerk")
        given = [name for name in names if getattr(self, name) is not None]
        if not given:
            return None
        for name in names:
            if name not in given:
                raise ShapeError(f"{name}: missing: give all of {', '.join(names)} or none")
        return MotionLimits(*(_limit(name, getattr(self, name)) for name in names))


def _limit(field: str, value: float) -> float:
    """Return a limit; beyond these numbers phases would take no time, or for ever."""
    limit = as_positive(field, value)
    if not _LEAST <= limit <= _MOST:
        raise ValueRangeError(f"{field}: must lie in {_LEAST:g} … {_MOST:g}, got {limit:g}")
    return limit


def _is_even(rates: Array) -> NDArray[np.bool_]:
    """Return which rows (n, k) are constant."""
    return rates.max(axis=1) - rates.min(axis=1) <= _EVEN * rates.max(axis=1)


def _own_time(
    linear: MotionLimits, angular: MotionLimits | None, running: float, turning: float
) -> MotionLimits:
    """Return the limits of σ̇, σ̈ and its rate, for a reference that runs and turns at these speeds."""
    pairs = ((linear, running), (angular, turning))
    scaled = [[limit / speed for limit in each] for each, speed in pairs if each and speed]
    return MotionLimits(*np.min(scaled, axis=0).tolist())


def _joint(linear: MotionLimits, angular: MotionLimits | None) -> tuple[MotionLimits, float]:
    """Return the limits of the joint length √(s² + λ²θ²), and λ, m/rad."""
    if angular is None:
        return linear, 0.0
    return linear, max(a / b for a, b in zip(linear, angular, strict=True))
