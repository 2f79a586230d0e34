"""Sensors of plants: a camera above the floor that tells where mobile bases are, and a force sensor at the wrist."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.errors import ValueRangeError, as_array
from dqcontrol.named_fields import NamedFields, Three
from dqcontrol.plants.plant import WRENCH_READINGS, Channel, begun_periods

CAMERA_CHANNELS = (Channel("camera_age", (), "s"), Channel("command_share", (), ""))  # of plants with one

_SNAP = 1e-9  # periods or seconds; times that differ by less are equal


class FiducialLoss(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A while in which the camera does not see the base, because somebody stands before it.

    Parameters
    ----------
    time, duration
        s.
    """

    spec_key: ClassVar[str] = "plant.camera.losses"
    time: Annotated[float, Meta(ge=0, le=1e6, description="s")]
    duration: Annotated[float, Meta(gt=0, le=1e6, description="s")]


@dataclass(frozen=True)
class CameraSchedule:
    """What the camera does at each of N samples, all of it drawn before the run.

    Attributes
    ----------
    arrives
        Whether a frame arrives, shape (N + 1,); the one of sample 0 is exact.
    errors
        Of the frame that arrives: Δx, Δy (m) and Δφ (rad) of each base, shape (N + 1, 3 b).
    age
        Time since the last frame arrived, shape (N,), s.
    share
        Of the commands that is still obeyed, shape (N,).
    delay
        From a frame to its arrival, in samples.
    weight
        Of a new frame against the estimate so far.
    """

    arrives: NDArray[np.bool_]
    errors: Array
    age: Array
    share: Array
    delay: int
    weight: float


class Camera(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A camera that measures x, y and φ of mobile bases: late, seldom, with noise and outliers, and not always.

    A frame shows the pose at the first sample at or after its time, arrives after the delay, is read at the next sample
    and held until the next one. Each moves the estimate z by its weight w: z + w (frame − z), w = 1 − exp(−1 / (rate ·
    filter_time)).

    When no frame has arrived for longer than ``timeout``, all commands are scaled down, to nothing within
    ``stopping_time``; with the next frame they count again. The arm stops with its base: where that is believed to be,
    it no longer is, and the end effector would go on towards a goal that it never comes nearer to.

    Parameters
    ----------
    rate
        Frames a second, Hz; at most one a control period.
    delay
        From a frame to its arrival, s.
    position_noise, angle_noise
        Standard deviation of x and y (m) and of φ (rad), white.
    outlier_probability
        Of each frame.
    outlier_position, outlier_angle
        How far an outlier is off, in a random direction of the plane (m) and to either side (rad).
    losses
        When no frames are taken.
    filter_time
        Time constant of the estimate, s; 0 for none.
    timeout, stopping_time
        s.

    Examples
    --------
    >>> import numpy as np, dqcontrol as dqc
    >>> body = dqc.load_robot("little-john")
    >>> slow = dqc.plants.Servo(camera=dqc.plants.Camera(rate=5.0))
    >>> plant = slow.start(body, np.zeros(8), period=0.1, steps=3, seed=0)
    >>> for _ in range(3):
    ...     plant.step(np.array([1.0, 0, 0, 0, 0, 0, 0]))
    >>> plant.q[:1].round(3).tolist(), plant.measured[:1].round(3).tolist()  # at 0.5 m/s; the last frame is of 0.2 s
    ([0.15], [0.1])
    """

    spec_key: ClassVar[str] = "plant.camera"
    rate: Annotated[float, Meta(gt=0, le=1e4, description="Hz")] = 30.0
    delay: Annotated[float, Meta(ge=0, le=100, description="s")] = 0.0
    position_noise: Annotated[float, Meta(ge=0, le=10, description="m")] = 0.0
    angle_noise: Annotated[float, Meta(ge=0, le=4, description="rad")] = 0.0
    outlier_probability: Annotated[float, Meta(ge=0, le=1)] = 0.0
    outlier_position: Annotated[float, Meta(ge=0, le=100, description="m")] = 0.1
    outlier_angle: Annotated[float, Meta(ge=0, le=4, description="rad")] = 0.1
    losses: Annotated[list[FiducialLoss], Meta(max_length=10_000)] = []
    filter_time: Annotated[float, Meta(ge=0, le=100, description="s")] = 0.0
    timeout: Annotated[float, Meta(gt=0, le=1e6, description="s")] = 0.5
    stopping_time: Annotated[float, Meta(gt=0, le=1e6, description="s")] = 0.5

    def __post_init__(self) -> None:
        if self.timeout <= 1 / self.rate:
            raise ValueRangeError(
                f"plant.camera.timeout: must be longer than {1 / self.rate:.4g} s, the time from frame to frame, "
                f"got {self.timeout:g} s"
            )

    def schedule(self, period: float, steps: int, bases: int, seed: int) -> CameraSchedule:
        """Return what the camera does in a number of periods (s).

        Raises
        ------
        ValueRangeError
            If there is more than one frame a period, or the delay is of too many periods.
        """
        # read at the sample after its arrival
        delay, _ = begun_periods("plant.camera.delay", self.delay, period)
        if self.rate * period > 1 + _SNAP:
            raise ValueRangeError(
                f"plant.camera.rate: must be ≤ {1 / period:g} Hz, one frame a period, got {self.rate:g}"
            )
        count = math.ceil(steps * period * self.rate) + 1
        times = np.arange(count) / self.rate
        seen = np.ones(count, dtype=bool)
        for loss in self.losses:
            seen &= (times < loss.time - _SNAP) | (times >= loss.time + loss.duration - _SNAP)
        arrival = np.ceil(times / period - _SNAP).astype(np.intp) + delay
        used = seen & (arrival <= steps)
        arrives, errors = np.zeros(steps + 1, dtype=bool), np.zeros((steps + 1, 3 * bases))
        arrives[arrival[used]] = True
        errors[arrival[used]] = self._errors(count, bases, [seed])[used]
        last = np.maximum.accumulate(np.where(arrives, np.arange(steps + 1), 0))
        age: Array = period * (np.arange(steps) - last[:steps]).astype(np.float64)
        share: Array = np.clip(1 - (age - self.timeout - _SNAP) / self.stopping_time, 0.0, 1.0)
        weight = -math.expm1(-1 / (self.rate * self.filter_time)) if self.filter_time else 1.0
        return CameraSchedule(arrives, errors, age, share, delay, weight)

    def glance(self, poses: ArrayLike, seed: int) -> Array:
        """Return what one frame shows of things that stand still, x, y and φ, shape (N, 3), m and rad.

        Parameters
        ----------
        poses
            Where they are, shape (N, 3).
        seed
            Of noise and outliers; the frames of a run with the same seed have others.
        """
        true = as_array("poses", poses, (None, 3))
        return true + self._errors(1, len(true), [seed, 1]).reshape(-1, 3)

    def _errors(self, count: int, bases: int, seed: list[int]) -> Array:
        """Draw the error of each frame, shape (count, 3 b)."""
        noise = np.random.default_rng([*seed, 3]).standard_normal((count, bases, 3))
        chances = np.random.default_rng([*seed, 4]).random((count, bases, 3))
        chance, direction, side = chances.transpose(2, 0, 1)
        errors = noise * [self.position_noise, self.position_noise, self.angle_noise]
        angle = 2 * math.pi * direction
        far = self.outlier_position
        turn = self.outlier_angle * np.sign(side - 0.5)
        outliers = np.stack([far * np.cos(angle), far * np.sin(angle), turn], axis=-1)
        errors += np.where((chance < self.outlier_probability)[..., None], outliers, 0.0)
        return errors.reshape(count, 3 * bases)


TOUCH_FORCE = "touch_force"  # of the environment on the end effector, base axes
AXES = ("x", "y", "z")
CHANNELS = (
    Channel(WRENCH_READINGS[0], AXES, "N"),
    Channel(WRENCH_READINGS[1], AXES, "N·m"),
    Channel(TOUCH_FORCE, AXES, "N"),
)


class Wrist(NamedFields, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A force sensor at the end effector, along its axes and about its origin, and what hangs on it.

    Parameters
    ----------
    force_noise, torque_noise
        Standard deviation, white, N and N·m.
    force_bias, torque_bias
        What it shows without load, N and N·m.
    filter
        Time constant of its low pass, s.
    mass, center
        Of the tool beyond it, kg and m.
    length, radius
        Of the tool in physics: a rod along z of the end effector that ends at its origin, m; none where the length is
        0.
    flat
        True: it ends flat, as a peg; else round, as a pen.
    """

    spec_key: ClassVar[str] = "plant.wrist"
    force_noise: Annotated[float, Meta(ge=0, description="N")] = 0.0
    torque_noise: Annotated[float, Meta(ge=0, description="N·m")] = 0.0
    force_bias: Annotated[Three, Meta(description="N")] = (0.0, 0.0, 0.0)
    torque_bias: Annotated[Three, Meta(description="N·m")] = (0.0, 0.0, 0.0)
    filter: Annotated[float, Meta(ge=0, description="s")] = 0.0
    mass: Annotated[float, Meta(ge=0, le=1e4, description="kg")] = 0.0
    center: Annotated[Three, Meta(description="m")] = (0.0, 0.0, 0.0)
    length: Annotated[float, Meta(ge=0, description="m")] = 0.0
    radius: Annotated[float, Meta(gt=0, description="m")] = 0.005
    flat: bool = False

    @property
    def bias(self) -> Array:
        """Force and torque without load, shape (6,)."""
        return np.array([*self.force_bias, *self.torque_bias])

    @property
    def noise(self) -> Array:
        """Standard deviation of force and torque, shape (6,)."""
        return np.repeat([self.force_noise, self.torque_noise], 3)

    def kept(self, period: float) -> float:
        """Return what is left of the filter's value after a period, s."""
        return math.exp(-period / self.filter) if self.filter else 0.0
