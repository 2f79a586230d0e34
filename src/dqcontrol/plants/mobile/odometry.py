"""Odometry: a base's pose from the encoders of its wheels."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import as_array, as_positive
from dqcontrol.plants.sensors import Camera
from dqcontrol.robots.bases import DifferentialDrive, RollerBase
from dqcontrol.robots.kinematics import driving
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


SEEN = ("camera", "fused")  # locations that take frames


class Sight:
    """What a `Camera` says about one base, for a number of periods.

    Attributes
    ----------
    pose
        Its estimate of x, y and φ, shape (3,), m and rad, updated in place.
    """

    def __init__(self, camera: Camera, start: Array, period: float, steps: int, seed: int) -> None:
        self._plan = camera.schedule(period, steps, 1, seed)
        self.pose: Array = start.copy()
        self._shown = deque([start.copy()] * (self._plan.delay + 1), maxlen=self._plan.delay + 1)
        self._k = 0

    @property
    def age(self) -> float:
        """Time since the last frame arrived, s."""
        return float(self._plan.age[min(self._k, len(self._plan.age) - 1)])

    @property
    def share(self) -> float:
        """Share of the commands that is still obeyed."""
        return float(self._plan.share[min(self._k, len(self._plan.share) - 1)])

    @property
    def is_over(self) -> bool:
        """Whether the periods that were asked for are over."""
        return self._k >= len(self._plan.age)

    def look(self, true: Array) -> None:
        """Take the frame of the next sample, at which the base is at ``true``."""
        self._k += 1
        self._shown.append(true.copy())
        if self._plan.arrives[self._k]:
            self.pose += self._plan.weight * (self._shown[0] + self._plan.errors[self._k] - self.pose)


class FusedSight(Sight):
    """A camera, or another localisation, that corrects odometry: between frames, and while they are late, wheels tell.

    The estimate is T ⊕ o: what odometry says, o, displaced by T in the plane. A frame that shows the base d periods
    ago corrects the estimate of then, z = T ⊕ o(k − d), by the frame's weight, and with it T; what the wheels turned
    since stays as it is. So the delay costs nothing as far as odometry is right, and a low weight (a long
    `filter_time`) averages the frames' noise without lagging behind the motion.

    Parameters
    ----------
    camera, start, period, steps, seed
        As of `Sight`.
    odometry
        Of the same base, already up to date when it looks.
    """

    def __init__(
        self, camera: Camera, start: Array, period: float, steps: int, seed: int, odometry: Odometry
    ) -> None:
        super().__init__(camera, start, period, steps, seed)
        self._odometry = odometry
        self._counted = deque([odometry.pose.copy()] * (self._plan.delay + 1), maxlen=self._plan.delay + 1)
        self._displacement = np.zeros(3)  # T

    def look(self, true: Array) -> None:
        """Take the frame of the next sample, at which the base is at ``true``."""
        self._k += 1
        self._shown.append(true.copy())
        self._counted.append(self._odometry.pose.copy())
        if self._plan.arrives[self._k]:
            counted = self._counted[0]
            then = displaced(self._displacement, counted)
            missing = self._shown[0] + self._plan.errors[self._k] - then
            missing[2] = math.remainder(missing[2], math.tau)
            then += self._plan.weight * missing
            turn = then[2] - counted[2]
            c, s = math.cos(turn), math.sin(turn)
            x, y = counted[:2]
            self._displacement = np.array([then[0] - c * x + s * y, then[1] - s * x - c * y, turn])
        self.pose[:] = displaced(self._displacement, self._odometry.pose)


def displaced(displacement: Array, pose: Array) -> Array:
    """Return (x, y, φ) displaced by another (x, y, φ), m and rad: turned about the origin, then shifted."""
    c, s = math.cos(displacement[2]), math.sin(displacement[2])
    x, y, angle = pose
    return displacement + np.array([c * x - s * y, s * x + c * y, angle])
