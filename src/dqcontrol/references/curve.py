"""Motion given as a function of time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, as_array, as_positive
from dqcontrol.references.reference import NO_CORNERS, SMOOTH, Reference
from dqcontrol.references.sample import TWIST, as_pose, motion_samples

_HALF = 3  # samples of the function on each side of an instant
_STEP = 1e-3  # of the duration, at most; s
_LARGEST_STEP = 5e-3  # s; as `_STEP` of 5 s
_LOOKS = 101  # for how fast it is, to tell whether it comes to rest


@dataclass(frozen=True, eq=False, repr=False)
class Curve(Reference):
    """Move as a function of time says; velocities and accelerations are taken from it numerically.

    Derivatives are those of the polynomial of sixth degree through seven values of the function, 1/1000 of the duration
    apart or 5 ms: for a motion at ω rad/s the relative error of the acceleration is about (ωh)⁶/90, h the step. The
    function should be smooth; at a kink derivatives are those of a corner rounded over six steps.

    Parameters
    ----------
    function
        Takes a time in [0, duration], s, and returns where the end effector should be: a position (3,), inertial frame,
        m, or a pose, `DualQuaternion` or shape (8,). The sign of a pose may change from time to time.
    duration
        s.
    start
        Pose that gives the orientation of positions: `DualQuaternion` or shape (8,); unturned if omitted.

    Raises
    ------
    ShapeError, ValueRangeError
        If the function returns neither, or something that is not finite, or the duration is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> def lissajous(t):
    ...     return [0.4 + 0.1 * np.sin(t), 0.1 * np.sin(2 * t), 0.5]
    >>> curve = Curve(lissajous, duration=2 * np.pi)
    >>> curve.at(0.0).twist[:3].tolist(), np.abs(curve.at(1.0).pose[5] - lissajous(1.0)[0] / 2) < 1e-15
    ([0.0, 0.0, 0.0], np.True_)
    """

    function: Callable[[float], ArrayLike]
    duration: float
    start: ArrayLike = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        start, duration = as_pose("start", self.start), as_positive("duration", self.duration)
        vars(self).update(start=start, duration=duration)
        twists = np.abs(self.motion(np.linspace(0.0, duration, _LOOKS))[:, TWIST]).reshape(-1, 2, 3)
        halves = twists.max(axis=2)  # of turning, and of moving
        stops = (halves[-1] <= SMOOTH * halves.max(axis=0)).all()
        vars(self).update(corners=NO_CORNERS if stops else np.array([duration]))

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        step = min(_STEP * self.duration, _LARGEST_STEP)
        middle = np.clip(times, _HALF * step, self.duration - _HALF * step)
        around = np.arange(-_HALF, _HALF + 1)
        grid = np.clip(middle[:, None] + step * around, 0.0, self.duration)  # clipped from rounding only
        first, second = (
            weights / step**order for order, weights in enumerate(_weights((times - middle) / step), start=1)
        )
        here = self._values(times)
        values = self._values(grid.ravel()).reshape(*grid.shape, -1)
        if here.shape[1] == 3:
            velocity, acceleration = (np.einsum("ni,nik->nk", each, values) for each in (first, second))
            return motion_samples(here, velocity, acceleration, np.asarray(self.start)[:4])
        same = np.sign(np.einsum("nik,nk->ni", values[..., :4], here[:, :4]))
        values[..., :4] *= same[..., None]
        values[..., 4:] *= same[..., None]
        position = translation(values)
        velocity, acceleration = (np.einsum("ni,nik->nk", each, position) for each in (first, second))
        turned = [np.einsum("ni,nik->nk", each, values[..., :4]) for each in (first, second)]
        omega, alpha = (2 * _times_conjugate(each, here[:, :4]) for each in turned)
        place = translation(here)
        return motion_samples(place, velocity, acceleration, here[:, :4], omega[:, 1:], alpha[:, 1:])

    def _values(self, times: Array) -> Array:
        """Return the positions (N, 3), or poses (N, 8), at times (N,)."""
        rows = [getattr(each, "vec8", each) for each in map(self.function, times.tolist())]
        values = as_array("function", np.array(rows, dtype=np.float64)) if rows else np.zeros((0, 3))
        if values.ndim != 2 or values.shape[1] not in (3, 8):
            raise ShapeError(
                f"function: must return a position (3,) or a pose (8,), got shape {values.shape[1:]}"
            )
        if values.shape[1] == 8:
            for i in {0, len(values) - 1}:
                as_pose("function", values[i])
        return values


def _weights(offsets: Array) -> tuple[Array, Array]:
    """Return weights (N, 7) of both derivatives, in steps, at offsets (N,) from the middle of seven values."""
    nodes = np.arange(-_HALF, _HALF + 1)
    powers = np.linalg.inv(np.vander(nodes, increasing=True).astype(np.float64))  # (power, node)
    order = np.arange(len(nodes))
    x = np.power(offsets[:, None], np.maximum(order - 1, 0)[None, :]) * order
    xx = np.power(offsets[:, None], np.maximum(order - 2, 0)[None, :]) * order * (order - 1)
    return x @ powers, xx @ powers


def _times_conjugate(a: Array, b: Array) -> Array:
    """Return the products a b* of quaternions (N, 4)."""
    scalar = np.sum(a * b, axis=1, keepdims=True)
    vector = b[:, :1] * a[:, 1:] - a[:, :1] * b[:, 1:] - np.cross(a[:, 1:], b[:, 1:])
    return np.concatenate([scalar, vector], axis=1)
