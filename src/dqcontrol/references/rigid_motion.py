"""Rigid motion as samples: the one place where positions and rotations become poses and twists."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.algebra import adjoint_twist, multiply, translation
from dqcontrol.algebra.conversions import as_unit_quaternion
from dqcontrol.algebra.dual_quaternion_kernels import set_pose
from dqcontrol.arrays import Array
from dqcontrol.compiled.compile import READ2, WRITE2, kernel, types
from dqcontrol.errors import ShapeError, as_array
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE


@kernel(types.void(READ2, READ2, READ2, READ2, READ2, READ2, WRITE2), strict=True)
def _rigid_motion(position, velocity, acceleration, rotation, angular_velocity, angular_acceleration, out):
    """Write samples as `motion_samples` defines them; all but the position may have one row for all."""
    v_step, a_step = int(velocity.shape[0] > 1), int(acceleration.shape[0] > 1)
    r_step, w_step = int(rotation.shape[0] > 1), int(angular_velocity.shape[0] > 1)
    alpha_step = int(angular_acceleration.shape[0] > 1)
    for i in range(out.shape[0]):
        p, v, a, r = position[i], velocity[i * v_step], acceleration[i * a_step], rotation[i * r_step]
        w, alpha = angular_velocity[i * w_step], angular_acceleration[i * alpha_step]
        set_pose(r, p, out[i])
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            out[i, 8 + k] = w[k]
            out[i, 11 + k] = v[k] + (p[m] * w[n] - p[n] * w[m])
            out[i, 14 + k] = alpha[k]
            out[i, 17 + k] = a[k] + (v[m] * w[n] - v[n] * w[m]) + (p[m] * alpha[n] - p[n] * alpha[m])
        out[i, 20] = 0.0


def motion_samples(
    position: ArrayLike,
    velocity: ArrayLike = 0.0,
    acceleration: ArrayLike = 0.0,
    rotation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
    angular_velocity: ArrayLike = 0.0,
    angular_acceleration: ArrayLike = 0.0,
) -> Array:
    """Return samples (N, 21), time 0, of a motion given by its position and rotation.

    x = r + ε½pr,  ξ = ω + ε(ṗ + p × ω),  ξ̇ = α + ε(p̈ + ṗ × ω + p × α) [P16 2.1.3; S17 3.7, 3.9].

    Parameters
    ----------
    position, velocity, acceleration
        p, ṗ, p̈, inertial frame, shape (N, 3) or broadcast to it, m, m/s, m/s².
    rotation
        Unit quaternion r, scalar first, shape (N, 4) or (4,).
    angular_velocity, angular_acceleration
        ω, α, inertial frame, shape (N, 3) or broadcast to it, rad/s, rad/s².

    Examples
    --------
    >>> motion_samples([[1.0, 0.0, 0.0]], velocity=[[0.0, 2.0, 0.0]])[0, 8:14].tolist()
    [0.0, 0.0, 0.0, 0.0, 2.0, 0.0]
    """
    p = np.ascontiguousarray(np.atleast_2d(as_array("position", position, (3,))))
    v, a = _rows("velocity", velocity, len(p)), _rows("acceleration", acceleration, len(p))
    w = _rows("angular_velocity", angular_velocity, len(p))
    alpha = _rows("angular_acceleration", angular_acceleration, len(p))
    r = np.ascontiguousarray(np.atleast_2d(as_unit_quaternion("rotation", rotation)))
    if len(r) not in (1, len(p)):
        raise ShapeError(f"rotation: expected shape (4,) or ({len(p)}, 4), got {r.shape}")
    out = np.empty((len(p), SAMPLE_SIZE))
    _rigid_motion(p, v, a, r, w, alpha, out)
    return out


def _rows(field: str, vectors: ArrayLike, count: int) -> Array:
    """Return vectors (N, 3), or one row for all of them."""
    array = np.asarray(vectors, dtype=np.float64)
    if array.ndim < 2:
        return np.full((1, 3), array)
    if array.shape not in ((1, 3), (count, 3)):
        raise ShapeError(f"{field}: expected shape ({count}, 3), got {array.shape}")
    return np.ascontiguousarray(array)


def point_motion(samples: Array) -> tuple[Array, Array, Array]:
    """Return position, velocity and acceleration (N, 3) of samples (N, 21), m, m/s, m/s²: `motion_samples` undone.

    p = 2 P r*,  ṗ = D(ξ) − p × ω,  p̈ = D(ξ̇) − ṗ × ω − p × α.
    """
    p = translation(samples[:, POSE])
    w, d = samples[:, TWIST][:, :3], samples[:, TWIST][:, 3:]
    alpha, d_rate = samples[:, TWIST_RATE][:, :3], samples[:, TWIST_RATE][:, 3:]
    v = d - np.cross(p, w)
    return p, v, d_rate - np.cross(v, w) - np.cross(p, alpha)


def turned(rotation: Array, axis: Array, angle: Array) -> Array:
    """Return a unit quaternion (4,) turned by angles (N,), rad, about a unit axis (3,): shape (N, 4)."""
    half = 0.5 * angle[:, None]
    turn, whole = np.zeros((len(angle), 8)), np.zeros(8)
    turn[:, :4], whole[:4] = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1), rotation
    return multiply(turn, whole)[:, :4]


def displaced(by: ArrayLike, samples: Array) -> Array:
    """Return samples (N, 21) after a constant displacement y (8,): pose yx, twist Ad(y)ξ, rate Ad(y)ξ̇."""
    out = samples.copy()
    out[:, POSE] = multiply(by, samples[:, POSE])
    for part in (TWIST, TWIST_RATE):
        out[:, part] = adjoint_twist(by, samples[:, part])
    return out
