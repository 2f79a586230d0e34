"""Where a base on wheels believes to be from the encoders of its wheels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import as_array, as_positive
from dqcontrol.robots import driving
from dqcontrol.robots.bases import DifferentialDrive
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
        self.pose: Array = as_array("start", start, (3,)).copy()
        self._tick = 2 * math.pi / as_positive("ticks", ticks)
        self._radii = drive.wheel_radius * (1.0 + as_array("wheel_errors", wheel_errors, (2,)))
        self._half_track = drive.half_track
        self._table = WholeBody([drive]).drives
        self._counts = np.zeros(2)
        _ = driving.integrate.compiled  # now, not while the robot moves

    def read(self, angles: ArrayLike) -> None:
        """Take the angles of the right and the left wheel since the start, shape (2,), rad."""
        counts = np.round(np.asarray(angles, dtype=np.float64) / self._tick)
        right, left = self._radii * self._tick * (counts - self._counts)
        self._counts = counts
        moves = np.array([[0.5 * (right + left), 0.5 * (right - left) / self._half_track]])
        driving.integrate(self._table, self.pose[None].copy(), moves, 1.0, self.pose[None])
