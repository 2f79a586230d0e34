"""Where a base on wheels believes to be from the encoders of its wheels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import as_array, as_positive
from dqcontrol.robots.bases import DifferentialDrive
from dqcontrol.robots.kinematics import driving
from dqcontrol.robots.roller_bases import RollerBase
from dqcontrol.robots.whole_body import WholeBody


class Odometry:
    """Adds up what the encoders of two wheels count: exactly along an arc from reading to reading.

    The angles are rounded to whole ticks Δ = 2π/ticks, so each is off by at most Δ/2 at any time, and the heading,
    whose rounding errors do not add up, by at most r Δ/(2b). What wheels slip it does not see.

    Parameters
    ----------
    drive
        The base, with the wheel radius r and half the track b.
    start
        x, y and φ at the start, shape (3,), m and rad.
    ticks
        Counts in a turn of a wheel.
    wheel_errors
        By which share it takes the right and the left wheel for larger than they are.

    Attributes
    ----------
    pose
        x, y and φ, shape (3,), updated in place.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> odometry = Odometry(dqc.DifferentialDrive(wheel_radius=0.05, half_track=0.1), [0, 0, 0], ticks=1e6)
    >>> odometry.read([2.0, 2.0])
    >>> odometry.pose.round(4).tolist()
    [0.1, 0.0, 0.0]
    """

    def __init__(
        self, drive: DifferentialDrive, start: ArrayLike, ticks: float, wheel_errors: ArrayLike = (0.0, 0.0)
    ) -> None:
        self._begin(start, ticks, drive.wheel_radius, as_array("wheel_errors", wheel_errors, (2,)))
        self._half_track = drive.half_track
        self._table = WholeBody([drive]).drives
        _ = driving.integrate.compiled  # now, not while the robot moves

    def _begin(self, start: ArrayLike, ticks: float, radius: float, wheel_errors: Array) -> None:
        self.pose: Array = as_array("start", start, (3,)).copy()
        self._tick = 2 * math.pi / as_positive("ticks", ticks)
        self._radii = radius * (1.0 + wheel_errors)
        self._counts = np.zeros(len(wheel_errors))

    def read(self, angles: ArrayLike) -> None:
        """Take the angles of the wheels since the start, shape (k,), rad; of a drive the right and the left one's."""
        counts = np.round(np.asarray(angles, dtype=np.float64) / self._tick)
        rolled = self._radii * self._tick * (counts - self._counts)
        self._counts = counts
        self._move(rolled)

    def _move(self, rolled: Array) -> None:
        """Move on by what each wheel has rolled, m."""
        right, left = rolled
        moves = np.array([[0.5 * (right + left), 0.5 * (right - left) / self._half_track]])
        driving.integrate(self._table, self.pose[None].copy(), moves, 1.0, self.pose[None])


class RollerOdometry(Odometry):
    """As `Odometry`, of mecanum or omni wheels: what their speeds fit best, along the arc of a constant velocity.

    Parameters
    ----------
    base
        The base, whose wheels are in the order of the angles.
    start, ticks, wheel_errors
        As of `Odometry`; one error a wheel.

    Examples
    --------
    >>> import dqcontrol as dqc
    >>> base = dqc.MecanumBase(wheel_radius=0.05, half_track=0.15, half_wheelbase=0.25)
    >>> odometry = RollerOdometry(base, [0, 0, 0], 1e6, [0, 0, 0, 0])
    >>> odometry.read([2.0, -2.0, -2.0, 2.0])
    >>> (odometry.pose.round(4) + 0.0).tolist()
    [0.0, 0.1, 0.0]
    """

    def __init__(self, base: RollerBase, start: ArrayLike, ticks: float, wheel_errors: ArrayLike) -> None:
        errors = as_array("wheel_errors", wheel_errors, (len(base.wheels),))
        self._begin(start, ticks, base.wheel_radius, errors)
        self._fitting = np.linalg.pinv(base.wheel_matrix * base.wheel_radius)

    def _move(self, rolled: Array) -> None:
        """Move on by what each wheel has rolled, m."""
        ahead, left, turned = self._fitting @ rolled
        half = 0.5 * turned
        chord, facing = np.sinc(half / np.pi), self.pose[2] + half
        c, s = math.cos(facing), math.sin(facing)
        self.pose[:] += [chord * (c * ahead - s * left), chord * (s * ahead + c * left), turned]
