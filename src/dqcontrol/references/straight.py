"""A straight way, and the motion from rest to rest whose jerk is least."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from dqcontrol.algebra import rotation, translation
from dqcontrol.arrays import Array
from dqcontrol.errors import as_array, as_positive
from dqcontrol.references.reference import NO_CORNERS, Reference, Seconds, Vector, Yaml
from dqcontrol.references.sample import as_pose, motion_samples

PEAK_SPEED = 1.875  # times its mean: 15/8, at half of the time


def progress(share: Array) -> Array:
    """Return how far a motion is, 0 … 1, at shares 0 … 1 of its time [Flash and Hogan 1985].

    Examples
    --------
    >>> import numpy as np
    >>> progress(np.array([0.0, 0.5, 1.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    return share**3 * (10 - 15 * share + 6 * share**2)


@dataclass(frozen=True, eq=False, repr=False)
class Straight(Reference):
    """A straight way with constant orientation, from rest to rest or at constant speed.

    p = p₀ + s d with s = 10 τ³ − 15 τ⁴ + 6 τ⁵, or s = τ, over τ = t/duration.

    Parameters
    ----------
    start
        Pose at time 0: unit dual quaternion, `DualQuaternion` or (8,), inertial frame, m.
    way
        d, inertial frame, m, shape (3,).
    duration
        s.
    steady
        True: at constant speed, as a guarded move goes down.

    Raises
    ------
    ShapeError, ValueRangeError
        If the start is no unit dual quaternion, or a number is not finite or not positive.

    Examples
    --------
    >>> down = Straight([1, 0, 0, 0, 0, 0, 0, 0.1], way=[0, 0, -0.02], duration=4.0)
    >>> down.at(2.0).pose[7].round(4).tolist()  # half the height, 0.2 m − 10 mm
    0.095
    """

    kind = "straight"

    start: ArrayLike
    _: KW_ONLY
    way: Annotated[ArrayLike, Yaml(Annotated[Vector, Meta(description="m")])]
    duration: Seconds
    steady: bool = False

    def __post_init__(self) -> None:
        start, way = as_pose("start", self.start), as_array("way", self.way, (3,))
        duration = as_positive("duration", self.duration)
        corners = np.array([duration]) if self.steady else NO_CORNERS
        vars(self).update(start=start, way=way, duration=duration, corners=corners)

    def motion(self, times: Array) -> Array:
        """Return samples (N, 21); see `Reference.motion`."""
        t, way = (times / self.duration)[:, None], as_array("way", self.way)
        share, rate, more = t, np.ones_like(t), np.zeros_like(t)
        if not self.steady:
            share = progress(t)
            rate, more = 30 * t**2 * (1 - t) ** 2, 60 * t * (1 - t) * (1 - 2 * t)
        out = motion_samples(
            translation(self.start) + share * way,
            rate * way / self.duration,
            more * way / self.duration**2,
            rotation(self.start),
        )
        out[:, 20] = times
        return out
