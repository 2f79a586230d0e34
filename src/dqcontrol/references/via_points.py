"""Smooth motion through poses given one by one."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import translation
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ, WRITE, WRITE2, inline, kernel, types
from dqcontrol.errors import ValueRangeError
from dqcontrol.references.points import Points, as_path
from dqcontrol.references.reference import Reference, corners_between
from dqcontrol.references.rigid_motion import motion_samples
from dqcontrol.references.sample import TWIST
from dqcontrol.references.yaml_form import FileName, Seconds, SpecStart

_FARTHEST_TURN = 150.0  # degrees between two poses

_CUBICS = types.Array(types.float64, 3, "C", readonly=True)
_PIECE = types.Array(types.intp, 1, "C", readonly=True)


@inline
def _vector_of_product(a, b, out):
    """Write Im(a b*)."""
    aw, ax, ay, az = a[0], a[1], a[2], a[3]
    bw, bx, by, bz = b[0], -b[1], -b[2], -b[3]
    out[0] = aw * bx + ax * bw + ay * bz - az * by
    out[1] = aw * by - ax * bz + ay * bw + az * bx
    out[2] = aw * bz + ax * by - ay * bx + az * bw


@kernel(types.void(_CUBICS, _PIECE, READ, WRITE, WRITE2, WRITE2, WRITE2, WRITE2, WRITE2, WRITE2), strict=True)
def _run(cubics, which, elapsed, work, position, velocity, acceleration, rotation, spin, spin_rate):
    """Write the motion, as `motion_samples` takes it, at elapsed times within the pieces of a spline.

    Parameters
    ----------
    cubics
        As of `ViaPoints`: of the rotation's four coefficients, then of the position.
    which, elapsed
        Piece, and time in it, shape (N,), s.
    work
        Shape (12,).
    position, velocity, acceleration, rotation, spin, spin_rate
        Shapes (N, 3), of the rotation (N, 4).
    """
    c, c_rate, c_change = work[0:4], work[4:8], work[8:12]
    for i in range(which.shape[0]):
        k, t = which[i], elapsed[i]
        for n in range(7):
            k0, k1, k2, k3 = cubics[0, k, n], cubics[1, k, n], cubics[2, k, n], cubics[3, k, n]
            value = k0 + t * (k1 + t * (k2 + t * k3))
            rate, change = k1 + t * (2 * k2 + 3 * t * k3), 2 * k2 + 6 * t * k3
            if n < 4:
                c[n], c_rate[n], c_change[n] = value, rate, change
            else:
                position[i, n - 4], velocity[i, n - 4], acceleration[i, n - 4] = value, rate, change
        square, growth = 0.0, 0.0
        for n in range(4):
            square += c[n] * c[n]
            growth += c_rate[n] * c[n]
        _vector_of_product(c_rate, c, spin[i])
        _vector_of_product(c_change, c, spin_rate[i])
        for n in range(3):
            spin[i, n] = 2 * spin[i, n] / square
            spin_rate[i, n] = 2 * spin_rate[i, n] / square - 2 * growth / square * spin[i, n]
        for n in range(4):
            rotation[i, n] = c[n] / math.sqrt(square)


@dataclass(frozen=True, eq=False, repr=False)
class ViaPoints(Reference):
    """Run through poses smoothly: velocities and accelerations, also of turning, are continuous.

    Positions are natural cubic splines over time. So are the four coefficients of the rotation quaternion,
    which are then divided by their norm: r = c/|c|, ω = 2 Im(ċ c*)/|c|², α = 2 Im(c̈ c*)/|c|² − 2 ω (ċ·c)/|c|².
    Between two poses it goes the short way round. It starts and ends at speed, like every reference; wrap it
    in `JerkLimited` or `StartRamp` to start from rest.

    Parameters
    ----------
    times
        Shape (N,), s, increasing, N ≥ 2; the first becomes time 0.
    poses
        Unit dual quaternions, shape (N, 8), inertial frame, m.

    Raises
    ------
    ShapeError, ValueRangeError
        If the shapes do not fit, the times do not increase, a pose is no unit dual quaternion, or two poses
        in succession are more than 150 degrees apart.

    Examples
    --------
    >>> import numpy as np
    >>> poses = np.zeros((3, 8))
    >>> poses[:, 0], poses[:, 5], poses[1, 6] = 1.0, [0.0, 0.1, 0.2], 0.1  # half the positions
    >>> via = ViaPoints([0.0, 1.0, 2.0], poses)
    >>> via.at(1.0).pose[5:].round(12).tolist(), via.at(1.0).twist[3:].round(12).tolist()
    ([0.1, 0.1, 0.0], [0.2, 0.0, 0.0])
    """

    kind = "via-points"

    times: ArrayLike
    poses: ArrayLike
    duration: float = field(init=False)
    corners: NDArray[np.float64] = field(init=False, repr=False)
    _times: Array = field(init=False, repr=False)
    _cubics: Array = field(init=False, repr=False)  # (4, N - 1, 7): coefficients of 1, τ, τ², τ³

    def __post_init__(self) -> None:
        times, poses = as_path(self.times, self.poses)
        turn = np.degrees(2 * np.arccos(np.clip(np.sum(poses[1:, :4] * poses[:-1, :4], axis=1), -1.0, 1.0)))
        if (turn > _FARTHEST_TURN).any():
            i = int(np.argmax(turn > _FARTHEST_TURN))
            raise ValueRangeError(
                f"poses: must turn by at most {_FARTHEST_TURN:g} degrees between two, got {turn[i]:.6g} between "
                f"index {i} and {i + 1}: give one in between"
            )
        cubics = _natural_spline(times, np.concatenate([poses[:, :4], translation(poses)], axis=1))
        _check_norms(times, cubics)
        values = {"times": times, "poses": poses, "duration": float(times[-1])}
        for name, value in {**values, "_times": times, "_cubics": cubics}.items():
            object.__setattr__(self, name, value)
        end = np.array([self.duration])
        corners = corners_between(self.motion(end)[:, TWIST], np.zeros((1, 6)), end)
        object.__setattr__(self, "corners", corners)

    @classmethod
    def from_spec(cls, start: SpecStart, *, file: FileName, duration: Seconds | None = None) -> ViaPoints:
        """Run smoothly through the poses of a file; see `dqcontrol.references.ViaPoints`."""
        points = Points.from_spec(start, file=file, duration=duration)
        return cls(points.times, points.poses)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        which = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(self._times) - 2)
        count = len(times)
        position, velocity, acceleration, spin, spin_rate = (np.empty((count, 3)) for _ in range(5))
        rotation = np.empty((count, 4))
        elapsed = times - self._times[which]
        work = np.empty(12)
        _run(self._cubics, which, elapsed, work, position, velocity, acceleration, rotation, spin, spin_rate)
        return motion_samples(position, velocity, acceleration, rotation, spin, spin_rate)


def _natural_spline(times: Array, values: Array) -> Array:
    """Return the cubics (4, N - 1, k) of the C² spline through values (N, k) that ends without curvature.

    SciPy's has the same (a test compares), but loading it takes 1.3 times as long as loading Numba.
    """
    h = np.diff(times)[:, None]
    slope = np.diff(values, axis=0) / h
    bend = np.zeros_like(values)  # second derivatives; tridiagonal system by elimination
    upper, right = np.zeros(len(times)), np.zeros_like(values)
    for i in range(1, len(times) - 1):
        pivot = 2 * (h[i - 1, 0] + h[i, 0]) - h[i - 1, 0] * upper[i - 1]
        upper[i] = h[i, 0] / pivot
        right[i] = (6 * (slope[i] - slope[i - 1]) - h[i - 1, 0] * right[i - 1]) / pivot
    for i in range(len(times) - 2, 0, -1):
        bend[i] = right[i] - upper[i] * bend[i + 1]
    first = slope - h * (2 * bend[:-1] + bend[1:]) / 6
    return np.stack([values[:-1], first, 0.5 * bend[:-1], np.diff(bend, axis=0) / (6 * h)])


def _check_norms(times: Array, cubics: Array) -> None:
    """Refuse coefficients that come near zero, where the rotation would whirl."""
    fractions = np.linspace(0.0, 1.0, 17)[:, None, None]
    t = fractions * np.diff(times)[None, :, None]
    k0, k1, k2, k3 = cubics[:, :, :4]
    norms = np.linalg.norm(k0 + t * (k1 + t * (k2 + t * k3)), axis=2).min(axis=0)
    if norms.min() < 0.2:
        i = int(np.argmin(norms))
        raise ValueRangeError(
            f"poses: turn too far and unevenly between index {i} and {i + 1} for a smooth motion: give more of them"
        )
