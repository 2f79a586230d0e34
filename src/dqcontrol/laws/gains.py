"""Gains: constant or changing with time."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from dqcontrol.errors import ShapeError, ValueRangeError, as_array, as_positive
from dqcontrol.named_fields import CheckedFields


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
    values: Annotated[list[float], Meta(min_length=1, description="gain at each time")]

    def at(self, times: ArrayLike) -> NDArray[np.float64]:
        """Return the gains at these times (s), shape (N,)."""
        return np.interp(np.atleast_1d(times), *self._checked())

    @property
    def end(self) -> float:
        """Time of the last change, s."""
        return float(self._checked()[0][-1])

    def _checked(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return times and values as arrays."""
        knots = as_array("schedule.times", self.times, (None,))
        values = as_array("schedule.values", self.values, (None,))
        if knots.ndim != 1 or knots.shape != values.shape or not knots.size:
            raise ShapeError(
                f"schedule: expected as many values as times, one or more, got {values.shape} and {knots.shape}"
            )
        if (np.diff(knots) <= 0).any():
            raise ValueRangeError(f"schedule.times: must increase, got {self.times}")
        return knots, values


Positive = Annotated[float, Meta(gt=0)]
Gain = Positive | Schedule


def gain_rows(field: str, gain: Gain, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a positive gain at each time, or one row if it is constant."""
    rows = gain.at(times) if isinstance(gain, Schedule) else np.atleast_1d(as_array(field, gain, ()))
    if (rows <= 0).any():
        raise ValueRangeError(f"{field}: must be > 0, got {rows.min():g}")
    return rows


def gain_matrix_rows(
    field: str, gain: Gain | ArrayLike, size: int, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the diagonal of a gain matrix at each time, shape (N or 1, size); a number stands for k I."""
    if type(gain) is float:
        return np.full((1, size), as_positive(field, gain))
    if isinstance(gain, Schedule) or np.ndim(gain) == 0:
        return np.repeat(gain_rows(field, gain, times)[:, None], size, axis=1)  # type: ignore[arg-type]
    diagonal = as_array(field, gain, (size,))
    if diagonal.ndim != 1:
        raise ShapeError(f"{field}: expected a number or {size} diagonal entries, got shape {diagonal.shape}")
    if (diagonal <= 0).any():
        raise ValueRangeError(f"{field}: must be > 0, got {diagonal.min():g}")
    return diagonal[None, :]
