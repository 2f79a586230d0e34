"""Rigid motion as samples: the one place where positions and rotations become poses and twists."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dqcontrol.algebra import adjoint_twist, multiply, pose, translation
from dqcontrol.references.sample import POSE, SAMPLE_SIZE, TWIST, TWIST_RATE

Array = NDArray[np.float64]


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
    p = np.atleast_2d(np.asarray(position, dtype=np.float64))
    v, a, w, alpha = (
        np.broadcast_to(np.asarray(each, dtype=np.float64), p.shape)
        for each in (velocity, acceleration, angular_velocity, angular_acceleration)
    )
    out = np.zeros((len(p), SAMPLE_SIZE))
    out[:, POSE] = pose(rotation, p)
    out[:, TWIST] = np.concatenate([w, v + np.cross(p, w)], axis=1)
    out[:, TWIST_RATE] = np.concatenate([alpha, a + np.cross(v, w) + np.cross(p, alpha)], axis=1)
    return out


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


def displaced(by: Array, samples: Array) -> Array:
    """Return samples (N, 21) after a constant displacement y (8,): pose yx, twist Ad(y)ξ, rate Ad(y)ξ̇."""
    out = samples.copy()
    out[:, POSE] = multiply(by, samples[:, POSE])
    for part in (TWIST, TWIST_RATE):
        out[:, part] = adjoint_twist(by, samples[:, part])
    return out
