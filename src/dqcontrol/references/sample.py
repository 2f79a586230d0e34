"""The desired motion at one instant."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dqcontrol.arrays import Array
from dqcontrol.errors import ShapeError, ValueRangeError, as_array

POSE, TWIST, TWIST_RATE, TIME = slice(0, 8), slice(8, 14), slice(14, 20), 20
SAMPLE_SIZE = 21  # a sample as compiled code sees it: pose, twist, twist rate, time


@dataclass(frozen=True, eq=False, init=False)
class Sample:
    """Desired pose, twist and twist rate at one time, inertial frame; checked when made.

    Parameters
    ----------
    pose
        Unit dual quaternion, `DualQuaternion` or shape (8,), m; kept as an array.
    twist
        ξ_d = ω + ε(ṗ + p × ω), shape (6,), rad/s and m/s; 0 for a resting target.
    twist_rate
        Its time derivative, shape (6,).
    time
        s.

    Raises
    ------
    ShapeError, ValueRangeError
        If a shape is wrong, a value is not finite, or the pose has not norm 1.
    """

    pose: Array
    twist: Array
    twist_rate: Array
    time: float
    data: Array = field(repr=False)
    # The same, not to be written, as compiled code takes it at once: an array that is frozen costs 0.3 µs more.
    numbers: Array = field(repr=False)

    def __init__(
        self, pose: ArrayLike, twist: ArrayLike = 0.0, twist_rate: ArrayLike = 0.0, time: float = 0.0
    ) -> None:
        data = np.empty(SAMPLE_SIZE)
        data[POSE] = as_pose("pose", pose)
        data[TWIST] = _six("twist", twist)
        data[TWIST_RATE] = _six("twist_rate", twist_rate)
        data[TIME] = as_array("time", time, ())
        self._keep(data)

    @classmethod
    def of_row(cls, row: Array) -> Sample:
        """Return a row (21,) of `Reference.samples` to the last bit: its pose is not normalised once more."""
        sample = cls.__new__(cls)
        sample._keep(row)
        return sample

    def _keep(self, numbers: Array) -> None:
        data = numbers.view()
        data.flags.writeable = False
        vars(self).update(numbers=numbers, data=data, time=float(data[TIME]))
        vars(self).update(pose=data[POSE], twist=data[TWIST], twist_rate=data[TWIST_RATE])


def _six(field: str, value: ArrayLike) -> Array:
    """Return a twist (6,), or a number that stands for all six."""
    array = as_array(field, value)
    if array.shape not in ((), (6,)):
        raise ShapeError(f"{field}: expected shape (6,), got {array.shape}")
    return array


def as_pose(field: str, pose: ArrayLike) -> Array:
    """Return one pose as unit dual quaternion (8,), renormalised, or say what is wrong with it."""
    x = as_array(field, getattr(pose, "vec8", pose), (8,))
    if x.ndim != 1:
        raise ShapeError(f"{field}: expected shape (8,), got {x.shape}")
    norm, along = np.linalg.norm(x[:4]), x[:4] @ x[4:]
    if abs(norm - 1) > 1e-6 or abs(along) > 1e-6:
        raise ValueRangeError(
            f"{field}: expected a unit dual quaternion, got norm {norm:.6g} + ε {along:.6g}"
        )
    x = x / norm
    x[4:] -= (x[:4] @ x[4:]) * x[:4]
    return x
