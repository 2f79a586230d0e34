"""The base of the laws of the pose error: gains, constant or over time, inverse, the sign of x_d."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.arrays import Array
from dqcontrol.compiled.memory_layout import MemoryLayout
from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_each, as_positive
from dqcontrol.laws.inverses import FilteredInverse, Inverse, inverse_parameters
from dqcontrol.laws.law import Law, LoopRates
from dqcontrol.named_fields import CheckedFields
from dqcontrol.robots.robot import Robot

if TYPE_CHECKING:
    from dqcontrol.references import Reference

Positive = Annotated[float, Meta(gt=0)]


class Schedule(CheckedFields, frozen=True, forbid_unknown_fields=True):
    """A gain that changes linearly between given times and is held before the first and after the last. [P16 5.9]

    Parameters
    ----------
    times
        s, increasing.
    values
        The gain at each time.

    Examples
    --------
    >>> from dqcontrol.laws import Schedule
    >>> Schedule([0, 6], [2.5, 5.0]).at(3.0).tolist()
    [3.75]
    """

    spec_key: ClassVar[str] = "schedule"
    times: Annotated[list[float], Meta(min_length=1, description="s, increasing")]
    values: Annotated[list[Positive], Meta(min_length=1, description="gain at each time")]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.values):
            raise ShapeError(
                f"schedule: expected as many values as times, got {len(self.values)} and {len(self.times)}"
            )
        if (np.diff(self.times) <= 0).any():
            raise ValueRangeError(f"schedule.times: must increase, got {self.times}")

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Return the gains at these times (s), shape (N,)."""
        return np.interp(np.atleast_1d(times), self.times, self.values)

    @property
    def end(self) -> float:
        """Time of the last change, s."""
        return float(self.times[-1])


Gain = Positive | Schedule


def gain_rows(field: str, gain: Gain, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a positive gain at each time, or one row if it is constant."""
    return gain.at(times) if isinstance(gain, Schedule) else np.atleast_1d(as_array(field, gain, ()))


def gain_matrix_rows(
    field: str, gain: Gain | ArrayLike, size: int, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the diagonal of a gain matrix at each time, shape (N or 1, size); a number stands for k I."""
    if type(gain) is float:
        return np.full((1, size), as_positive(field, gain))
    if isinstance(gain, Schedule) or np.ndim(gain) == 0:
        return np.repeat(gain_rows(field, gain, times)[:, None], size, axis=1)  # type: ignore[arg-type]
    return as_each(field, gain, size)[None, :]


class PoseParameters(NamedTuple):
    """What compiled code knows of a `PoseLaw`."""

    inverse: Annotated[Array, inverse_parameters.size()]
    hysteresis: float
    gain: Annotated[Array, 8]


pose_parameters: MemoryLayout[PoseParameters] = MemoryLayout(PoseParameters)


class PoseLaw(Law, frozen=True, kw_only=True):
    """A law that feeds back a pose error of eight numbers with a gain each."""

    gain_powers: ClassVar[Mapping[str, float]] = {"gain": 1}
    gain: Annotated[
        Positive | list[Positive] | Schedule,
        Meta(description="K in 1/s: k, its diagonal (8), or k over time"),
    ]
    inverse: Inverse = FilteredInverse()
    hysteresis: Annotated[
        float, Meta(ge=0, lt=1, description="how far Re(x_e) must pass 0 before the sign of x_d flips")
    ] = 0.2

    def parameter_rows(self, robot: Robot, times: np.ndarray) -> np.ndarray:
        """Return inverse, hysteresis and gain diagonal at each time."""
        return pose_parameters.pack(
            inverse=self.inverse.parameters(),
            hysteresis=self.hysteresis,
            gain=gain_matrix_rows("gain", self.gain, 8, times),
        )

    def loop_rates(self, parameters: np.ndarray) -> LoopRates:
        """Return the largest of K's entries for the dual and the primary imaginary parts."""
        gains = pose_parameters(parameters).gain
        return LoopRates(position=gains[:, 5:8].max(axis=1), orientation=gains[:, 1:4].max(axis=1))

    def horizon(self, reference: Reference | None) -> float:
        """Return the end of the gain schedule, s."""
        return self.gain.end if isinstance(self.gain, Schedule) else 0.0
