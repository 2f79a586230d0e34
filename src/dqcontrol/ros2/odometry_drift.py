"""How odometry drifts with the way, and the covariance that says so."""

from __future__ import annotations

import math

import numpy as np

from dqcontrol.arrays import Array


class OdometryDrift:
    """Adds up the way of a base with errors that are a random walk, and propagates their covariance.

    Between two samples the base moves by d = (ahead, left), m, along its heading half way, and turns by φ. It takes
    each of these for more by an error of mean 0 and variance σ_s²|d_i|, and σ_m²|d| + σ_r²|φ|: wheels slip and roll
    unevenly a little everywhere. With F and G the derivatives of the new pose by the old one and by the errors,
    P ← F P Fᵀ + G Q Gᵀ [Siegwart, Nourbakhsh, Scaramuzza 2011, 5.2.4].

    Parameters
    ----------
    pose
        x, y (m) and φ (rad) at the start, shape (3,).
    rng
        Draws the errors.

    Attributes
    ----------
    deviations
        σ_s in m/√m, σ_m in rad/√m and σ_r in rad/√rad, shape (3,); 0 at first.
    pose
        Where the base believes to be, shape (3,).
    covariance
        Of that, shape (3, 3).
    """

    def __init__(self, pose: Array, rng: np.random.Generator) -> None:
        self.pose: Array = pose.copy()
        self.deviations: Array = np.zeros(3)
        self.covariance: Array = np.zeros((3, 3))
        self._true, self._rng = pose.copy(), rng

    def follow(self, pose: Array) -> None:
        """Move on to where the base is as a sensor without drift measures it, shape (3,)."""
        if not (self.deviations.any() or self.covariance.any()):
            self.pose, self._true = pose.copy(), pose.copy()
            return
        (dx, dy, turn), half = pose - self._true, 0.5 * (pose[2] - self._true[2])
        self._true = pose.copy()
        c, s = math.cos(pose[2] - half), math.sin(pose[2] - half)
        moved = np.array([c * dx + s * dy, c * dy - s * dx, turn])
        way = math.hypot(dx, dy)
        along, by_way, by_turn = np.square(self.deviations)
        sideways = along * abs(moved[1])
        variances = np.array([along * abs(moved[0]), sideways, by_way * way + by_turn * abs(turn)])
        moved += np.sqrt(variances) * self._rng.standard_normal(3)
        heading = self.pose[2] + 0.5 * moved[2]
        c, s = math.cos(heading), math.sin(heading)
        dx, dy = c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]
        self.pose += (dx, dy, moved[2])
        old = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        errors = np.array([[c, -s, -0.5 * dy], [s, c, 0.5 * dx], [0.0, 0.0, 1.0]])
        self.covariance = old @ self.covariance @ old.T + (errors * variances) @ errors.T
