"""The length of a path as a function of time, and the time at which a length is reached."""

from __future__ import annotations

import numpy as np

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError
from dqcontrol.references.reference import Reference
from dqcontrol.references.rigid_motion import point_motion

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
